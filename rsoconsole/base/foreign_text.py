"""Bounded reading of files of foreign origin: kind of file, size, depth of JSON and TOML.

Reading a pipe never ends, and the readers of JSON and TOML recurse at every bracket.
"""

import json
import os
import stat
import tomllib
from pathlib import Path
from typing import Any

MAX_BYTES = 8 << 20
"""Greatest size of a small file, bytes: far more than any configuration, keymap or card has."""
MAX_DATA_BYTES = 256 << 20
"""Greatest size of a data file, bytes: a whole catalogue of the sky, a season of measurements."""
TOO_DEEP = "its brackets are nested too deeply"


def read_foreign(path: Path, *, most_bytes: int = MAX_BYTES, encoding: str = "utf-8") -> str:
    """Return the text of a plain file of at most ``most_bytes``.

    Raises OSError (also for what is no plain file, and for what is larger) and UnicodeDecodeError.
    """
    # A pipe that nobody writes to would be waited for already when it is opened.
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError("it is no plain file")
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(f"it is larger than {most_bytes >> 20} MB")
    return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")


def read_private(path: Path, fault: type[Exception], remedy: str) -> list[str]:
    """Return the lines of a file that nobody else can read. Raises ``fault``, never with a line in
    it."""
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise fault(f"{path} can be read by others: 'chmod 600 {path}' first")
        lines = [line.strip() for line in read_foreign(path).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise fault(f"{path} cannot be read ({type(error).__name__}): {remedy}") from error
    return [line for line in lines if line]


def read_named_file(path: Path, fault: type[Exception], absent: str) -> str:
    """Return the text of a large file named by the user.

    Raises ``fault`` where it cannot be read; ``absent``: the remedy where it is not there.
    """
    try:
        return read_foreign(path, most_bytes=MAX_DATA_BYTES)
    except FileNotFoundError as error:
        raise fault(f"{path} does not exist: {absent}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise fault(f"{path} cannot be read: {error}") from error


def json_of(text: str | bytes) -> Any:
    """Parse JSON. Raises ValueError, also where it is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error


def toml_of(text: str) -> dict[str, Any]:
    """Parse TOML. Raises ValueError, also where it is nested too deeply."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error
