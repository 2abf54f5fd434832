"""A module in a process of its own, at the other end of a socket: native code may crash or hang.

Camera and mount have theirs elsewhere (``instruments/indi/indi_process.py``).
"""

import contextlib
import socket
import subprocess
import sys
from multiprocessing.connection import Connection

_CODE = "import sys; sys.path[:] = sys.argv[2:]; from {} import main; main(int(sys.argv[1]))"
_LEAVES_S = 5.0


class ChildProcess:
    """A process from its start to its end; a dead one is replaced by another object."""

    def __init__(self, module: str, *, is_group_of_its_own: bool = False) -> None:
        """Start ``main(socket_fd)`` of the module, which ends where the socket does.

        ``is_group_of_its_own``: Ctrl+C in the terminal does not reach it. Raises OSError.
        """
        ours, theirs = socket.socketpair()
        with ours, theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _CODE.format(module), str(theirs.fileno()), *sys.path],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                # Native code writes to whatever it likes; the terminal belongs to the console.
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=is_group_of_its_own,
            )
            self.connection = Connection(ours.detach())

    @property
    def pid(self) -> int | None:
        """Its number; None once it has ended."""
        return self._process.pid if self._process.poll() is None else None

    def end(self, grace_s: float = 0.0) -> int | None:
        """End it, and say with what status: with ``grace_s`` by itself, as its socket closes."""
        if grace_s > 0.0:
            self.connection.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
        self._process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_LEAVES_S)
        # Last, so that a thread that waits for an answer is woken by the end of the process.
        self.connection.close()
        return self._process.returncode
