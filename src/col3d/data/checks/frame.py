"""Checks of one frame: its files, and the depth, normals and flow in them. Each file is read once."""

import hashlib
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from col3d.data.checks.conventions import angles_of, off_lengths
from col3d.data.checks.findings import Finding, FrameReport
from col3d.data.checks.reproject import Pose, flow_error
from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.c3vdv2 import C3VDv2
from col3d.data.datasets.flow import decoded_flow
from col3d.data.datasets.frame_files import Frame
from col3d.data.datasets.frame_set import Depth, FrameSet
from col3d.data.datasets.octagon import octagon_mask
from col3d.data.files.decode import read_rgb8, read_whole
from col3d.errors import DataError

MOST_OUTSIDE = 0.005
"""Share of depth outside the octagon; C3VD's own frames have 0.0004."""
LENGTH_TOLERANCE = 0.01
MOST_FLOW = 0.5
"""Largest median error in pixels; a step of the code is 0.0006, a phantom's flow is off by 0.001."""
TYPES = {8: np.uint8, 16: np.uint16}


def check_frame(
    frames: FrameSet, frame: Frame, in_full: bool, poses: tuple[Pose, Pose] | None = None
) -> tuple[FrameReport, Depth | None]:
    """Check one frame; returns its report, and its depth where it has any.

    Args:
        frames: frames of the data set.
        frame: the frame, with the files that exist.
        in_full: whether to decode the files; otherwise their headers and lengths are checked.
        poses: poses of the frame and of the frame before, for its flow.
    """
    report = FrameReport(frame.video, frame.number, in_full)
    pixels = {kind: _read(frames, kind, path, report) for kind, path in frame.files.items()}
    if (color := pixels.get("color")) is not None:
        report.digest = hashlib.sha1(np.ascontiguousarray(color).data).hexdigest()
    if (codes := pixels.get("depth")) is None:
        return report, None
    depth = frames.decoded_depth(codes)
    _check_depth(frames, frame.files["depth"], depth, report)
    if (normals := pixels.get("normals")) is not None:
        _check_normals(frames, frame.files["normals"], normals, depth, report)
    if (flow := pixels.get("flow")) is not None:
        _check_flow(frames, frame.files["flow"], flow, depth, poses, report)
    return report, depth if depth.known.any() else None


def read_depth(frames: FrameSet, frame: Frame) -> Depth | None:
    """Depth of a frame that is checked elsewhere; None where it cannot be read."""
    return check_frame(frames, Frame(frame.video, frame.number, _depth_alone(frame)), in_full=True)[1]


def _depth_alone(frame: Frame) -> dict[str, Path]:
    return {kind: path for kind, path in frame.files.items() if kind == "depth"}


def _read(frames: FrameSet, kind: str, path: Path, report: FrameReport) -> np.ndarray | None:
    """The pixels of a file; None where they are not requested, or the file is broken, which is reported."""
    expected = frames.kinds[kind]
    try:
        frames.check_file(kind, path)
    except Exception as error:  # a broken header may make its reader raise anything
        text = str(error) if isinstance(error, DataError) else f"{path}: not a readable image ({error})"
        report.fault("file", text)
        return None
    if not report.in_full:
        return None
    try:
        pixels = _pixels(frames, kind, path)
    except DataError as error:
        report.fault("file", str(error))
        return None
    some = pixels.shape[2:] if expected.channels is None else (expected.channels,)[: expected.channels > 1]
    shape = (*frames.camera.size_hw, *some)
    if pixels.shape != shape or pixels.dtype != TYPES.get(expected.bits or 0, pixels.dtype):
        report.fault("file", f"{path}: expected pixels of shape {shape}, got {pixels.shape}, {pixels.dtype}")
        return None
    return pixels


def _pixels(frames: FrameSet, kind: str, path: Path) -> np.ndarray:
    """Decode a file; kinds of any number of bits are read as the data set reads them."""
    if frames.kinds[kind].bits is not None:
        return read_whole(path)
    return frames.depth_codes(path) if kind == "depth" else read_rgb8(path)


def _check_depth(frames: FrameSet, path: Path, depth: Depth, report: FrameReport) -> None:
    known = depth.mm[depth.known]
    report.unknown = 1 - len(known) / depth.known.size
    if not len(known):
        report.fault("depth", f"{path}: expected depth, and not one pixel has any that counts")
        return
    report.low, report.high = float(known.min()), float(known.max())
    if report.low == report.high:
        report.fault("depth", f"{path}: expected depth that varies, got {report.low:.3f} mm everywhere")
    if isinstance(frames, C3VD):
        _check_octagon(path, depth, report, fault=not isinstance(frames, C3VDv2))


def _check_octagon(path: Path, depth: Depth, report: FrameReport, fault: bool) -> None:
    """Check that depth lies inside the octagon; a note for C3VDv2, whose octagon was not measured."""
    report.outside = _share_outside(depth.known)
    if report.outside > MOST_OUTSIDE:
        text = (
            f"{path}: expected depth inside the octagon alone, and {report.outside:.1%} of the pixels with "
        )
        text += f"depth lie outside (at most {MOST_OUTSIDE:.1%})"
        report.findings.append(Finding("octagon", text, report.video, report.number, fault))


def _share_outside(known: Bool[np.ndarray, "h w"]) -> float:
    """Share of the pixels with depth that lie outside the octagon."""
    height, width = known.shape
    outside = ~octagon_mask((height, width))[0].numpy()
    return float(np.count_nonzero(known & outside)) / max(1, int(np.count_nonzero(known)))


def _check_flow(
    frames: FrameSet,
    path: Path,
    codes: np.ndarray,
    depth: Depth,
    poses: tuple[Pose, Pose] | None,
    report: FrameReport,
) -> None:
    """Compare flow with the motion of the surface that depth and poses imply."""
    if codes[..., 2].any():
        report.fault("flow", f"{path}: expected flow in red and green alone, and blue is not 0 everywhere")
    if poses is None:
        return
    report.flow = flow_error(depth, *decoded_flow(codes), poses, frames.camera)
    if report.flow > MOST_FLOW:
        report.fault(
            "flow",
            f"{path}: expected the motion to the frame before, as depth and poses tell it, and flow is "
            f"{report.flow:.2f} px off in the median (at most {MOST_FLOW})",
        )


def _check_normals(
    frames: FrameSet, path: Path, codes: np.ndarray, depth: Depth, report: FrameReport
) -> None:
    if not codes.any():
        report.fault("normals", f"{path}: expected normals, and all its pixels are 0")
        return
    report.off_length = off_lengths(codes, depth.known, LENGTH_TOLERANCE)
    report.angles = angles_of(codes, depth, frames.camera)
