"""The sample session that comes with the program, as a session of the user's own."""

import shutil
import tempfile
from pathlib import Path

from rsoconsole.errors import SessionError, said_as
from rsoconsole.resources import sample_resource

SAMPLE_NAME = "sample-intelsat-14"


def own_sample(root: Path) -> Path:
    """Its copy among the sessions under ``root``, made now where there is none yet.

    A copy, because what is derived from a session lies beside it. Raises SessionError.
    """
    folder = root / SAMPLE_NAME
    if (folder / "session.db").exists():
        return folder
    words = f"the sample session cannot be copied to {folder} ("
    with said_as(SessionError, words, "): make room there, or set session.root"):
        source = sample_resource()
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".sample-", dir=root) as scratch:
            made = Path(scratch) / SAMPLE_NAME
            shutil.copytree(source, made, ignore=shutil.ignore_patterns("branches"))
            for path in (made, *made.rglob("*")):
                # An installation may be read-only, the session is the user's.
                path.chmod(0o755 if path.is_dir() else 0o644)
            made.rename(folder)
    return folder
