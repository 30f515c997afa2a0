"""Writing of ONNX files from a traced program, and running them by onnxruntime."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.export import ExportedProgram

from col3d.errors import UserError
from col3d.inference.export.metadata import INPUTS, OUTPUTS

AXES = {0: "batch", 2: "height", 3: "width"}


def write_onnx(
    program: ExportedProgram, path: Path, facts: Mapping[str, Any], opset: int | None = None
) -> None:
    """Write the program with its weights into one file.

    Args:
        program: program with inputs and outputs in the order of `INPUTS` and `OUTPUTS`.
        path: path of the file.
        facts: metadata of the file: text is stored as it is, all else as JSON.
        opset: version of ONNX's operators; torch's own choice when absent.

    Raises:
        UserError: the exporter cannot use that version for this network.
    """
    import onnx

    names = {kind: list(facts[kind]) for kind in ("inputs", "outputs")}
    made = torch.onnx.export(
        program,
        dynamo=True,
        input_names=names["inputs"],
        output_names=names["outputs"],
        verbose=False,
        opset_version=opset,
    )
    assert made is not None
    model = made.model_proto
    versions = {entry.domain: entry.version for entry in model.opset_import}
    if opset is not None and versions.get("") != opset:
        raise UserError(f"opset: torch has no version {opset} of this network, but {versions.get('')}")
    _anonymous(model)
    for value in (*model.graph.input, *model.graph.output):
        for axis, name in AXES.items():
            side = value.type.tensor_type.shape.dim[axis]
            if side.dim_param:
                side.dim_param = name
        value.doc_string = {**INPUTS, **OUTPUTS}[value.name]
    model.producer_name, model.producer_version = "col3d", facts["col3d"]
    texts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in facts.items()}
    onnx.helper.set_model_props(model, texts)
    path.write_bytes(model.SerializeToString())


def _anonymous(model: Any) -> None:
    """Remove the exporter's notes about operations: source files of this machine, sizes of the trace."""
    del model.graph.value_info[:]
    del model.graph.metadata_props[:]
    for node in model.graph.node:
        del node.metadata_props[:]
        node.doc_string = ""


class OnnxFile:
    """Runs an ONNX file on the CPU, with as many threads as torch."""

    def __init__(self, path: Path) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        options.intra_op_num_threads = torch.get_num_threads()
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # torch is timed too
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def __call__(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Run the file: arrays by name -> arrays by name."""
        names = [output.name for output in self.session.get_outputs()]
        return dict(zip(names, self.session.run(names, dict(inputs)), strict=True))
