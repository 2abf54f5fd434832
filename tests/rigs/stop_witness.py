"""An independent witness of STOP: a wire in between, and an ear of its own at the mount."""

import contextlib
import socket
import threading
import time
from typing import Self

from rsoconsole.base import InstrumentError
from rsoconsole.instruments import IndiWire
from rsoconsole.simulator.launch import Observatory
from tests.rigs.whole_engine import wait_for

_ABORT, _END_OF_ABORT = b"TELESCOPE_ABORT_MOTION", b"</newSwitchVector>"
_BLOB, _END_OF_BLOB = b"<setBLOBVector", b"</setBLOBVector>"
_CHUNK_BYTES = 65536
FAR_RA_HOURS, FAR_DEC_DEG = 290.0 / 15.0, 8.0
NEAR_RA_HOURS, NEAR_DEC_DEG = 250.0 / 15.0, -5.0


class Witness:
    """Hands on what an engine and its observatory say, and notes when certain bytes passed.

    Times are ``time.monotonic()``, which all processes of a machine share. A frame is handed on
    so slowly that there is time to do something while it arrives.
    """

    def __init__(self, observatory: Observatory, frame_s: float = 0.0) -> None:
        self._to = (observatory.host, observatory.port)
        self._frame_s = frame_s
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._sockets: list[socket.socket] = []
        self.aborts_s: list[float] = []
        """When the last byte of each ABORT had come from the engine."""
        self.frames_begun_s: list[float] = []
        self.frames_ended_s: list[float] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def frame_begins(self) -> None:
        """Wait for the next frame's first bytes."""
        seen = len(self.frames_begun_s)
        wait_for(lambda: len(self.frames_begun_s) > seen, "a frame that begins to arrive")

    def frame_ends(self) -> None:
        """Wait for the next frame's last bytes."""
        seen = len(self.frames_ended_s)
        wait_for(lambda: len(self.frames_ended_s) > seen, "a frame that has arrived")

    def _accept(self) -> None:
        while True:
            try:
                near, _address = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(self._to)
            for each in (near, far):
                each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._sockets += [near, far]
            for work in (self._hand_up, self._hand_down):
                threading.Thread(target=work, args=(near, far), daemon=True).start()

    def _hand_up(self, near: socket.socket, far: socket.socket) -> None:
        """Engine to observatory."""
        tail = b""
        with contextlib.suppress(OSError):
            while chunk := near.recv(_CHUNK_BYTES):
                far.sendall(chunk)
                tail += chunk
                while (begin := tail.find(_ABORT)) >= 0:
                    end = tail.find(_END_OF_ABORT, begin)
                    if end < 0:
                        break
                    self.aborts_s.append(time.monotonic())
                    tail = tail[end:]
                else:
                    tail = tail[-len(_ABORT) :]
        with contextlib.suppress(OSError):
            far.shutdown(socket.SHUT_WR)

    def _hand_down(self, near: socket.socket, far: socket.socket) -> None:
        """Observatory to engine; frames in ten pieces with a pause between them."""
        tail, is_frame = b"", False
        with contextlib.suppress(OSError):
            while chunk := far.recv(_CHUNK_BYTES):
                window = tail + chunk
                if not is_frame and _BLOB in window:
                    is_frame = True
                    self.frames_begun_s.append(time.monotonic())
                    near.sendall(chunk[: len(chunk) // 2])
                    time.sleep(self._frame_s)
                    near.sendall(chunk[len(chunk) // 2 :])
                else:
                    near.sendall(chunk)
                if is_frame and _END_OF_BLOB in window:
                    is_frame = False
                    self.frames_ended_s.append(time.monotonic())
                tail = window[-len(_END_OF_BLOB) :]
        with contextlib.suppress(OSError):
            near.shutdown(socket.SHUT_WR)


class Ear:
    """A plain connection straight to the mount: moves it, and notes whether it moves."""

    def __init__(self, observatory: Observatory) -> None:
        self._device = observatory.mount_name
        self._orders = IndiWire(observatory.host, observatory.port)
        self._listening = IndiWire(observatory.host, observatory.port)
        self._listening.ask(self._device)
        self.heard: list[tuple[float, bool]] = []
        """(time.monotonic(), whether it moves), as the mount says."""
        self._is_over = False
        self._is_far = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join()
        self._orders.close()
        self._listening.close()

    def slew(self) -> None:
        """Send the mount 40 deg away by hand, and wait until it moves."""
        self._is_far = not self._is_far
        ra_hours, dec_deg = (
            (FAR_RA_HOURS, FAR_DEC_DEG) if self._is_far else (NEAR_RA_HOURS, NEAR_DEC_DEG)
        )
        since_s = time.monotonic()
        self._orders.new(
            "Number",
            self._device,
            "EQUATORIAL_EOD_COORD",
            {"RA": repr(ra_hours), "DEC": repr(dec_deg)},
        )
        wait_for(
            lambda: any(at_s >= since_s and moves for at_s, moves in self.heard), "motion", 10.0
        )

    def ended_s(self, since_s: float, timeout_s: float = 20.0) -> float:
        """When the mount first said, after an instant, that it stands."""
        return float(
            wait_for(
                lambda: next(
                    (at_s for at_s, moves in self.heard if at_s >= since_s and not moves), None
                ),
                "the end of motion",
                timeout_s,
            )
        )

    def _listen(self) -> None:
        with contextlib.suppress(InstrumentError):
            while not self._is_over:
                vector = self._listening.wait(lambda v: v.name == "EQUATORIAL_EOD_COORD", 0.2)
                if vector is not None:
                    self.heard.append((time.monotonic(), vector.state == "Busy"))
