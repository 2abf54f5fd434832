"""Runs a module in a process of its own, joined by a socket: native code may crash or hang there.

The processes of camera and mount are another class (``instruments/indi/indi_process.py``).
"""

import contextlib
import socket
import subprocess
import sys
from multiprocessing.connection import Connection

_CODE = "import sys; sys.path[:] = sys.argv[2:]; from {} import main; main(int(sys.argv[1]))"
_LEAVES_S = 5.0


class ChildProcess:
    """One process that runs a module; ``start`` replaces a process that has ended."""

    def __init__(self, module: str, *, is_group_of_its_own: bool = False) -> None:
        """``module``: defines ``main(socket_fd)``, which ends when the socket closes.

        ``is_group_of_its_own``: Ctrl+C in the terminal does not reach the process.
        """
        self._code, self._is_group_of_its_own = _CODE.format(module), is_group_of_its_own
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    @property
    def pid(self) -> int | None:
        """Process id of the living process; None where no process lives."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    @property
    def has_died(self) -> bool:
        """True where the process that ``start`` began has ended without a call of ``end``."""
        return self._process is not None and self.pid is None

    def start(self) -> Connection:
        """Return the parent's end of the socket; where no process lives, start one first.

        Raises OSError.
        """
        if self.pid is None or self._connection is None:
            self.end()
            ours, theirs = socket.socketpair()
            with ours, theirs:
                self._process = subprocess.Popen(
                    [sys.executable, "-c", self._code, str(theirs.fileno()), *sys.path],
                    pass_fds=(theirs.fileno(),),
                    stdin=subprocess.DEVNULL,
                    # Native code writes to whatever it likes; the terminal belongs to the console.
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=self._is_group_of_its_own,
                )
                self._connection = Connection(ours.detach())
        return self._connection

    def end(self, grace_s: float = 0.0) -> int | None:
        """End the process: close its socket, wait ``grace_s`` for it to exit, then kill it.

        ``grace_s`` 0: kill it at once. Returns the exit status; None where there was no process.
        """
        process, connection = self._process, self._connection
        self._process = self._connection = None
        if process is None or connection is None:
            return None
        if grace_s > 0.0:
            connection.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(grace_s)
        process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_LEAVES_S)
        # Last, so that a thread that waits for an answer is woken by the end of the process.
        connection.close()
        return process.returncode
