"""A folder that is made beside its place takes it, whole."""

import shutil
from pathlib import Path


def put_in_place(beside: Path, folder: Path) -> None:
    """Rename ``beside`` to ``folder``; what was there is gone only when the new one stands.

    Raises OSError.
    """
    if not folder.exists():
        beside.rename(folder)
        return
    gone = folder.with_name(f".{folder.name}.gone")
    shutil.rmtree(gone, ignore_errors=True)
    folder.rename(gone)
    beside.rename(folder)
    shutil.rmtree(gone, ignore_errors=True)
