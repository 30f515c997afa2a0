"""Writing of a phantom's videos in the format of C3VD's current release, each complete or not at all."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float64

from col3d.data.datasets.coverage_mesh import COVERAGE_MESH, write_coverage_mesh
from col3d.data.datasets.videos import seeded_name, video_table
from col3d.data.whole_folder import whole_folder
from col3d.errors import DataError
from col3d.phantom.anatomy import build_colon
from col3d.phantom.appearance import LOOKS
from col3d.phantom.coverage import Coverage
from col3d.phantom.render import Frame, Renderer
from col3d.phantom.segments import SEGMENTS
from col3d.phantom.settings import PhantomSettings, phantom_camera, random_stream
from col3d.phantom.shading import Mucosa
from col3d.phantom.trajectory import camera_poses

MANIFEST = "phantom.json"
VERSION = 4
"""Version of the renderer, raised whenever equal settings give other pixels or files."""
UNCOMPRESSED = (cv2.IMWRITE_TIFF_COMPRESSION, 1)
FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1)


def render_video(
    root: Path, video: str, settings: PhantomSettings, frame_done: Callable[[], None] = lambda: None
) -> None:
    """Render one video into a temporary folder, which is put in place when it is complete.

    Args:
        root: folder of the videos' folders.
        video: name of the video in C3VD, with or without a seed.
        settings: settings of the phantom.
        frame_done: called after each frame.
    """
    with whole_folder(root / video) as partial:
        _write_frames(partial, video, settings, frame_done)
        write_manifest(partial, video, settings)


def _write_frames(
    folder: Path, video: str, settings: PhantomSettings, frame_done: Callable[[], None]
) -> None:
    scene = scene_of(video, settings)
    coverage, previous = Coverage(scene.renderer.colon), None
    for number, pose in enumerate(scene.poses):
        frame, hits = scene.renderer.frame(pose, previous, scene.random(number))
        coverage.add(hits.triangle)
        _write_frame(folder, number, frame)
        frame_done()
        previous = pose
    lines = scene.poses.transpose(0, 2, 1).reshape(-1, 16)  # C3VD's p_world = [p, 1] @ M is the transpose
    np.savetxt(folder / "pose.txt", lines, fmt="%.9g", delimiter=",")
    write_coverage_mesh(folder / COVERAGE_MESH, coverage.mesh())


@dataclass(frozen=True)
class Scene:
    """The scene of a video: renderer, poses and noise."""

    renderer: Renderer
    poses: Float64[np.ndarray, "n 4 4"]
    random: Callable[[int], np.random.Generator]
    """Function from a frame's number to the source of its sensor noise."""


def scene_of(video: str, settings: PhantomSettings) -> Scene:
    """Build the scene of a video: its colon, the surface and the trajectory."""
    origin, seed = seeded_name(video, settings.seed)
    row, trajectory = video_table()[origin], origin.rsplit("_", 1)[1]
    family, look = SEGMENTS[row.segment], LOOKS[row.texture]
    look = look.varied(settings.randomise, lambda part: random_stream(seed, origin, part))
    shape, free = random_stream(seed, row.segment, trajectory), "anatomy" in settings.randomise
    if free:
        shape = random_stream(seed, origin, "anatomy")
        family = family.varied(shape)
    colon = build_colon(family, shape)
    mucosa = Mucosa(colon, look.tissue, random_stream(seed, origin, "surface"))
    poses = camera_poses(colon, settings.frames_per_video, random_stream(seed, origin, "way"), free)
    renderer = Renderer(colon, mucosa, look, phantom_camera(settings))
    return Scene(renderer, poses, lambda number: random_stream(seed, origin, number))


def _write_frame(folder: Path, number: int, frame: Frame) -> None:
    _write_image(folder / f"{number:04d}_color.png", frame.color[..., ::-1], FAST)
    _write_image(folder / f"{number:04d}_occlusion.png", frame.occlusion, FAST)
    if frame.flow is not None:
        _write_image(folder / f"{number:04d}_flow.tiff", frame.flow[..., ::-1], UNCOMPRESSED)
    _write_image(folder / f"{number:04d}_depth.tiff", frame.depth, UNCOMPRESSED)
    _write_image(folder / f"{number:04d}_normals.tiff", frame.normals[..., ::-1], UNCOMPRESSED)


def _write_image(path: Path, pixels: np.ndarray, options: tuple[int, ...]) -> None:
    if not cv2.imwrite(str(path), np.ascontiguousarray(pixels), options):
        raise OSError(f"{path}: could not be written")


def write_manifest(folder: Path, video: str, settings: PhantomSettings) -> None:
    """Write the manifest with the folder's files and settings; it is written last."""
    files = {path.name: path.stat().st_size for path in sorted(folder.iterdir())}
    recipe = recipe_of(settings)
    manifest = {"video": video, "hash": recipe_hash(recipe), "settings": recipe, "files": files}
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1), encoding="utf-8")


def recipe_of(settings: PhantomSettings) -> dict[str, Any]:
    """Return the settings that determine the bytes of a video, by name."""
    recipe = json.loads(json.dumps({"version": VERSION, **asdict(settings)}))  # as JSON reads it back
    del recipe["videos"]
    return recipe


def recipe_hash(recipe: dict[str, Any]) -> str:
    """Compute a short hash of a recipe."""
    return hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Read the manifest of a video's folder; None if it is missing or broken."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    kinds = {"video": str, "hash": str, "settings": dict, "files": dict}
    known = isinstance(manifest, dict) and all(isinstance(manifest.get(k), t) for k, t in kinds.items())
    return manifest if known else None


def video_is_complete(folder: Path, settings: PhantomSettings) -> bool:
    """Whether a folder holds a video of these settings, with all files at their full size."""
    manifest = read_manifest(folder)
    if manifest is None or manifest["hash"] != recipe_hash(recipe_of(settings)):
        return False
    paths = {folder / name: size for name, size in manifest["files"].items()}
    return all(path.is_file() and path.stat().st_size == size for path, size in paths.items())


def check_root(root: Path, settings: PhantomSettings) -> None:
    """Refuse a folder that holds other folders than videos of these settings.

    Raises:
        DataError: names the folder, what differs and what to do.
    """
    if root.exists() and not root.is_dir():
        raise DataError(f"{root}: expected a folder for the phantom, got a file; choose another data.root")
    folders = sorted(p for p in root.glob("[!.]*") if p.is_dir() and any(p.iterdir()))
    for folder in folders:
        if not (folder / MANIFEST).is_file():
            raise DataError(
                f"{root}: {folder.name} has no {MANIFEST}, so it is not a phantom's and stays untouched; "
                "choose another data.root"
            )
        _check_recipe(root, folder, recipe_of(settings))


def _check_recipe(root: Path, folder: Path, recipe: dict[str, Any]) -> None:
    manifest = read_manifest(folder)
    if manifest is None or manifest["settings"] == recipe:
        return
    rendered = manifest["settings"]
    differing = [name for name in recipe if rendered.get(name) != recipe[name]]
    listed = ", ".join(f"{name} is {rendered.get(name)}, not {recipe[name]}" for name in differing)
    raise DataError(
        f"{root}: {folder.name} was rendered with other settings ({listed}); "
        "choose another data.root or delete this one"
    )
