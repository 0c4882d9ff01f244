"""The server of the app: this machine only, a secret in the address, one gate before every request."""

from __future__ import annotations

import errno
import hmac
import logging
import re
import secrets
import warnings
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import tornado.web
from bokeh.util.warnings import BokehUserWarning
from tornado import httputil
from tornado.escape import url_unescape

from stoop.extend.errors import StoopError
from stoop_app.places import inside, resolved
from stoop_app.uploads import Upload

ADDRESS: Final = "127.0.0.1"
FIRST_PORT: Final = 5010
TRIED: Final = 50  #: ports, from the first, where none is asked for
TOKEN_BYTES: Final = 24
MAX_PATH: Final = 4000  #: characters of the address of a request
MAX_MESSAGE: Final = 64 << 20  #: bytes of one message of a page; logs are uploaded otherwise
#: nothing is loaded from, sent to or framed by another place; `blob:` and `unsafe-eval` are what Bokeh and Panel need
PAGE_POLICY: Final = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' blob: {sockets}; object-src 'none'; "
    "base-uri 'self'; form-action 'self'; frame-ancestors 'self'"
)
#: a page that a verb wrote runs its scripts apart from the app, and reaches nothing
FILE_POLICY: Final = (
    "sandbox allow-scripts allow-downloads; default-src 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'none'; form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
)
ICON: Final = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16">'
    '<path d="M2 2 L14 6 L8 8 L6 14 Z" fill="#1f5fa8"/></svg>'
)
SHOWN: Final = (".html",)  #: endings of files that the browser shows; others are downloaded


def open_address(address: str) -> bool:
    """Open an address in the user's browser; return whether there is one."""
    try:
        return webbrowser.open(address)
    except (webbrowser.Error, OSError):
        return False


def odd(path: str) -> str:
    """Return why the path of a request names no place of the app; empty where it may name one."""
    place, _, query = path.partition("?")
    try:
        parts = url_unescape(place, None, plus=False).decode("utf-8").split("/")
        url_unescape(query, None, plus=False).decode("utf-8")
    except UnicodeDecodeError:
        return "the address is not UTF-8 text"
    if len(place) > MAX_PATH:
        return f"the address is longer than {MAX_PATH} characters"
    if (
        not "".join(parts).isprintable()
        or {"", "."} & {*parts[1:-1]}
        or ".." in {*re.split(r"[/\\]", "/".join(parts))}
    ):
        return "the address names no place of the app"
    return ""


class Gate(httputil.HTTPServerConnectionDelegate):
    """Lets a request pass that comes from this machine's address, this app's own pages, and names the secret.

    Pages, websockets and files are asked for alike, before any of them is looked up.
    """

    def __init__(self, application: Any, token: str, port: int) -> None:
        self.application, self._token = application, token
        self._hosts = {f"{name}:{port}" for name in (ADDRESS, "localhost")}
        self._origins = {f"http://{host}" for host in self._hosts}

    def start_request(
        self, server_conn: object, request_conn: httputil.HTTPConnection
    ) -> httputil.HTTPMessageDelegate:
        """Return what reads the request."""
        return _Gated(self, server_conn, request_conn)

    def on_close(self, server_conn: object) -> None:
        """Pass on that a connection has ended."""
        self.application.on_close(server_conn)

    def refusal(self, path: str, headers: httputil.HTTPHeaders) -> str:
        """Return why a request is refused; empty where it is not."""
        if headers.get("Host", "") not in self._hosts:
            return "this is not the address of the app"
        if any(origin not in self._origins for origin in headers.get_list("Origin")):
            return "the request comes from another page"
        given = path.partition("?")[0].split("/")[1:2]
        if not hmac.compare_digest("".join(given).encode(), self._token.encode()):
            return "the address lacks the key that stoop app printed; copy the whole address"
        return ""


class _Gated(httputil.HTTPMessageDelegate):
    """One request at the gate."""

    def __init__(self, gate: Gate, server_conn: object, request_conn: httputil.HTTPConnection) -> None:
        self._gate, self._server, self._connection = gate, server_conn, request_conn
        self._inside: httputil.HTTPMessageDelegate | None = None

    def headers_received(
        self,
        start_line: httputil.RequestStartLine | httputil.ResponseStartLine,
        headers: httputil.HTTPHeaders,
    ) -> Any:
        """Answer 403 or 400, or let the application read on."""
        path = start_line.path if isinstance(start_line, httputil.RequestStartLine) else ""
        why = self._gate.refusal(path, headers)
        code, reason = (403, "Forbidden") if why else (400, "Bad Request")
        why = why or odd(path)
        if not why:
            self._inside = self._gate.application.start_request(self._server, self._connection)
            return self._inside.headers_received(start_line, headers)
        body = f"{code}: {why}\n".encode()
        answer = httputil.HTTPHeaders(
            {
                "Content-Type": "text/plain; charset=utf-8",
                "Content-Length": str(len(body)),
                "Connection": "close",
            }
        )
        self._connection.write_headers(httputil.ResponseStartLine("HTTP/1.1", code, reason), answer, body)
        self._connection.finish()
        return None

    def data_received(self, chunk: bytes) -> Any:
        """Pass on a part of the body."""
        return None if self._inside is None else self._inside.data_received(chunk)

    def finish(self) -> None:
        """Pass on that the request is whole."""
        if self._inside is not None:
            self._inside.finish()

    def on_connection_close(self) -> None:
        """Pass on that the browser went away."""
        if self._inside is not None:
            self._inside.on_connection_close()


