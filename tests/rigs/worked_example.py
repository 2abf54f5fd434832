"""A change that a page or a test describes, applied to a copy of the program and used there."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
Piece = tuple[str, str]
"""What stands there, and what stands there afterwards."""


def expect_used(
    folder: Path, example: Mapping[str, Sequence[Piece]], use: str, **environment: str
) -> None:
    """Apply the pieces by file, and run a script in that copy, which prints "used" at its end.

    Its argument is the project's own folder.
    """
    shutil.copytree(ROOT / "rsoconsole", folder / "rsoconsole")
    (folder / "models").symlink_to(ROOT / "models")
    for path, pieces in example.items():
        file = folder / path
        text = file.read_text(encoding="utf-8")
        for before, after in pieces:
            assert text.count(before) == 1, f"{path} has this not once: {before}"
            text = text.replace(before, after)
        file.write_text(text, encoding="utf-8")
    places = f"{folder}{os.pathsep}{ROOT}"
    run = subprocess.run(
        [sys.executable, "-c", use, str(ROOT)],
        env={**os.environ, "PYTHONPATH": places, **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.stdout.endswith("used\n"), run.stderr
