"""A web server on this machine that answers as tests say, badly where they say so."""

import gzip
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

Behaviour = Callable[[BaseHTTPRequestHandler], None]


@dataclass
class BadServer:
    """What it was asked, and what it does for a path (its query aside)."""

    url: str = ""
    asked: list[str] = field(default_factory=list)
    bodies: list[bytes] = field(default_factory=list)
    logins: list[str | None] = field(default_factory=list)
    behaviours: dict[str, Behaviour] = field(default_factory=dict)
    default: Behaviour | None = None


@contextmanager
def bad_server() -> Iterator[BadServer]:
    """One such, on a port of its own, until the block ends."""
    told = BadServer()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            told.asked.append(self.path)
            told.logins.append(self.headers.get("Authorization"))
            size = int(self.headers.get("Content-Length", 0))
            told.bodies.append(self.rfile.read(size))
            behave = told.behaviours.get(self.path.partition("?")[0], told.default)
            try:
                (behave or status(404))(self)
            except (BrokenPipeError, ConnectionResetError):
                self.close_connection = True

        do_POST = do_GET  # noqa: N815 - http.server's own name

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    told.url = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield told
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def send(body: bytes, kind: str = "application/json", **headers: str) -> Behaviour:
    """A whole answer."""

    def behave(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.send_header("Content-Type", kind)
        for name, value in {"Content_Length": str(len(body)), **headers}.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.end_headers()
        handler.wfile.write(body)

    return behave


def send_gzip(body: bytes) -> Behaviour:
    """The same as servers pack it."""
    return send(gzip.compress(body), Content_Encoding="gzip")


def status(code: int, body: bytes = b"no", **headers: str) -> Behaviour:
    """A refusal, a fault, a way on."""

    def behave(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(code)
        for name, value in {"Content_Length": str(len(body)), **headers}.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.end_headers()
        handler.wfile.write(body)

    return behave


def cut_off(body: bytes, promised: int) -> Behaviour:
    """Less than its head promises."""

    def behave(handler: BaseHTTPRequestHandler) -> None:
        send(body, Content_Length=str(promised))(handler)
        handler.close_connection = True

    return behave


def drip(seconds: float) -> Behaviour:
    """A byte now and then, never to an end."""

    def behave(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.end_headers()
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            handler.wfile.write(b" ")
            handler.wfile.flush()
            time.sleep(0.05)

    return behave


def endless(chunk: bytes, most: int) -> Behaviour:
    """More than anybody wants."""

    def behave(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.end_headers()
        for _ in range(most // len(chunk)):
            handler.wfile.write(chunk)
        handler.close_connection = True

    return behave
