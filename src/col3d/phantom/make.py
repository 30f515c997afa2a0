"""Rendering of a phantom's missing videos, several at a time."""

from pathlib import Path

from col3d.data.processes import in_processes
from col3d.data.whole_folder import remove_stale
from col3d.phantom.settings import PhantomSettings
from col3d.phantom.write import check_root, render_video, video_is_complete


def phantom_is_complete(root: Path, settings: PhantomSettings) -> bool:
    """Whether `root` holds every video of these settings, with all files complete."""
    return not _missing(root, settings)


def render_phantom(
    root: Path, settings: PhantomSettings, workers: int | None = None, progress: bool = True
) -> None:
    """Render the videos that `root` lacks; a partly rendered video is rendered again.

    Args:
        root: folder of the videos' folders; created if missing.
        settings: settings of the phantom; complete videos of the same settings are kept.
        workers: number of processes, by default that of cores; the files do not depend on it. More than one
            needs a main module that can be imported, as multiprocessing's `spawn` does.
        progress: whether to show a bar with the frames done and the time left.

    Raises:
        DataError: `root` holds other data or videos of other settings.
    """
    check_root(root, settings)
    root.mkdir(parents=True, exist_ok=True)
    remove_stale(root)
    videos = _missing(root, settings)
    in_processes(
        render_video,
        [(root, video, settings) for video in videos],
        "phantom",
        len(videos) * settings.frames_per_video,
        workers,
        progress,
    )


def _missing(root: Path, settings: PhantomSettings) -> list[str]:
    return [video for video in settings.videos if not video_is_complete(root / video, settings)]
