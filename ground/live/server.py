"""The console's page, served on this computer alone, to whoever has its token.

Only the loopback address is listened on. The address printed at the start carries a token drawn anew each time; it
becomes a cookie that other sites' pages cannot use, and requests that name another host or come from another origin
are refused, so that no page elsewhere can command a robot through somebody's browser. Nothing is fetched from the
network: the plotting library is the one in the `plotly` package.
"""

from __future__ import annotations

import hmac
import json
import secrets
import threading
from collections.abc import Callable
from functools import cache
from http import HTTPStatus
from http.cookies import SimpleCookie
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from plotly.offline import get_plotlyjs

from ground.live.sources import ConsoleError

HOST = "127.0.0.1"
COOKIE = "hopper_console"
PERIOD_S = 0.2
LARGEST_BODY = 4096
POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; frame-ancestors 'none'"
)
STATIC = {
    "/": ("console.html", "text/html; charset=utf-8"),
    "/console.js": ("console.js", "text/javascript; charset=utf-8"),
    "/plots.js": ("plots.js", "text/javascript; charset=utf-8"),
    "/console.css": ("console.css", "text/css; charset=utf-8"),
}


class Show(Protocol):
    """What the server serves (`ground.live.shows`)."""

    def about(self) -> dict[str, Any]:
        """What stays the same: title, kind, limits, phases."""

    def content(self, query: dict[str, float]) -> dict[str, Any]:
        """The console's state; `after`: samples after that time; `at`: as it stood at that time."""

    def series(self, low_s: float, high_s: float) -> dict[str, Any]:
        """The recorded lines between two times."""

    def command(self, name: str, arguments: dict[str, float]) -> None:
        """Send a command. Raises `ConsoleError`."""


class ConsoleServer(ThreadingHTTPServer):
    """Serves one show until it is closed. A context manager."""

    daemon_threads = True

    def __init__(self, show: Show, port: int = 0) -> None:
        super().__init__((HOST, port), _Handler)
        self.show = show
        self.token = secrets.token_urlsafe(24)
        self.closing = threading.Event()
        self._thread = threading.Thread(target=self.serve_forever, args=(0.1,), name="console", daemon=True)

    @property
    def address(self) -> str:
        """What to open in a browser; whoever has it can command the robot."""
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    def __enter__(self) -> ConsoleServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.closing.set()
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: ConsoleServer
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Pages, data, and the stream."""
        url = urlsplit(self.path)
        query = {key: values[-1] for key, values in parse_qs(url.query).items()}
        if not self._own_host():
            return self._refuse(HTTPStatus.FORBIDDEN, "this console answers to its own address only")
        if url.path == "/" and "token" in query:
            return self._enter(query["token"])
        if not self._known():
            return self._refuse(HTTPStatus.FORBIDDEN, "open the address that hopper console printed")
        actions: dict[str, Callable[[dict[str, str]], None]] = {
            "/about": lambda _: self._json(self.server.show.about()),
            "/state": lambda q: self._json(self.server.show.content(_numbers(q))),
            "/series": lambda q: self._json(self.server.show.series(float(q["low"]), float(q["high"]))),
            "/stream": self._stream,
            "/plotly.js": lambda _: self._bytes(_plotly(), "text/javascript; charset=utf-8"),
        }
        if url.path in STATIC:
            name, kind = STATIC[url.path]
            return self._bytes(files("ground.live").joinpath("static", name).read_bytes(), kind)
        if url.path not in actions:
            return self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        try:
            actions[url.path](query)
        except (KeyError, ValueError):
            self._refuse(HTTPStatus.BAD_REQUEST, "times are numbers of seconds")
        return None

    def do_POST(self) -> None:
        """A command."""
        own = f"http://{self.headers.get('Host', '')}"
        if not self._own_host() or not self._known() or self.headers.get("Origin") != own:
            return self._refuse(HTTPStatus.FORBIDDEN, "commands are taken from this console's own page only")
        if urlsplit(self.path).path != "/command":
            return self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")
        try:
            name, arguments = _command(self._body())
            self.server.show.command(name, arguments)
        except ConsoleError as error:
            return self._json({"sent": False, "why": str(error)}, HTTPStatus.CONFLICT)
        except (ValueError, KeyError, TypeError):
            return self._refuse(HTTPStatus.BAD_REQUEST, "a command is a name with arguments that are numbers")
        return self._json({"sent": True, "why": ""})

    def log_message(self, *_: object) -> None:
        """Requests are not worth a line each."""

    def _own_host(self) -> bool:
        """Whether the request names this server: another name may lead here, but not for an honest page."""
        port = self.server.server_port
        return self.headers.get("Host") in (f"{HOST}:{port}", f"localhost:{port}")

    def _known(self) -> bool:
        found = SimpleCookie(self.headers.get("Cookie", "")).get(COOKIE)
        return found is not None and hmac.compare_digest(found.value.encode(), self.server.token.encode())

    def _enter(self, token: str) -> None:
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return self._refuse(HTTPStatus.FORBIDDEN, "this token is of another console, or an earlier one")
        self.send_response(HTTPStatus.SEE_OTHER)
        self.send_header("Set-Cookie", f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/")
        self.send_header("Location", "/")
        return self._end(b"")

    def _stream(self, _: dict[str, str]) -> None:
        """The state again and again as server-sent events, each with the samples since the one before."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self.close_connection = True
        after_s = -1.0
        try:
            while not self.server.closing.is_set():
                content = self.server.show.content({"after": after_s})
                after_s = content["samples"][-1][0] if content["samples"] else after_s
                self.wfile.write(f"data: {json.dumps(content, allow_nan=False)}\n\n".encode())
                self.wfile.flush()
                self.server.closing.wait(PERIOD_S)
        except OSError:
            return  # the page was closed

    def _body(self) -> bytes:
        length = int(self.headers.get("Content-Length", "0"))
        if not 0 < length <= LARGEST_BODY:
            raise ValueError("body")
        return self.rfile.read(length)

    def _json(self, content: dict[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._bytes(json.dumps(content, allow_nan=False).encode(), "application/json", status)

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True  # what else was sent is not read
        self._bytes(f"{why}\n".encode(), "text/plain; charset=utf-8", status)

    def _bytes(self, data: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self._end(data)

    def _end(self, data: bytes) -> None:
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


def _numbers(query: dict[str, str]) -> dict[str, float]:
    return {key: float(value) for key, value in query.items()}


def _command(body: bytes) -> tuple[str, dict[str, float]]:
    """Name and arguments of a command. Raises `ValueError`, `KeyError` or `TypeError`."""
    content = json.loads(body)
    return str(content["name"]), {str(key): float(value) for key, value in content["arguments"].items()}


@cache
def _plotly() -> bytes:
    script: str = get_plotlyjs()
    return script.encode()
