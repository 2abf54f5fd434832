"""The program's exceptions: for what is broken, with the remedy in the message.

An expected result (nothing detected, not solved) is a value and raises none of these.
"""

import contextlib
from collections.abc import Iterator


class RsoconsoleError(Exception):
    """Base of every error an operator may read: one line, what happened and what to do."""

    def _render_traceback_(self) -> list[str]:
        """Return what IPython and Jupyter show of it: the line alone (``%debug`` has the rest)."""
        return [f"{type(self).__name__}: {self}"]


@contextlib.contextmanager
def system_errors_as(kind: type[RsoconsoleError], words: str, remedy: str = "") -> Iterator[None]:
    """Context that turns an OSError into the error ``kind``.

    Its message: ``words``, the system's reason, ``remedy``, joined without spaces.
    """
    try:
        yield
    except OSError as error:
        raise kind(f"{words}{error.strerror or error}{remedy}") from error


@contextlib.contextmanager
def value_errors_as(
    kind: type[RsoconsoleError],
    words: str = "",
    caught: type[Exception] | tuple[type[Exception], ...] = ValueError,
) -> Iterator[None]:
    """Context that turns an error of the types ``caught`` into the error ``kind``.

    Its message: ``words``, then the message of the error caught.
    """
    try:
        yield
    except caught as error:
        raise kind(f"{words}{error}") from error


class ConfigError(RsoconsoleError):
    """The configuration cannot be used as written."""


class FrameError(RsoconsoleError):
    """A frame cannot be read or measured."""


class ModelError(RsoconsoleError):
    """The detector's network cannot be loaded."""


class SolverError(RsoconsoleError):
    """The plate solver cannot work at all (no index files, no process)."""


class InstrumentError(RsoconsoleError):
    """A camera, a mount or the INDI server did not do what was asked."""


class OrbitError(RsoconsoleError):
    """Orbital elements cannot be read or propagated."""


class SessionError(RsoconsoleError):
    """A session cannot be opened or written."""


class ExportError(RsoconsoleError):
    """A session cannot be exported as asked, or an exported file cannot be read."""


class ControlError(RsoconsoleError):
    """The engine cannot be reached or refused a command."""


class BatchError(RsoconsoleError):
    """Work over many sessions cannot be distributed over processes."""


class InputError(RsoconsoleError, ValueError):
    """A function was given an unusable argument: a unit, a shape, a time without a zone."""


class NotSolvedError(RsoconsoleError):
    """A frame that was to be solved has no plate solution; ``reason`` gives the cause."""

    def __init__(self, frame: str, reason: str, remedy: str = "") -> None:
        super().__init__(f"{frame} is not solved: {reason}{remedy}")
        self.frame = frame
        self.reason = reason
