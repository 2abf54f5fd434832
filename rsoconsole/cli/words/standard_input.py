"""Names of input files: as arguments, in a list, or ``-`` for standard input.

``-`` is a file's content on standard input, as for cat and wc; ``--files-from`` reads a list of
names, as for tar and rsync.
"""

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from rsoconsole.base import FrameError, RsoconsoleError

DASH = "-"
MAX_NAME_BYTES = 64 << 20
STDIN = "standard input"

FilesFromOption = Annotated[
    str | None,
    typer.Option(
        "--files-from",
        metavar="FILE",
        help="Take names from this file too, one a line or ended by zero bytes; - for standard"
        " input.",
    ),
]


class InputFiles:
    """Input files of a verb and their names for people; standard input is a temporary file."""

    def __init__(self, paths: Sequence[Path], place: Path | None) -> None:
        self.paths = [place if place and str(each) == DASH else each for each in paths]
        """Files to read; a file with the piped content in the place of ``-``."""
        self._place = place

    def name(self, path: Path) -> str:
        """Name of a path for people: as the user gave it."""
        return DASH if path == self._place else str(path)

    def name_standard_input(self, text: str) -> str:
        """Return ``text`` with the temporary file's path replaced by a name for standard input."""
        return text if self._place is None else text.replace(str(self._place), STDIN)


@contextlib.contextmanager
def open_input_files(paths: Sequence[Path]) -> Iterator[InputFiles]:
    """The input files; for ``-`` the content of standard input is kept in a temporary file.

    Errors raised inside the context name standard input in place of that file. Raises BadParameter
    for two ``-`` or where nothing is piped in, FrameError where the content cannot be kept.
    """
    dashes = sum(str(each) == DASH for each in paths)
    if not dashes:
        yield InputFiles(paths, None)
        return
    if dashes > 1:
        raise typer.BadParameter("standard input can be read once: give - once")
    _expect_pipe("-")
    folder = Path(tempfile.mkdtemp(prefix="rsoconsole-"))
    try:
        place = folder / DASH
        try:
            with place.open("wb") as stream:
                shutil.copyfileobj(sys.stdin.buffer, stream)
        except OSError as error:
            raise FrameError(
                f"{STDIN} cannot be kept in {folder} ({error.strerror}): set TMPDIR to a folder"
                " with room"
            ) from error
        files = InputFiles(paths, place)
        try:
            yield files
        except RsoconsoleError as error:
            error.args = (files.name_standard_input(str(error)),)
            raise
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def given_files(paths: Sequence[Path] | None, files_from: str | None) -> list[Path]:
    """The files of the command line, then those that the list ``files_from`` names.

    Empty for an empty list. Raises BadParameter where neither is given, for ``-`` given twice, and
    for a list that cannot be read.
    """
    found = list(paths or ())
    if files_from is not None:
        if files_from == DASH and any(str(each) == DASH for each in found):
            raise typer.BadParameter("standard input can be read once: a list, or a file")
        found += _names_in(files_from)
        if not found:
            return []  # as xargs -r: a list may be empty
    if not found:
        raise typer.BadParameter("name files, or a file that names them with --files-from")
    return found


def _names_in(source: str) -> list[Path]:
    hint = "--files-from"
    try:
        if source == DASH:
            _expect_pipe("--files-from -")
            content = sys.stdin.buffer.read(MAX_NAME_BYTES + 1)
        else:
            with Path(source).open("rb") as stream:
                content = stream.read(MAX_NAME_BYTES + 1)
    except OSError as error:
        raise typer.BadParameter(
            f"{source} cannot be read ({error.strerror})", param_hint=hint
        ) from error
    if len(content) > MAX_NAME_BYTES:
        raise typer.BadParameter("the list is longer than 64 MB", param_hint=hint)
    ends = b"\0" if b"\0" in content else b"\n"
    names = [each.removesuffix(b"\r") if ends == b"\n" else each for each in content.split(ends)]
    return [Path(os.fsdecode(each)) for each in names if each]


def _expect_pipe(what: str) -> None:
    if sys.stdin is None or sys.stdin.isatty():
        raise typer.BadParameter(f"nothing is piped in for {what}: 'cat FILE | rsoconsole ...'")
