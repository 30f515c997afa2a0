"""`col3d export`: write a network as a file for other programs, after checking it against PyTorch."""

import importlib.util
import io
import logging
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import torch

from col3d.errors import UserError
from col3d.inference.export.exported import is_exported
from col3d.inference.export.half_precision import HalfNetwork
from col3d.inference.export.metadata import facts_of
from col3d.inference.export.onnx_file import OnnxFile, write_onnx
from col3d.inference.export.parity import File, ParityReport, compare
from col3d.inference.export.program_file import ProgramFile, write_program
from col3d.inference.export.traced import LEAST_SIDE, Fixed, traced
from col3d.inference.export.weights_file import write_weights
from col3d.inference.options import ExportOptions
from col3d.inference.predictor import Predictor, load_predictor
from col3d.inference.trained_network import located
from col3d.layers.network import needs_rays, predicts
from col3d.registry.refusals import check_options
from col3d.runs.environment import quiet
from col3d.runs.known_failures import as_user_errors
from col3d.signals import StopSignals, stoppable

FORMATS: dict[str, tuple[Callable[..., None], Callable[[Path], File], str]] = {
    ".onnx": (write_onnx, OnnxFile, "onnxruntime"),
    ".pt2": (write_program, ProgramFile, "torch.export"),
}
"""By suffix: the function that writes a file, the class that opens it, and the name of its engine."""
WEIGHTS = ".ckpt"
EXTRA = ("onnx", "onnxscript", "onnxruntime")


def export(given: Mapping[str, Any]) -> None:
    """Load a network, write it, and compare the file with PyTorch before it is put in place.

    Args:
        given: the composed configuration as plain values; see `ExportOptions`.

    Raises:
        UserError: an option or the checkpoint breaks a rule, or the file's output differs.
        OSError: the file cannot be written.
    """
    quiet()
    options = check_options(ExportOptions, given)
    path = Path(options.output)
    _check(path, options)
    with (
        as_user_errors("the network is tried at that size and batch: a smaller size= or batch= takes less"),
        stoppable(f"nothing was written to {path}, and the same command begins anew") as stop,
    ):
        if path.suffix == WEIGHTS:
            _export_weights(options, path, stop)
        else:
            _export_program(options, path, stop)


def _export_program(options: ExportOptions, path: Path, stop: StopSignals) -> None:
    seen = options.size if options.published else None
    subject = load_predictor(Path(options.checkpoint), options.published, options.max_depth, seen)
    size_hw = None if options.size is None else (options.size[0], options.size[1])
    fixed = Fixed(options.batch, size_hw)
    _check_output(subject)
    with _in_place(path, stop) as partial:
        print(f"export: {subject.name} to {path}, which takes a while", flush=True)
        likeness = write_checked(subject, partial, options, fixed)
    _report(subject, path, likeness, fixed)


def _check_output(subject: Predictor) -> None:
    """Refuse a network whose output is not finite, before minutes of tracing."""
    lens = next(iter(subject.cameras), None)
    if lens is not None or not needs_rays(subject.network):
        grey = torch.full((1, 3, *subject.size_hw), 128, dtype=torch.uint8)
        subject.predict(grey, None if lens is None else lens.resized(subject.size_hw))


def _export_weights(options: ExportOptions, path: Path, stop: StopSignals) -> None:
    with _in_place(path, stop) as partial:
        difference = write_weights(Path(options.checkpoint), partial)
    print(f"wrote {path}, {path.stat().st_size / 1e6:.1f} MB: the network alone, to predict with")
    print(f"largest difference from the checkpoint: {difference:.1e} of the depth, or in a normal")


def _check(path: Path, options: ExportOptions) -> None:
    """Refuse an output that could not be written, or that would replace other files or the checkpoint."""
    if path.resolve() == located(Path(options.checkpoint)).resolve():
        raise UserError(f"output: {path} is the checkpoint itself, which holds more than its network")
    if path.suffix == ".onnx" and not all(importlib.util.find_spec(name) for name in EXTRA):
        raise UserError("export: needs pip install -e '.[onnx]'")
    if path.is_dir():
        raise UserError(f"output: {path} is a folder")
    if path.exists() and not options.overwrite:
        raise UserError(f"output: {path} is there already; give overwrite=true to replace it")
    if path.exists() and not is_exported(path):
        raise UserError(f"output: {path} is no export of this program and stays as it is; name another file")


@contextmanager
def _in_place(path: Path, stop: StopSignals) -> Iterator[Path]:
    """Yield a temporary file beside `path`, which replaces `path` at the end and is removed after an error.

    Raises:
        OSError: names `path`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    partial.touch()
    try:
        yield partial
        _on_disk(partial)
        partial.replace(path)
        stop.hold()  # from here on a stop may not report that nothing was written
    except OSError as error:
        if error.filename in (None, str(partial)):
            error.filename, error.filename2 = str(path), None
        raise
    finally:
        partial.unlink(missing_ok=True)


def _on_disk(path: Path) -> None:
    """Flush a file to the disk: some file systems report only then that they are full."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def write_checked(subject: Predictor, partial: Path, options: ExportOptions, fixed: Fixed) -> ParityReport:
    """Write the file, and compare it with PyTorch.

    Raises:
        UserError: it differs.
    """
    subject.network.to("cpu").requires_grad_(False)
    write, opened, _ = FORMATS[partial.suffix]
    half = HalfNetwork(subject.network).eval() if options.half else None
    with _silently():
        write(traced(half or subject.network, fixed), partial, facts_of(subject, fixed), options.opset)
        file = opened(partial)
    return compare(subject, file, fixed, half)


@contextmanager
def _silently() -> Iterator[None]:
    """Silence exporters in the block, which report every operation that they do not optimise."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _rounding(likeness: ParityReport, units: Mapping[str, str]) -> str:
    """Format the rounding error of half precision in PyTorch itself; empty if it was not measured."""
    own = ", ".join(f"{name} {value:.1e}{units[name]}" for name, value in likeness.rounding.items())
    return f"; PyTorch's own in half: {own}" if own else ""


def _report(subject: Predictor, path: Path, likeness: ParityReport, fixed: Fixed) -> None:
    sizes = ", ".join(" x ".join(map(str, size)) for size in likeness.sizes)
    units = {"depth": " mm", "normals": " in a component"}
    largest = ", ".join(f"{name} {value:.1e}{units[name]}" for name, value in likeness.differences.items())
    at = " x ".join(map(str, fixed.size_hw or subject.size_hw))
    *_, engine = FORMATS[path.suffix]
    takes = "image and rays" if needs_rays(subject.network) else "image"
    gives = ", ".join(predicts(subject.network))
    print(f"wrote {path}, {path.stat().st_size / 1e6:.1f} MB: {takes} -> {gives}")
    batch = "any batch" if fixed.batch is None else f"batches of {fixed.batch}"
    size = f"any size from {LEAST_SIDE} x {LEAST_SIDE}"
    if fixed.size_hw is not None:
        size = f"images of {fixed.size_hw[0]} x {fixed.size_hw[1]}"
    print(f"{batch}, {size}; checked at {sizes}")
    precision = " in single precision" if likeness.rounding else ""
    print(f"largest difference from PyTorch{precision}: {largest}{_rounding(likeness, units)}")
    print(
        f"{engine} takes {likeness.ratio:.2f} of PyTorch's time at {at} ({torch.get_num_threads()} threads)"
    )
