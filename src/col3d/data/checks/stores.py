"""Check that stores of prepared frames are undamaged."""

import re
from pathlib import Path

from col3d.data.cache import read_video
from col3d.data.cache.index import INDEX
from col3d.data.checks.findings import Finding
from col3d.errors import DataError


def stores_beside(root: Path) -> list[Path]:
    """Folders of prepared frames, of any size, where `col3d prepare` puts them by default."""
    root = root.absolute()
    named = re.compile(rf"{re.escape(root.name)}_\d+x\d+")
    folders = sorted(path for path in root.parent.iterdir() if named.fullmatch(path.name))
    return [path for path in folders if next(path.glob(f"*/{INDEX}"), None)]


def check_store(store: Path, fast: bool) -> list[Finding]:
    """Check every stored video: its index, its arrays' lengths and, unless `fast`, each of their bytes.

    Args:
        store: folder of the stored videos.
        fast: whether to skip reading the arrays to the end.
    """
    if not store.is_dir():
        return [Finding("store", f"{store}: no such folder of prepared frames")]
    folders = sorted(path for path in store.iterdir() if path.is_dir() and not path.name.startswith("."))
    faults = [fault for folder in folders for fault in _check_video(folder, fast)]
    if faults:
        return faults
    looked_at = "their beginnings and lengths" if fast else "every byte"
    text = f"{store}: {len(folders)} prepared videos, undamaged by {looked_at}"
    return [Finding("store", text, fault=False)]


def _check_video(folder: Path, fast: bool) -> list[Finding]:
    video = read_video(folder)
    if video is None:
        return [Finding("store", f"{folder}: expected a prepared video, got no index that can be read")]
    try:
        video.check()
        damaged = [] if fast else video.damaged()
    except (DataError, OSError) as error:
        return [Finding("store", str(error))]
    again = "its bytes are not those that were written; delete its folder and run col3d prepare again"
    return [Finding("store", f"{path}: a store's array is damaged: {again}") for path in damaged]
