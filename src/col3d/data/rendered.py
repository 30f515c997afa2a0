"""Render missing videos of data sets that are rendered."""

from collections.abc import Iterable
from pathlib import Path

from col3d.data.datasets.videos import video_table
from col3d.data.options import SourceOptions
from col3d.data.whole_folder import check_replaceable
from col3d.phantom import PARTS, PhantomSettings, render_phantom
from col3d.phantom.options import PhantomOptions
from col3d.phantom.write import MANIFEST, video_is_complete
from col3d.registry import DATASETS


def is_rendered(source: SourceOptions) -> bool:
    """Whether missing videos of a data set are rendered."""
    rendered: bool = DATASETS[source.name].facts["rendered"]
    return rendered


def phantom_settings(
    source: SourceOptions, options: PhantomOptions, videos: Iterable[str] | None = None
) -> PhantomSettings:
    """Settings to render these videos, or all of them."""
    height, width = options.size
    requested = source.own.get("randomise", False)
    randomise = tuple(part for part in PARTS if requested is True or (requested and part in requested))
    return PhantomSettings(
        size_hw=(height, width),
        frames_per_video=options.frames_per_video,
        seed=options.seed,
        randomise=randomise,
        videos=tuple(video_table() if videos is None else videos),
    )


def render_missing(root: Path, settings: PhantomSettings, workers: int | None = None) -> None:
    """Render the missing videos of a phantom, unless foreign files are in the way of any of them.

    Raises:
        DataError: names the folder and the foreign file in it.
    """
    for video in settings.videos:
        if (root / video / MANIFEST).is_file() and not video_is_complete(root / video, settings):
            check_replaceable(root / video)
    render_phantom(root, settings, workers)
