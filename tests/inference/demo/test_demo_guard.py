"""The page's server answers its own page alone, and serves nothing of a visitor's as a page."""

import http.client
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest
from served import served, upload
from starlette.datastructures import Headers

from col3d.inference.demo.guard import refusal

pytestmark = pytest.mark.end_to_end

UPLOAD = "/gradio_api/upload"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served("shipped", tmp_path_factory.mktemp("served")) as address:
        yield address


def asked(
    address: str, path: str, method: str = "GET", **headers: str
) -> tuple[int, http.client.HTTPMessage, bytes]:
    """Status, headers and content of an answer."""
    connection = http.client.HTTPConnection(address.removeprefix("http://"), timeout=30)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


@pytest.mark.parametrize("path", ["/", "/config", "/gradio_api/info", "/gradio_api/queue/data"])
@pytest.mark.parametrize("host", ["elsewhere.test", "127.0.0.1.elsewhere.test:7860", "", "10.0.0.7:7860"])
def test_a_foreign_host_is_refused(address: str, path: str, host: str) -> None:
    status, _, content = asked(address, path, Host=host)
    assert (status, content[:8]) == (403, b"refused:")


@pytest.mark.parametrize("method", ["POST", "GET", "DELETE"])
@pytest.mark.parametrize(
    "origin", ["http://elsewhere.test", "null", "http://127.0.0.1:1", "http://localhost"]
)
def test_a_foreign_origin_is_refused(address: str, method: str, origin: str) -> None:
    status, _, content = asked(address, UPLOAD, method, Origin=origin)
    assert (status, content[:8]) == (403, b"refused:")


def test_a_page_of_others_asks_without_an_origin(address: str) -> None:
    for path in ("/config", "/gradio_api/info"):
        assert asked(address, path, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="no-cors")[0] == 403
    link = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate"}
    assert asked(address, "/", **link)[0] == 200
    assert asked(address, "/config", **link)[0] == 403


def test_the_page_itself_is_answered(address: str) -> None:
    port = address.rpartition(":")[2]
    assert asked(address, "/", Origin=address, Sec_Fetch_Site="same-origin")[0] == 200
    assert asked(address, "/config", Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200
    tunnel = "localhost:9000"
    assert asked(address, "/config", Host=tunnel, Origin=f"http://{tunnel}")[0] == 200


@pytest.mark.parametrize("name", ["a.html", "a.htm", "a.svg", "a.xhtml", "a.xml", "a.js", "a", "a.png"])
def test_an_upload_is_never_a_page(address: str, name: str) -> None:
    path = upload(address, name, b"<script>alert(1)</script>")
    for more in ({}, {"Range": "bytes=0-5"}):
        status, headers, _ = asked(address, f"/gradio_api/file={quote(path)}", **more)
        assert status in (200, 206)
        kind = headers["Content-Type"]
        assert kind == ("image/png" if name == "a.png" else "application/octet-stream")
        assert headers["Content-Disposition"].startswith("inline" if name == "a.png" else "attachment")
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "sandbox" in headers["Content-Security-Policy"]


def test_no_file_but_its_own_and_none_of_other_machines(address: str) -> None:
    for path in (__file__, "/etc/passwd", "http://127.0.0.1:1/x", "https://elsewhere.test/x.png"):
        assert asked(address, f"/gradio_api/file={quote(path, safe='/:')}")[0] == 403
    assert asked(address, "/gradio_api/proxy=https://elsewhere.test/x")[0] == 403


def test_only_addresses_of_this_machine_are_named(tmp_path: Path) -> None:
    assert refusal("GET", "/", Headers({"host": "localhost:7860"})) == ""
    assert refusal("GET", "/", Headers({"host": "[::1]:7860"}))
    assert refusal("GET", "/", Headers({}))
