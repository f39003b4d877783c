"""`warpgrasp watch`: one page on the loopback, and the state that it asks for.

Python's own HTTP server, bound to 127.0.0.1. It answers to requests that name that host alone, so
that no page of another site can read it, knows two paths, and changes nothing.
"""

import sys
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import cast
from urllib.parse import parse_qs, urlsplit

from sweeps.analysis.entries import check_metric
from sweeps.output import note
from sweeps.spec.errors import StoreError
from sweeps.watch.page import content_policy, watch_page
from sweeps.watch.view import View

HOST = "127.0.0.1"


class Watcher(ThreadingHTTPServer):
    """Serves the state of one directory."""

    daemon_threads = True

    def __init__(self, folder: Path, port: int, metric: str) -> None:
        self.view = View(folder, metric)
        self.lock = threading.Lock()
        self.page = watch_page(self.view.plan.study.head.name or folder.resolve().name)
        super().__init__((HOST, port), Answer)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_address[1]}/"

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that has gone meanwhile is no error."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]

    def state_after(self, seen: str) -> str | None:
        """The state as JSON; None if its version has been seen."""
        with self.lock:
            self.view.state()
            return None if seen == str(self.view.version) else self.view.json()


class Answer(BaseHTTPRequestHandler):
    """The answer to one request."""

    server_version, sys_version = "warpgrasp", ""

    @property
    def watcher(self) -> Watcher:
        """The server that it belongs to."""
        return cast(Watcher, self.server)

    def do_GET(self) -> None:
        """Gives the page or the state."""
        asked = urlsplit(self.path)
        port = self.watcher.server_address[1]
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self._send(403, "text/plain", b"this page is for the browser of this machine\n")
        elif asked.path == "/":
            self._send(200, "text/html; charset=utf-8", self.watcher.page)
        elif asked.path == "/state.json":
            self._send_state(parse_qs(asked.query).get("seen", [""])[0])
        else:
            self._send(404, "text/plain", b"there is nothing here\n")

    def _send_state(self, seen: str) -> None:
        try:
            found = self.watcher.state_after(seen)
        except (StoreError, OSError) as error:
            self._send(503, "text/plain; charset=utf-8", str(error).encode())
            return
        if found is None:
            self._send(204, "application/json", b"")
        else:
            self._send(200, "application/json", found.encode())

    def _send(self, code: int, kind: str, content: bytes) -> None:
        self.send_response(code)
        for name, value in (("Content-Type", kind), ("Content-Length", str(len(content))),
                            ("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff"),
                            ("Referrer-Policy", "no-referrer"),
                            ("Content-Security-Policy", content_policy())):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: requests are no news."""


def watch(folder: Path, *, port: int, metric: str, opens: bool) -> int:
    """Serves the page until Ctrl-C. Raises StoreError for a directory without a study, or a port
    that is taken."""
    check_metric(metric)
    try:
        server = Watcher(folder, port, metric)
    except (OSError, OverflowError) as error:
        raise StoreError(f"--port: {port} cannot be used: {error}") from None
    with server:
        print(server.address, flush=True)
        note("open this address in a browser of this machine; Ctrl-C ends it, and nothing else")
        if opens:
            import webbrowser

            webbrowser.open(server.address)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0
