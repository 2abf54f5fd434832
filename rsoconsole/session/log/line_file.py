"""Append-only file of lines; each line is an independent JSON object.

Damage affects only the damaged lines: the next writer moves the damaged file aside, unchanged, and
continues with the readable lines. The first line states the format.
"""

import contextlib
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from rsoconsole.base import (
    SessionError,
    lock_file,
    parse_json,
    sync_folder,
    system_errors_as,
    write_durably,
)

_WAIT_S = 20.0
_MAX_BYTES = 200_000_000

Lines = Sequence[bytes]
Change = Mapping[str, Any]
"""A line to append, as a mapping; its key ``did`` names the kind of change."""


class LineFileState(Protocol):
    """State that results from all lines of a file."""

    @property
    def unreadable(self) -> tuple[int, ...]:
        """Numbers of the lines that cannot be read, from 1."""


F = TypeVar("F", bound=LineFileState)


@dataclass(frozen=True, slots=True, kw_only=True)
class LineFile:
    """A file of lines; it need not exist yet."""

    path: Path
    called: str
    """What messages call the file: "the ledger"."""
    format: int

    def lines(self) -> list[bytes]:
        """Read all lines; [] where there is no file. Raises SessionError."""
        with system_errors_as(SessionError, f"{self.called} {self.path} cannot be read: "):
            try:
                if self.path.stat().st_size > _MAX_BYTES:
                    raise SessionError(f"{self.path} is larger than any ledger: move it away")
                return self.path.read_bytes().split(b"\n")
            except FileNotFoundError:
                return []

    def append_changes(
        self, fold: Callable[["LineFile", Lines], F], step: Callable[[F], Sequence[Change]]
    ) -> tuple[F, Path | None]:
        """Append the changes that ``step`` returns for the present state.

        They are on the disk on return; the file is locked meanwhile. ``fold``: computes the state
        from the lines. Returns (the new state, path to which a damaged file was moved or None).
        Raises SessionError where another writer takes too long, and where the file cannot be
        written.
        """
        with system_errors_as(
            SessionError,
            f"{self.called} {self.path} cannot be written: ",
            "; free space there, or set its permissions",
        ):
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with _locked(self.path):
                lines = self.lines()
                before = fold(self, lines)
                changes = step(before)
                aside = self._moved_aside(lines, before.unreadable) if before.unreadable else None
                added = [json.dumps(each, allow_nan=False) for each in changes]
                if added:
                    self._append(added)
                return fold(self, self.lines()), aside

    def parse_lines(
        self, lines: Lines, take: Callable[[Mapping[str, Any]], None]
    ) -> tuple[int, ...]:
        """Parse the lines, and call ``take`` with each JSON object except the first line's.

        Returns the numbers, from 1, of the lines that cannot be read. ``take`` raises ValueError,
        KeyError or TypeError for an object that it does not accept. Raises SessionError for a file
        that a later version has written.
        """
        bad = []
        for place, line in enumerate(lines, start=1):
            if not line.strip():
                continue
            try:
                said = parse_json(line.decode("utf-8"))
                if not isinstance(said, dict):
                    raise TypeError("no object")
                if said["did"] != "begun":
                    take(said)
                elif isinstance(said["format"], int) and said["format"] > self.format:
                    raise SessionError(f"{self.called} is of a later rsoconsole: update this one")
            except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError):
                bad.append(place)
        return tuple(bad)

    @property
    def _begun(self) -> str:
        return json.dumps({"did": "begun", "format": self.format})

    def _append(self, added: Sequence[str]) -> None:
        """Append to the file, on the disk, behind a line's end whatever the last writer left."""
        is_new = not self.path.exists()
        head = f"{self._begun}\n" if is_new else ""
        with self.path.open("ab") as file:
            if not is_new and not self.path.read_bytes().endswith(b"\n"):
                head = "\n"
            file.write((head + "".join(f"{each}\n" for each in added)).encode())
            file.flush()
            os.fsync(file.fileno())
        if is_new:
            sync_folder(self.path.parent)

    def _moved_aside(self, lines: Lines, unreadable: Sequence[int]) -> Path:
        """Copy the damaged file, byte by byte, and replace it by its readable lines.

        Returns the path of the copy.
        """
        number = 1
        while (aside := self.path.with_name(f"{self.path.name}.damaged-{number}")).exists():
            number += 1
        write_durably(aside, b"\n".join(lines))
        bad = set(unreadable)
        good = [each for n, each in enumerate(lines, start=1) if n not in bad and each.strip()]
        write_durably(self.path, b"".join(each + b"\n" for each in good or [self._begun.encode()]))
        return aside


def damage_words(unreadable: Sequence[int], path: Path) -> str:
    """Return a sentence on the unreadable lines of a file; empty where there are none."""
    if not unreadable:
        return ""
    first, count = unreadable[0], len(unreadable)
    which = f"line {first}" if count == 1 else f"{count} lines, {first} the first,"
    return (
        f"{path}: {which} cannot be read; all others hold, and the file is moved aside as"
        " it is when something is kept next"
    )


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Lock by a file of its own: the file of lines is replaced where it is damaged."""
    try:
        lock = lock_file(path.with_suffix(".lock"), wait_s=_WAIT_S)
    except BlockingIOError as error:
        raise SessionError(
            f"another process has written {path} for {_WAIT_S:.0f} s: wait for it, or end it"
        ) from error
    try:
        yield
    finally:
        os.close(lock)
