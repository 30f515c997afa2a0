"""Access control of the demo's server: pages of other sites in the same browser are refused."""

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

NAMES = ("127.0.0.1", "localhost")
"""Names of this machine in an address; the port may differ, because of a tunnel."""
FILES = ("/gradio_api/file", "/gradio_api/proxy")
ELSEWHERE = ("=http:", "=https:", "proxy=")
"""Parts of a path that would make the server fetch from another machine."""
FOR_ALL = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
FOR_FILES = {"Content-Security-Policy": "default-src 'none'; sandbox"}
"""Headers of uploaded files, so that a browser executes nothing in them."""


class Guard:
    """Middleware that refuses requests unless Host and Origin are those of the page.

    A page of another site cannot read responses, but can post; by pointing its own name at this machine (DNS
    rebinding) it could read, too, but its name is then in Host.

    Args:
        app: the application that answers requests.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or refuse it."""
        if scope["type"] not in ("http", "websocket"):  # start and shutdown events
            await self.app(scope, receive, send)
            return
        if reason := refusal(str(scope.get("method", "GET")), str(scope["path"]), Headers(scope=scope)):
            await PlainTextResponse(f"refused: {reason}\n", status_code=403)(scope, receive, send)
            return
        added = FOR_ALL | FOR_FILES if scope["path"].startswith(FILES) else FOR_ALL

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(added)
            await send(message)

        await self.app(scope, receive, with_headers)


def refusal(method: str, path: str, headers: Headers) -> str:
    """Return why a request is refused; empty if it is answered.

    Args:
        method: HTTP method.
        path: unquoted path of the address.
        headers: headers of the request.
    """
    host = headers.get("host", "")
    if host.rpartition(":")[0] not in NAMES and host not in NAMES:
        return "this page is of this machine alone, and its address begins with http://127.0.0.1"
    origin = headers.get("origin")
    if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
        return "a page of another address asks"
    foreign = headers.get("sec-fetch-site", "none") not in ("none", "same-origin")
    if foreign and not (method == "GET" and path == "/" and headers.get("sec-fetch-mode") == "navigate"):
        return "a page of another address asks"
    if path.startswith(FILES) and any(sign in path for sign in ELSEWHERE):
        return "nothing is fetched from other machines"
    return ""
