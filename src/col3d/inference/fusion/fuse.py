"""`col3d fuse`: surfaces of a whole video, from true and from predicted depth, and their comparison."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.coverage_mesh import COVERAGE_MESH, CoverageMesh, read_coverage_mesh
from col3d.data.processes import frames_bar
from col3d.data.resize import Resize
from col3d.errors import DataError, UserError
from col3d.geometry import Camera
from col3d.inference.fusion.frames import (
    FAR_OFF,
    FusionFrame,
    chosen_frames,
    median_scale,
    poses_of,
    seen_frames,
)
from col3d.inference.fusion.video import video_of
from col3d.inference.options import FuseOptions
from col3d.inference.predictor import Predictor, load_predictor
from col3d.inference.trained_network import SIZE
from col3d.io.json_files import write_json
from col3d.io.ownership import Owned
from col3d.registry.refusals import check_options
from col3d.reports.fusion import print_fusion, write_fusion_page
from col3d.reports.scenes import Cloud, Scene, error_colours, thinned
from col3d.runs.environment import check_accelerator, quiet
from col3d.runs.known_failures import as_user_errors
from col3d.runs.provenance import provenance
from col3d.signals import StopSignals, stoppable

if TYPE_CHECKING:
    from col3d.inference.fusion import Surface

SHOWN = 60_000
"""Number of points of a surface in the page."""
SUMMARY, PAGE = "fusion.json", "fusion.html"
WRITTEN = (PAGE, SUMMARY, "truth.ply", "predicted.ply", "error.ply")


def fuse(given: Mapping[str, Any]) -> None:
    """Fuse a video and compare the surfaces.

    Args:
        given: the composed configuration as plain values; see `FuseOptions`.

    Raises:
        UserError: an option breaks a rule, a file is missing or broken, or Open3D is not installed.
    """
    quiet()
    options = check_options(FuseOptions, given)
    check_accelerator(options.accelerator)
    _check_open3d()
    try:
        with (
            as_user_errors("frames=50 fuses fewer frames, voxel=1 in larger steps, far=60 less of them"),
            stoppable(f"the same command begins anew; nothing new is in {options.output}") as stop,
        ):
            _fuse(options, stop)
    except DataError as error:
        raise UserError(str(error)) from None


def _fuse(options: FuseOptions, stop: StopSignals) -> None:
    output = _checked_room(options)
    frames = video_of(options)
    poses = poses_of(frames, options.poses)
    network = _network(options)
    wall = _wall(frames)
    height, width = network.size_hw if network else options.size or SIZE
    resize = Resize((height, width), frames.camera)
    chosen = chosen_frames(frames, poses, options.frames)
    seen = list(seen_frames(frames, chosen, poses, resize, network))
    camera = resize.resized_camera
    summary: dict[str, Any] = {"video": options.video, "frames": len(seen), "voxel_mm": options.voxel}
    surfaces = {}
    if frames.with_truth:
        surfaces["truth"] = surface_of("truth", seen, [frame.depth for frame in seen], camera, options)
    if network is not None:
        factor = median_scale(seen) if options.scale == "median" else 1.0
        summary |= {"model": network.name, "checkpoint": options.checkpoint, "scale": factor}
        depths = [frame.predicted * factor for frame in seen if frame.predicted is not None]
        surfaces["prediction"] = surface_of("prediction", seen, depths, camera, options)
    summary["comparisons"] = _compared(surfaces, wall, options.voxel)
    if wall is not None:
        summary["seen_faces"] = None if wall.observed is None else [len(wall.seen), len(wall.triangles)]
    stop.hold()  # for the seconds in which the files are written
    _write(output, summary, surfaces)
    stop.pending = None  # ignore a signal that came after the work was done


def _write(output: Path, summary: dict[str, Any], surfaces: Mapping[str, "Surface"]) -> None:
    """Write all files, in place of an earlier fusion."""
    owned = Owned(output, "fusion", "output")
    owned.remove()
    owned.claim(*WRITTEN)
    clouds = []
    if truth := surfaces.get("truth"):
        truth.write(output / "truth.ply")
        clouds.append(_cloud("true depth", truth))
    if predicted := surfaces.get("prediction"):
        predicted.write(output / "predicted.ply")
        shown = None
        if truth:
            shown = error_colours(truth.distance(predicted.vertices), FAR_OFF)
            predicted.write(output / "error.ply", shown)
        clouds.append(_cloud("prediction", predicted, shown))
    scene = Scene(Path(summary["video"]).name, tuple(clouds), FAR_OFF, from_camera=False)
    write_fusion_page(output / PAGE, summary, scene)
    write_json(output / SUMMARY, {**summary, **provenance()})
    print_fusion(summary, [output / name for name in WRITTEN if (output / name).exists()])


def _check_open3d() -> None:
    """Refuse to start if Open3D, or a system library that it loads, is missing."""
    try:
        import_module("open3d")
    except ImportError as error:
        raise UserError(
            f"col3d fuse needs Open3D ({error}): pip install -e '.[fusion]', and on Debian "
            "apt-get install libusb-1.0-0"
        ) from None


def _network(options: FuseOptions) -> Predictor | None:
    if options.checkpoint is None:
        return None
    predictor = load_predictor(Path(options.checkpoint), options.published, options.max_depth, options.size)
    predictor.place(options.accelerator)
    return predictor


def _checked_room(options: FuseOptions) -> Path:
    """Return the output folder, after checking that no other files would be replaced."""
    output = Path(options.output)
    if output.exists() and not output.is_dir():
        raise UserError(f"output: {output} is a file; name a folder")
    owned = Owned(output, "fusion", "output")
    owned.check(WRITTEN)
    if SUMMARY in owned.existing() and not options.overwrite:
        raise UserError(f"output: {output} holds a fusion already; name another folder or overwrite=true")
    return output


def surface_of(
    name: str, seen: Sequence[FusionFrame], depths: Sequence[Tensor], camera: Camera, options: FuseOptions
) -> "Surface":
    """Fuse the pixels in the masks of all frames, with the given depths, into a surface."""
    from col3d.inference.fusion import Volume

    if not any(frame.mask.any() for frame in seen):
        raise DataError("video: no frame has a pixel of known depth")
    volume = Volume(options.voxel)
    with frames_bar(f"fuse the {name}") as bar:
        for frame, depth in bar.track(list(zip(seen, depths, strict=True))):
            near = frame.mask if options.far is None else frame.mask & (depth < options.far)
            volume.add(depth, near, frame.image, camera, frame.pose)
    surface = volume.surface()
    if not len(surface.triangles):
        raise DataError(f"the {name} gives no surface; is voxel={options.voxel} too small, or far= too near?")
    return surface


def _wall(frames: C3VD) -> CoverageMesh | None:
    """Read the data set's own mesh of the colon wall; None if there is none."""
    path = frames.folders[frames.frames[0].video] / COVERAGE_MESH
    if not path.is_file():
        return None
    mesh = read_coverage_mesh(path)
    if mesh.observed is None:
        print(f"note: {COVERAGE_MESH} does not say which faces were observed; all of them count", flush=True)
    return mesh


def _compared(
    surfaces: Mapping[str, "Surface"], wall: CoverageMesh | None, spacing: float
) -> dict[str, dict[str, float]]:
    """Make all possible comparisons, by name; completeness counts only observed faces."""
    from col3d.inference.fusion import Surface, compare

    comparisons = {}
    if surfaces.keys() == {"truth", "prediction"}:
        both = compare(surfaces["prediction"], surfaces["truth"], spacing)
        comparisons["prediction to fused truth"] = both.summary()
    if wall is not None:
        whole, seen = (Surface(wall.vertices, triangles) for triangles in (wall.triangles, wall.seen))
        for name, surface in surfaces.items():
            comparisons[f"{name} to {COVERAGE_MESH}"] = compare(surface, whole, spacing, seen).summary()
    return comparisons


def _cloud(name: str, surface: "Surface", error: np.ndarray | None = None) -> Cloud:
    """Thin a surface's vertices out to a cloud for the page."""
    kept = thinned(len(surface.vertices), SHOWN)
    assert surface.colours is not None
    return Cloud(name, surface.vertices[kept], surface.colours[kept], None if error is None else error[kept])
