"""A Dataverse on this machine: lists files, redirects to them, and misbehaves as it is told."""

import hashlib
import io
import json
import re
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

DOI = "doi:10.7281/T1/JC64MK"


def zipped(files: Mapping[str, bytes], links: Mapping[str, str] | None = None) -> bytes:
    """An archive of these files."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        for name, target in (links or {}).items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o120777 << 16
            archive.writestr(entry, target)
    return content.getvalue()


@dataclass
class Dataverse:
    """What the server has, how it misbehaves, and what it was asked for."""

    files: dict[str, bytes] = field(default_factory=dict)
    checksums: dict[str, str] = field(default_factory=dict)
    """Wrong ones, by file; empty for none."""
    sizes: dict[str, int] = field(default_factory=dict)
    """Wrong ones, by file."""
    drops: list[int] = field(default_factory=list)
    """Bytes after which the next answers break off."""
    answers: list[tuple[int, dict[str, str]]] = field(default_factory=list)
    """Codes and headers with which the next requests for files are refused."""
    heeds_ranges: bool = True
    lists: bytes | None = None
    """Instead of the list of files."""
    slow: float = 0.0
    """Seconds before each 64 KiB."""
    ranges: list[str | None] = field(default_factory=list)
    """Of the requests for contents, in their order."""
    fetched: list[str] = field(default_factory=list)
    url: str = ""
    ended: threading.Event = field(default_factory=threading.Event)

    def listing(self) -> bytes:
        rows = []
        for number, (name, content) in enumerate(self.files.items()):
            value = self.checksums.get(name, hashlib.md5(content).hexdigest())
            file: dict[str, Any] = {
                "id": number,
                "filename": name,
                "filesize": self.sizes.get(name, len(content)),
            }
            if value:
                file |= {"md5": value, "checksum": {"type": "MD5", "value": value}}
            rows.append({"label": name, "restricted": False, "dataFile": file})
        version = {"files": rows, "license": {"name": "CC BY-NC-SA 4.0"}}
        return self.lists or json.dumps({"status": "OK", "data": {"latestVersion": version}}).encode()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_: Any) -> None:
        pass

    def do_GET(self) -> None:
        has: Dataverse = self.server.has  # type: ignore[attr-defined]
        if self.path == f"/api/datasets/:persistentId?persistentId={DOI}":
            self._send(200, has.listing(), {})
        elif found := re.fullmatch(r"/api/access/datafile/(\d+)", self.path):
            if has.answers:
                code, headers = has.answers.pop(0)
                self._send(code, b"{}", headers)
            else:
                self._send(303, b"", {"Location": f"{has.url}/bucket/{found[1]}?signed=1"})
        elif found := re.fullmatch(r"/bucket/(\d+)\?signed=1", self.path):
            name = list(has.files)[int(found[1])]
            self._content(has, name)
        else:
            self._send(404, b"{}", {})

    def _content(self, has: Dataverse, name: str) -> None:
        content, span = has.files[name], self.headers.get("Range")
        has.ranges.append(span)
        start, code, headers = 0, 200, {}
        if span and has.heeds_ranges:
            start = int(span.removeprefix("bytes=").removesuffix("-"))
            code, headers = 206, {"Content-Range": f"bytes {start}-{len(content) - 1}/{len(content)}"}
        has.fetched.append(name)
        self._send(code, content[start:], headers, has)

    def _send(self, code: int, body: bytes, headers: Mapping[str, str], has: Dataverse | None = None) -> None:
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        drop = has.drops.pop(0) if has and has.drops else None
        step = 1 << 16
        for at in range(0, len(body), step):
            chunk = body[at : at + step]
            if has and has.slow:
                has.ended.wait(has.slow)
            if drop is not None and at + len(chunk) > drop:
                self.wfile.write(chunk[: drop - at])
                self.wfile.flush()
                self.close_connection = True
                return
            self.wfile.write(chunk)


class _Quiet(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: Any) -> None:
        pass


@contextmanager
def served(has: Dataverse) -> Iterator[Dataverse]:
    """The server, for the time of the block."""
    server = _Quiet(("127.0.0.1", 0), _Handler)
    server.has = has  # type: ignore[attr-defined]
    has.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield has
    finally:
        has.ended.set()
        server.shutdown()
        server.server_close()
        thread.join()
