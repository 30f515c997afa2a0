"""The video to fuse: its folder, its frames and its lens."""

import os
from pathlib import Path

from col3d.data.datasets.c3vd import C3VD
from col3d.data.datasets.videos import canonical_name, described
from col3d.data.files.images import read_image
from col3d.errors import UserError
from col3d.inference.cameras import camera_at
from col3d.inference.options import FuseOptions
from col3d.registry import DATASETS


def video_of(options: FuseOptions) -> C3VD:
    """Open the frames of the video, with its lens at their size; without ground truth if it has no depth."""
    root, given, frames = _place(options.video)
    folder, entry, row = root / given, f"{given}{frames}", described(given)
    name = options.dataset if options.dataset != "auto" else row.data if row else C3VD.data
    kind: type[C3VD] = DATASETS[name].build  # type: ignore[assignment]
    if folder.is_dir():
        folder = kind.video_folders(root).get(canonical_name(given), folder)
    images, has_truth = kind.kinds["color"].find(folder), bool(kind.kinds["depth"].find(folder))
    if not images:
        raise UserError(f"video: {folder} is no folder of {kind.example}")
    if not has_truth and options.checkpoint is None:
        raise UserError(f"video: {folder} has no true depth; give checkpoint=PATH to fuse what it predicts")
    if not has_truth and options.scale == "median":
        raise UserError(f"scale: median needs true depth, and {folder} has none; take scale=none")
    height, width, _ = read_image(images[min(images)]).shape
    camera = camera_at(kind.lens(), (height, width))
    return kind(root, [entry], normals="none", camera=camera, truth=has_truth)


def _place(video: str) -> tuple[Path, str, str]:
    """Split a path into the folder of videos, the video's own folder name, and `:FIRST-LAST` or nothing.

    Raises:
        UserError: the folder has a name that no video can have.
    """
    above, slash, last = video.rpartition("/")
    name, colon, frames = last.partition(":")
    folder = Path(os.path.abspath(f"{above}{slash}{name}"))  # noqa: PTH100 - without ".."
    whole = folder.with_name(f"{folder.name}{colon}{frames}") if folder.name else folder
    if colon and not folder.is_dir() and whole.is_dir():
        raise UserError(f"video: {whole}: a colon begins the frames that are taken; rename the folder")
    if folder.is_dir() and (not folder.name or folder.name.startswith(".")):
        raise UserError(f"video: {folder} has no name, or a hidden one; name the folder of a video")
    return folder.parent, folder.name, f"{colon}{frames}"