class Files(tornado.web.StaticFileHandler):
    """Gives out files of the folder, never one outside, whatever its name or link says."""

    def validate_absolute_path(self, root: str, absolute_path: str) -> str | None:
        """Return the path of a file that lies in the folder, links resolved."""
        try:
            place = resolved(inside(Path(root), absolute_path))
        except StoopError:
            raise tornado.web.HTTPError(404) from None
        if not place.is_file():
            raise tornado.web.HTTPError(404)
        return str(place)

    def compute_etag(self) -> None:
        """Give none: no answer is stored, and a large file need not be read twice."""

    def set_extra_headers(self, path: str) -> None:
        """Keep what is shown apart from the app, and what is not shown from being run."""
        self.set_header("Content-Security-Policy", FILE_POLICY)
        self.set_header("Cache-Control", "no-store")
        if Path(path).suffix.lower() not in SHOWN:
            self.set_header("Content-Disposition", "attachment")
            self.set_header("Content-Type", "application/octet-stream")


class Icon(tornado.web.RequestHandler):
    """The mark in the browser's tab."""

    def get(self) -> None:
        """Answer with a small drawing."""
        self.set_header("Content-Type", "image/svg+xml")
        self.finish(ICON)


class _Headers(tornado.web.OutputTransform):
    """Headers of every answer."""

    policy = PAGE_POLICY

    def transform_first_chunk(
        self, status_code: int, headers: httputil.HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, httputil.HTTPHeaders, bytes]:
        """Add them; a file has a policy of its own."""
        if "Content-Security-Policy" not in headers:
            headers["Content-Security-Policy"] = self.policy
        headers["X-Content-Type-Options"] = "nosniff"
        headers["Referrer-Policy"] = "no-referrer"  # the address holds the secret
        headers["Cross-Origin-Opener-Policy"] = "same-origin"
        headers["Cross-Origin-Resource-Policy"] = "same-origin"
        return status_code, headers, chunk


class Server:
    """The app on a port of this machine."""

    def __init__(self, folder: Path, page: Callable[[], Any], port: int | None, max_upload: int) -> None:
        """Take a port: the one asked for, else the first that is free.

        Raises `StoopError`: it is in use.
        """
        from panel.io.server import get_server

        for name in ("bokeh", "panel", "param", "tornado"):  # refused requests are no news; bugs are
            logging.getLogger(name).setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", category=BokehUserWarning)
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        patterns = [
            (r"/files/(.*)", Files, {"path": str(folder)}),
            (r"/favicon.ico", Icon),
            (r"/upload", Upload, {"folder": folder / "logs", "limit": max_upload}),
        ]
        candidates = [port] if port is not None else [*range(FIRST_PORT, FIRST_PORT + TRIED)]
        for candidate in candidates:
            try:
                self._server = get_server(
                    {"/": page}, port=candidate, address=ADDRESS, prefix=self.token, title="stoop",
                    extra_patterns=patterns, websocket_max_message_size=MAX_MESSAGE, index=None,
                    websocket_origin=[f"{ADDRESS}:{candidate}", f"localhost:{candidate}"],
                )  # fmt: skip
                break
            except OSError as error:
                if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                    raise
        else:
            which = f"port {port} is" if port is not None else f"the ports from {FIRST_PORT} are"
            raise StoopError(f"app: {which} in use; give another with --port N")
        self.port = int(self._server.port)
        application, http = self._server._tornado, self._server._http
        http.request_callback = Gate(application, self.token, self.port)
        sockets = " ".join(f"ws://{name}:{self.port}" for name in (ADDRESS, "localhost"))
        policy = PAGE_POLICY.format(sockets=sockets)
        application.add_transform(type("Headers", (_Headers,), {"policy": policy}))

    @property
    def address(self) -> str:
        """What the browser opens; whoever knows it may use the app."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    def run(self) -> None:
        """Serve until Ctrl-C; the runs go on."""
        import signal

        for ending in (signal.SIGINT, signal.SIGTERM):
            signal.signal(ending, lambda *_: self._server.io_loop.add_callback_from_signal(self.stop))
        self._server.start()
        self._server.io_loop.start()

    def stop(self) -> None:
        """End serving."""
        self._server.io_loop.stop()
