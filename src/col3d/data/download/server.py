"""Requests to a server that may be slow, busy or unreachable for a while, with retries."""

import http.client
import random
import socket
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from threading import Event
from typing import TypeVar

from col3d.errors import DataError

AGENT = "col3d"
Result = TypeVar("Result")
LONGEST_PAUSE = 60.0
"""Longest time in seconds between two attempts."""
BUSY = (
    HTTPStatus.REQUEST_TIMEOUT,
    HTTPStatus.TOO_MANY_REQUESTS,
    HTTPStatus.INTERNAL_SERVER_ERROR,
    HTTPStatus.BAD_GATEWAY,
    HTTPStatus.SERVICE_UNAVAILABLE,
    HTTPStatus.GATEWAY_TIMEOUT,
)
"""Answers after which a later attempt may succeed."""
DROPPED = (ConnectionError, TimeoutError, http.client.HTTPException, socket.gaierror)
HINTS: dict[int, str] = {
    HTTPStatus.FORBIDDEN: "; it may ask for a login or an agreement on its page",
    HTTPStatus.UNAUTHORIZED: "; it may ask for a login or an agreement on its page",
    HTTPStatus.NOT_FOUND: "; is the address, or the doi, another by now?",
}


class Interrupted(Exception):  # noqa: N818 - it is no error
    """The work has to end here; what was fetched is kept."""


class ServerError(DataError):
    """A server refuses a request, and a further attempt would not help."""


class BusyError(ServerError):
    """A server did not answer, dropped the connection, or is busy."""

    def __init__(self, text: str, pause: float | None = None) -> None:
        super().__init__(text)
        self.pause = pause
        """Seconds that the server asks to wait."""


@dataclass(frozen=True)
class Server:
    """Address of a server, and how to retry requests to it.

    Attributes:
        url: its root, such as https://archive.data.jhu.edu.
        timeout: seconds without a byte after which a connection counts as lost.
        attempts: number of attempts in a row that bring nothing new.
        pause: seconds before the second attempt, doubled before each further one.
        stop: set when all work has to end.
    """

    url: str
    timeout: float = 30.0
    attempts: int = 6
    pause: float = 1.0
    stop: Event = field(default_factory=Event)

    def open(self, path: str, headers: Mapping[str, str] | None = None) -> http.client.HTTPResponse:
        """Send a request and return the answer, redirects followed.

        Raises:
            BusyError: the server cannot be reached, or is busy.
            ServerError: it refuses.
        """
        url = self.url.rstrip("/") + path
        request = urllib.request.Request(url, headers={"User-Agent": AGENT, **(headers or {})})
        try:
            answer: http.client.HTTPResponse = urllib.request.urlopen(request, timeout=self.timeout)
        except urllib.error.HTTPError as error:
            error.close()
            text = f"{url}: the server answers {error.code} {error.reason}"
            if error.code in BUSY:
                raise BusyError(text, _seconds(error.headers.get("Retry-After"))) from None
            raise ServerError(text + HINTS.get(error.code, "")) from None
        except ssl.SSLError as error:
            raise ServerError(f"{url}: no safe connection ({error.reason})") from None
        except urllib.error.URLError as error:
            if isinstance(error.reason, ssl.SSLError):
                raise ServerError(f"{url}: no safe connection ({error.reason})") from None
            raise BusyError(f"{url}: cannot be reached ({_reason(error.reason)})") from None
        except DROPPED as error:
            raise BusyError(f"{url}: cannot be reached ({_reason(error)})") from None
        except ValueError as error:
            raise ServerError(f"{url}: not an address ({error})") from None
        return answer

    def read(self, path: str) -> bytes:
        """Read all of a short answer; it is requested again where the connection drops.

        Raises:
            ServerError: all attempts failed, or the server refuses.
        """

        def whole() -> bytes:
            with self.open(path) as answer:
                try:
                    return answer.read()
                except DROPPED as error:
                    raise BusyError(f"{self.url}: the connection broke ({_reason(error)})") from None

        return self.again(whole)

    def again(self, attempt: Callable[[], Result], progressed: Callable[[], bool] = lambda: False) -> Result:
        """Call `attempt`, and repeat it after a pause while the server is busy.

        Args:
            attempt: raises `BusyError` where another attempt may succeed.
            progressed: whether the last attempt brought something new, so that counting starts anew.

        Raises:
            ServerError: the last attempt failed.
            Interrupted: `stop` was set.
        """
        tried = 0
        while True:
            try:
                return attempt()
            except BusyError as error:
                tried = 1 if progressed() else tried + 1
                if tried >= self.attempts:
                    raise ServerError(f"{error}; tried {tried} times") from None
                if self.stop.wait(self._pause(tried) if error.pause is None else error.pause):
                    raise Interrupted from None

    def _pause(self, tried: int) -> float:
        return min(self.pause * 2 ** (tried - 1), LONGEST_PAUSE) * random.uniform(0.75, 1.25)


def _seconds(given: str | None) -> float | None:
    """Seconds that `Retry-After` requests, up to a limit; None for a date."""
    return min(float(given), LONGEST_PAUSE) if given is not None and given.isdigit() else None


def _reason(error: object) -> str:
    """Text of an error, or its class where it has none."""
    text = getattr(error, "strerror", None) or str(error)
    return text or type(error).__name__
