"""Unpacked size of an archive, before it is fetched."""

import io
import zipfile
from http import HTTPStatus

from col3d.data.download.listing import RemoteFile
from col3d.data.download.server import DROPPED, Server, ServerError

TAIL = 4 << 20
"""Bytes at the end of an archive that are read for its table of contents."""


class _Tail(io.RawIOBase):
    """The end of a file, presented to zipfile as the whole of it."""

    def __init__(self, content: bytes, size: int) -> None:
        self.content, self.start, self.size, self.at = content, size - len(content), size, 0

    def seekable(self) -> bool:
        return True

    def readable(self) -> bool:
        return True

    def tell(self) -> int:
        return self.at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self.at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self.at, io.SEEK_END: self.size}[whence]
        return self.at

    def read(self, size: int = -1) -> bytes:
        if self.at < self.start:
            raise OSError("before the end")
        end = self.size if size < 0 else min(self.at + size, self.size)
        content = self.content[self.at - self.start : end - self.start]
        self.at += len(content)
        return content


def unpacked_size(server: Server, file: RemoteFile) -> int | None:
    """Unpacked bytes of an archive, by its table of contents; None where the server does not tell."""
    start = max(file.size - TAIL, 0)
    if server.stop.is_set():
        return None
    try:
        with server.open(file.path, {"Range": f"bytes={start}-"}) as answer:
            if answer.status != HTTPStatus.PARTIAL_CONTENT and start:
                return None
            content = answer.read(TAIL)
        with zipfile.ZipFile(_Tail(content, file.size)) as archive:
            return sum(entry.file_size for entry in archive.infolist())
    except (ServerError, zipfile.BadZipFile, OSError, EOFError, *DROPPED):
        return None
