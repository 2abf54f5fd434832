"""The exceptions of the program: broken things, with the remedy in the message.

Expected results (nothing detected, not solved) are values, never one of these.
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
    """Raise an operating system's error as one of ours: its reason between both texts."""
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
    """Raise a fault of a text or a value as an error of ours, after ``words``."""
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
    """Raised when work over many sessions cannot be shared out."""


class InputError(RsoconsoleError, ValueError):
    """A function was given an unusable argument: a unit, a shape, a time without a zone."""


class NotSolvedError(RsoconsoleError):
    """A frame that was to be solved has no plate solution; ``reason`` gives the cause."""

    def __init__(self, frame: str, reason: str, remedy: str = "") -> None:
        super().__init__(f"{frame} is not solved: {reason}{remedy}")
        self.frame = frame
        self.reason = reason
