"""Whether a file of weights is as it was saved, and holds numbers."""

import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

from torch import Tensor

from col3d.whole import BUFFER


def check_archive(path: Path) -> None:
    """Hold every byte of what torch.save writes against the sums that are stored with it.

    Files of other formats have no sums, and pass.

    Raises:
        ValueError: names the file and what in it has changed.
    """
    if not zipfile.is_zipfile(path):
        return
    try:
        with path.open("rb", buffering=BUFFER) as file, zipfile.ZipFile(file) as archive:
            damaged = archive.testzip()
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, ValueError, OSError) as error:
        raise ValueError(f"{path} is damaged ({' '.join(str(error).split())[:120]}); copy it again") from None
    if damaged is not None:
        raise ValueError(f"{path} is damaged, {damaged} in it has changed; copy it again")


def check_finite(tensors: Mapping[str, Tensor]) -> None:
    """Refuse weights that are no numbers.

    Raises:
        ValueError: names the first of them.
    """
    for name, values in tensors.items():
        if isinstance(values, Tensor) and values.is_floating_point() and not bool(values.isfinite().all()):
            raise ValueError(f"{name} is not finite: the file is damaged, or its training diverged")
