"""A network of a test's own, for programs whose ports and sockets are fixed."""

import shutil
import subprocess
from collections.abc import Sequence

import pytest


def namespace_for(programs: Sequence[str], packages: str) -> list[str]:
    """The beginning of a command that runs in a network of its own; skips where it cannot be had.

    ``programs``: what it needs beside; ``packages``: where Debian has them.
    """
    missing = [each for each in (*programs, "unshare", "ip") if shutil.which(each) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: apt install {packages} util-linux iproute2")
    command = ["unshare", "--user", "--map-root-user", "--net"]
    if subprocess.run([*command, "true"], capture_output=True, check=False).returncode:
        pytest.skip("this system does not let users make a network namespace")
    return command
