"""Who may ask the page's server for what: pages of others in the same browser get nothing from it."""

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

NAMES = ("127.0.0.1", "localhost")
"""What this machine is called in an address; a tunnel to it may end at another port."""
FILES = ("/gradio_api/file", "/gradio_api/proxy")
ELSEWHERE = ("=http:", "=https:", "proxy=")
"""In a path, what would be fetched from another machine."""
FOR_ALL = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}
FOR_FILES = {"Content-Security-Policy": "default-src 'none'; sandbox"}
"""Whatever a visitor uploaded, a browser runs nothing of it."""


class Guard:
    """Middleware that answers requests only where Host and Origin are the page's own.

    A page of another site cannot read what is answered, but can post, and by pointing its own name at this
    machine (DNS rebinding) could read too: its name is then in Host.

    Args:
        app: what answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or refuse."""
        if scope["type"] not in ("http", "websocket"):  # the start and the end of the program
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
    """Why a request is not answered; empty where it is.

    Args:
        method: of HTTP.
        path: of the address, unquoted.
        headers: of the request.
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
