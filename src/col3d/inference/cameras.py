"""Parsing of the option `camera`: a lens of a data set, the numbers of a pinhole, a file, or none."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from jaxtyping import Bool
from torch import Tensor

from col3d.errors import DataError, UserError
from col3d.geometry import Camera, PinholeCamera
from col3d.geometry.camera_file import check_round_trip, read_lens
from col3d.nearest_names import nearest_name
from col3d.registry import DATASETS, Part

SQUEEZE = 0.01
"""Largest relative difference of the aspect ratio from that of the lens."""
CameraOption = str | list[float] | None


def lenses() -> dict[str, Part]:
    """Return the data sets whose name stands for their lens, by name."""
    parts = (DATASETS[name] for name in DATASETS.names())
    return {part.name: part for part in parts if hasattr(part.build, "lens") and not part.facts["rendered"]}


def lens_of(option: CameraOption) -> Camera | None:
    """Return the camera at the size it was calibrated at, or at size (0, 0) if that is not known.

    Args:
        option: `c3vd`, `c3vdv2`, `simcol3d`; [fx, fy, cx, cy] in pixels of the images; the path of a file
            (`docs/cameras.md` lists the formats); None or `none` if the camera is unknown.

    Raises:
        UserError: it is none of these.
    """
    if option is None or option == "none":
        return None
    if isinstance(option, list):
        if len(option) != 4 or min(option[:2]) <= 0:
            raise UserError(f"camera: expected [fx,fy,cx,cy] in pixels with fx, fy above 0, got {option}")
        return PinholeCamera.from_focal((0, 0), *option)
    if part := lenses().get(option):
        lens: Camera = part.build.lens()  # type: ignore[attr-defined]
        return lens
    if not Path(option).is_file():
        known = lenses()
        raise UserError(
            f"camera: {option!r} is no file and no known lens{nearest_name(option, known)}; "
            f"known are {', '.join(known)}, [fx,fy,cx,cy] for a pinhole, or none"
        )
    path = Path(option)
    return _read(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=16)
def _read(path: Path, version: int) -> Camera:
    """Read a camera file, cached by its version; print remarks about it once."""
    try:
        camera, remark = read_lens(path)
    except DataError as error:
        raise UserError(f"camera: {error}") from None
    if remark:
        print(f"camera: {path}: {remark}", flush=True)
    if camera.size_hw != (0, 0) and not bool((seen := camera.sees()).all()):
        share = 1 - seen.float().mean().item()
        print(
            f"camera: {path}: {share:.1%} of the pixels lie outside the image circle or 90 degrees and "
            "more off the axis, where z-depth is not defined; they do not count",
            flush=True,
        )
    return camera


def camera_at(lens: Camera, size_hw: tuple[int, int]) -> Camera:
    """Return the camera of images of a size, which must have the aspect ratio of the lens.

    Raises:
        DataError: the aspect ratio differs.
    """
    if lens.size_hw == (0, 0):
        camera = replace(lens, size_hw=size_hw)
        try:
            check_round_trip(camera)
        except ValueError as error:
            raise DataError(f"camera: {error}") from None
        return camera
    (height, width), (full_height, full_width) = size_hw, lens.size_hw
    if abs(height * full_width / (width * full_height) - 1) > SQUEEZE:
        raise DataError(
            f"camera: the lens is of {full_height} x {full_width} pixels and the image of {height} x "
            f"{width}, which is no enlargement of that; give the camera of these images: "
            "[fx,fy,cx,cy], a file, or none"
        )
    return lens.resized(size_hw)


def outside_image(camera: Camera) -> str:
    """Explain what a principal point outside of the image may mean; empty if it is inside."""
    (height, width), (u, v) = camera.size_hw, camera.centre
    if -0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5:
        return ""
    return (
        f"the principal point ({u:.6g}, {v:.6g}) lies outside of the image of {height} x {width} pixels: "
        "right for a piece cut out of a larger image, and else of numbers of another size"
    )


def view_of(option: CameraOption, size_hw: tuple[int, int]) -> Bool[Tensor, "1 h w"] | None:
    """Return the mask of pixels that a camera shows; None if it shows all, or that is unknown."""
    if isinstance(option, list) or option is None or option == "none":
        return None
    if part := lenses().get(option):
        shows = part.facts["view"]
        return None if shows is None else shows(size_hw)
    lens = lens_of(option)
    seen = None if lens is None else camera_at(lens, size_hw).sees()
    return None if seen is None or bool(seen.all()) else seen
