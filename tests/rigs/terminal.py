"""A real terminal of so many cells, with one program in it, as a window or an SSH line is."""

import contextlib
import fcntl
import os
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Mapping
from typing import Self

# The terminal becomes the program's own, so that its end is told to it (SIGHUP).
_OWN_TERMINAL = (
    "import fcntl, os, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    "os.execvp(sys.argv[1], sys.argv[1:])"
)
_ESCAPE = re.compile(
    r"\x1b(\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(\x07|\x1b\\)|[P_^][^\x1b]*\x1b\\|[^\[\]P_^])"
)
_ASKS_ATTRIBUTES = b"\x1b[c"
EVERY_S = 0.02
READS_S = 1.0
"""Time that an operator takes to read a question; what is typed before it is drawn is dropped."""


class Terminal:
    """A pseudo-terminal; ends its program when it is left."""

    def __init__(
        self,
        command: list[str],
        environment: Mapping[str, str],
        size: tuple[int, int] = (80, 24),
    ) -> None:
        """``size``: columns, lines."""
        self._master, slave = os.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self.begun_s = time.monotonic()
        # Who runs the tests may have said how wide its own terminal is: that is not this one.
        own = {k: v for k, v in environment.items() if k not in {"COLUMNS", "LINES"}}
        self.process = subprocess.Popen(
            [sys.executable, "-c", _OWN_TERMINAL, *command],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**own, "TERM": "xterm-256color", "COLORTERM": "truecolor"},
            start_new_session=True,
        )
        os.close(slave)
        self._plain, self._half = "", ""
        self._chunks: list[bytes] = []
        self.has_typed = False
        self._is_over = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self.hang_up()

    @property
    def text(self) -> str:
        """Everything written so far, without what only moves and paints."""
        return self._plain

    @property
    def written(self) -> bytes:
        """All of it, as it went down the line."""
        return b"".join(self._chunks)

    @property
    def raw(self) -> str:
        """The same as text, with everything that moves and paints."""
        return self.written.decode(errors="replace")

    def resize(self, columns: int, lines: int) -> int:
        """Make it another size; how long its text is at that moment."""
        known = len(self.text)
        fcntl.ioctl(self._master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        return known

    def shows(self, *words: str, since: int = 0) -> bool:
        """Whether all of these have been written, from a length of the text on."""
        text = self._plain
        return all(text.find(word, since) >= 0 for word in words)

    def press(self, keys: str) -> None:
        """Type these."""
        self.has_typed = True
        os.write(self._master, keys.encode())

    def kill(self) -> None:
        """kill -9 of the program alone."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def hang_up(self) -> None:
        """The line is lost: the system sends SIGHUP."""
        if not self._is_over:
            self._is_over = True
            self._thread.join()
            os.close(self._master)

    def _read(self) -> None:
        decoded = b""
        while not self._is_over:
            ready, _, _ = select.select([self._master], [], [], EVERY_S)
            if not ready:
                continue
            try:
                chunk = os.read(self._master, 65536)
            except OSError:
                # Nobody holds the other end any more.
                time.sleep(EVERY_S)
                continue
            self._chunks.append(chunk)
            if _ASKS_ATTRIBUTES in chunk:
                # As every terminal does: a plain one, without graphics of its own.
                os.write(self._master, b"\x1b[?62;22c")
            decoded += chunk
            with contextlib.suppress(UnicodeDecodeError):
                self._take(decoded.decode())
                decoded = b""

    def _take(self, written: str) -> None:
        """Add what was written to the text; a sequence cut in two waits for its other half."""
        pending, kept, at = self._half + written, "", 0
        while (begin := pending.find("\x1b", at)) >= 0:
            kept += pending[at:begin]
            whole = _ESCAPE.match(pending, begin)
            if whole is None:
                self._plain, self._half = self._plain + kept, pending[begin:]
                return
            at = whole.end()
        self._plain, self._half = self._plain + kept + pending[at:], ""
