"""A wire between an engine and its observatory that can be made to lie, stall and break.

It notes by itself what the engine orders of the mount: where it sends it, and when it aborts.
"""

import contextlib
import re
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

_CHUNK_BYTES = 65536
_TAIL_BYTES = 4096
_SLEW = re.compile(
    rb'<newNumberVector[^>]*name=["\']EQUATORIAL_EOD_COORD["\'][^>]*>(.*?)</newNumberVector>', re.S
)
_ONE = re.compile(rb'<oneNumber[^>]*name=["\'](RA|DEC)["\'][^>]*>\s*([^<\s]+)\s*</oneNumber>')
_ABORT = re.compile(
    rb'<newSwitchVector[^>]*name=["\']TELESCOPE_ABORT_MOTION["\'][^>]*>.*?</newSwitchVector>', re.S
)
_UTC = re.compile(rb'timestamp=["\']([-0-9T:.]{19,})["\']')
_BLOB, _END_OF_BLOB = b"<setBLOBVector", b"</setBLOBVector>"
_CLOCK = b"Simulated Clock"
"""Who asks for this is the engine's time of day, which no real observatory sends by a wire."""
Spoil = Callable[[bytes], bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Slew:
    """One order to move that came out of the engine."""

    at_s: float
    """``time.monotonic()``."""
    utc: str
    """By the observatory's clock, as its last message had it; empty before the first."""
    ra_date_hours: float
    dec_date_deg: float


@dataclass(slots=True)
class Orders:
    """What the engine has asked of the mount."""

    slews: list[Slew] = field(default_factory=list)
    aborts_s: list[float] = field(default_factory=list)
    """``time.monotonic()`` when the last byte of each had come."""
    utc: str = ""
    """Of the observatory's last message."""

    def read(self, tail: bytes) -> bytes:
        """Take the whole orders out of a stream; what is left of it."""
        end = 0
        for found in _SLEW.finditer(tail):
            place = {name: float(value) for name, value in _ONE.findall(found[1])}
            self.slews.append(
                Slew(
                    at_s=time.monotonic(),
                    utc=self.utc,
                    ra_date_hours=place[b"RA"],
                    dec_date_deg=place[b"DEC"],
                )
            )
            end = max(end, found.end())
        for found in _ABORT.finditer(tail):
            self.aborts_s.append(time.monotonic())
            end = max(end, found.end())
        return tail[end:][-_TAIL_BYTES:]


class FaultyWire:
    """Hands on what an engine and its observatory say, as long as nobody spoils it."""

    def __init__(self, host: str, port: int) -> None:
        self._to = (host, port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.orders = Orders()
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._clocks: set[socket.socket] = set()
        self._opened: list[socket.socket] = []
        self._lock = threading.Lock()
        self._away_until_s = self._stalled_until_s = self._slow_until_s = 0.0
        self._spoils: list[Spoil] = []
        self._spoils_of_frames: list[Spoil] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._clocks.clear()
        self.cut()
        for each in self._opened:
            each.close()

    def cut(self, away_s: float = 0.0) -> None:
        """End every connection; for so long no other one is taken."""
        self._away_until_s = time.monotonic() + away_s
        with self._lock:
            pairs = [pair for pair in self._pairs if pair[0] not in self._clocks]
            self._pairs = [pair for pair in self._pairs if pair[0] in self._clocks]
        for each in (end for pair in pairs for end in pair):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def stall(self, for_s: float) -> None:
        """Nothing of the observatory arrives for so long; what the engine says goes through."""
        self._stalled_until_s = time.monotonic() + for_s

    def trickle(self, for_s: float) -> None:
        """Everything of the observatory comes in crumbs of a few bytes."""
        self._slow_until_s = time.monotonic() + for_s

    def spoil(self, spoil: Spoil) -> None:
        """Of the next bytes that come from the observatory something else is made."""
        self._spoils.append(spoil)

    def spoil_frame(self, spoil: Spoil) -> None:
        """Of the next bytes of a frame something else is made."""
        self._spoils_of_frames.append(spoil)

    def _accept(self) -> None:
        while True:
            try:
                near, _address = self._listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection(self._to, 5.0)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            for each in (near, far):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._pairs.append((near, far))
                self._opened += [near, far]
            for work in (self._hand_up, self._hand_down):
                threading.Thread(target=work, args=(near, far), daemon=True).start()

    def _hand_up(self, near: socket.socket, far: socket.socket) -> None:
        """Engine to observatory: never spoilt."""
        tail = b""
        if time.monotonic() < self._away_until_s:  # nobody is there, and hangs up at once
            near.close()
            far.close()
            return
        with contextlib.suppress(OSError):
            while chunk := near.recv(_CHUNK_BYTES):
                far.sendall(chunk)
                if _CLOCK in tail + chunk:
                    self._clocks.add(near)
                tail = self.orders.read(tail + chunk)
        with contextlib.suppress(OSError):
            far.shutdown(socket.SHUT_WR)

    def _hand_down(self, near: socket.socket, far: socket.socket) -> None:
        """Observatory to engine."""
        tail, is_frame = b"", False
        with contextlib.suppress(OSError):
            while chunk := far.recv(_CHUNK_BYTES):
                if near in self._clocks:
                    near.sendall(chunk)
                    continue
                window = tail + chunk
                is_frame = is_frame or _BLOB in window
                if not is_frame and (times := _UTC.findall(window)):
                    self.orders.utc = times[-1].decode()
                if is_frame and self._spoils_of_frames:
                    chunk = self._spoils_of_frames.pop(0)(chunk)
                if self._spoils:
                    chunk = self._spoils.pop(0)(chunk)
                if is_frame and _END_OF_BLOB in window:
                    is_frame = False
                tail = window[-len(_END_OF_BLOB) :]
                self._send_down(near, chunk)
        with contextlib.suppress(OSError):
            near.shutdown(socket.SHUT_WR)

    def _send_down(self, near: socket.socket, chunk: bytes) -> None:
        while (left_s := self._stalled_until_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 0.05))
        while chunk and time.monotonic() < self._slow_until_s:
            near.sendall(chunk[:7])
            chunk = chunk[7:]
            time.sleep(0.002)
        near.sendall(chunk)
