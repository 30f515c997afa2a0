"""Files of `torch.export`: programs that torch runs without this code."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.export import ExportedProgram
from torch.fx import GraphModule

FACTS = "col3d.json"


def write_program(
    program: ExportedProgram, path: Path, facts: Mapping[str, Any], opset: int | None = None
) -> None:
    """Write the program with its weights, and the facts as JSON inside.

    It is read by `torch.export.load(path, extra_files={"col3d.json": ""}).module(check_guards=False)`: guards
    check the memory layout of the trace, and would refuse other sizes. `opset` is for ONNX, and None here.
    """
    _anonymous(program)
    content = io.BytesIO()  # torch ends the whole process if it cannot write to a disk
    torch.export.save(program, content, extra_files={FACTS: json.dumps(facts)})
    path.write_bytes(content.getbuffer())


def _anonymous(program: ExportedProgram) -> None:
    """Remove torch's notes about operations: lines of source files of this machine."""
    for module in program.graph_module.modules():
        if isinstance(module, GraphModule):
            for node in module.graph.nodes:
                node.meta.pop("stack_trace", None)


class ProgramFile:
    """Runs such a file on the CPU."""

    def __init__(self, path: Path) -> None:
        self.program = torch.export.load(path).module(check_guards=False)

    @torch.inference_mode()
    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Run the program: arrays by name, in the order of the network's arguments -> arrays by name."""
        outputs = self.program(*(torch.from_numpy(values) for values in inputs.values()))
        return {name: values.numpy() for name, values in outputs.items()}
