"""Trees to measure against: this checkout, another one, or a commit's in a worktree."""

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]


@contextmanager
def tree_of(name: str) -> Iterator[Path]:
    """Folder of a checkout, or a worktree of a commit for as long as the context is open."""
    if Path(name).is_dir():
        yield Path(name).resolve()
        return
    git = ["git", "-C", str(HERE), "worktree"]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "tree"
        made = subprocess.run(
            [*git, "add", "--quiet", "--detach", str(folder), name],
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode:
            raise SystemExit(f"{name} is neither a folder nor a commit: {made.stderr.strip()}")
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=False)
