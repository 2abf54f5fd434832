"""Claim of a process to a mount: a file in the user's runtime folder.

A mount's process that outlives its engine watches the mount until another process claims the mount.
Processes of other users or on other machines are not noticed.
"""

import contextlib
import os
import re
import time
from pathlib import Path

from rsoconsole.base import ConfigError
from rsoconsole.config import runtime_dir


class MountOwner:
    """One process's claim to one mount."""

    def __init__(self, host: str, port: int, device: str, folder: Path | None = None) -> None:
        """Describe the mount; ``folder`` None: the user's runtime folder."""
        self._name = re.sub(r"[^\w.-]+", "_", f"mount-{host}-{port}-{device}") + ".owner"
        self._folder = folder
        self._token = f"{os.getpid()} {time.time_ns()}"
        self._path: Path | None = None

    @property
    def has_claimed(self) -> bool:
        """True once this process has written its claim."""
        return self._path is not None

    def claim(self) -> None:
        """Write the claim of this process; only once, and only where there is a runtime folder."""
        if self._path is not None:
            return
        with contextlib.suppress(OSError, ConfigError):
            path = (self._folder or runtime_dir()) / self._name
            fresh = path.with_suffix(f".{os.getpid()}")
            fresh.write_text(self._token, encoding="utf-8")
            fresh.replace(path)
            self._path = path

    def is_ours(self) -> bool:
        """Return True while this process holds the claim; a missing claim file does not end it."""
        if self._path is None:
            return False
        try:
            return self._path.read_text(encoding="utf-8") == self._token
        except OSError:
            return True

    def release(self) -> None:
        """Remove this process's claim."""
        if self._path is not None and self.is_ours():
            self._path.unlink(missing_ok=True)
        self._path = None
