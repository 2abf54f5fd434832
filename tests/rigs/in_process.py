"""The program as a shell sees it, run in the process of the tests: its start costs nothing."""

import contextlib
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TextIO

import pytest
from typer.testing import CliRunner

from rsoconsole.cli import main

PROGRAM = Path(sys.executable).with_name("rsoconsole")


def run_here(
    *arguments: str | Path, stdin: bytes | TextIO = b"", stderr: TextIO | None = None
) -> subprocess.CompletedProcess[str]:
    """Its exit code, and what it wrote into pipes; ``stdin`` or ``stderr`` may be a terminal."""
    words = [str(PROGRAM), *map(str, arguments)]
    code: str | int | None = 0
    with (
        CliRunner().isolation(stdin if isinstance(stdin, bytes) else b"") as (out, err, _),
        _log_as_found(),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(sys, "argv", words)
        if not isinstance(stdin, bytes):
            patch.setattr(sys, "stdin", stdin)
        if stderr is not None:
            patch.setattr(sys, "stderr", stderr)
        try:
            main()
        except SystemExit as ended:
            code = ended.code
        sys.stdout.flush()
        sys.stderr.flush()
        said = out.getvalue().decode(), err.getvalue().decode()
    return subprocess.CompletedProcess(words, int(code or 0), *said)


@contextlib.contextmanager
def environment_of(environment: Mapping[str, str], folder: Path) -> Iterator[None]:
    """These variables and no others, and this working folder."""
    before, here = dict(os.environ), Path.cwd()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", None)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(here)
            os.environ.clear()
            os.environ.update(before)


@contextlib.contextmanager
def _log_as_found() -> Iterator[None]:
    """The program opens its log at each start."""
    root = logging.getLogger()
    level, handlers = root.level, list(root.handlers)
    try:
        yield
    finally:
        root.setLevel(level)
        for each in [one for one in root.handlers if one not in handlers]:
            root.removeHandler(each)
            each.close()
