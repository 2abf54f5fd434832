"""Checks whether rsoconsole can be installed here, in seconds, before anything is compiled.

``python3 rsoconsole/base/setup_check.py`` is the README's first command; the doctor uses it too.
Runs on a bare Python and imports nothing of the rest of the program.
"""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from pathlib import Path

APT_LINE = "sudo apt install git python3-venv python3-dev gcc"
"""Command that installs what a fresh Raspberry Pi OS (64 bit, Lite), Debian or Ubuntu lacks."""
OLDEST_PYTHON = (3, 11)
WHEEL_PYTHONS = ((3, 11), (3, 12), (3, 13))
"""Pythons for which PyPI has ``astrometry`` 4.3.0 compiled: for x86-64 with glibc alone."""
MACHINES = ("x86_64", "aarch64")
"""Architectures for which PyPI has every library except ``astrometry`` compiled."""
NEEDED_MB = 1500
"""Free disk for the virtual environment and what pip unpacks on the way to it, MB."""
_COMPILER_S = 60.0


@dataclass(frozen=True)
class Machine:
    """What the installation depends on: a machine and its Python."""

    python: "tuple[int, int]"
    machine: str
    """Architecture as ``uname -m`` gives it; a 64-bit kernel may carry a 32-bit system."""
    is_64_bit: bool
    is_glibc: bool
    has_venv: bool
    header_fault: str
    """Reason why code that includes Python.h cannot be compiled; empty: it can or need not be."""
    free_mb: int


def installation_faults(machine: Machine) -> "list[str]":
    """Return every fault that prevents an installation on this machine, each with its remedy."""
    if not machine.is_64_bit or machine.machine not in MACHINES or not machine.is_glibc:
        kind = f"{64 if machine.is_64_bit else 32}-bit system on {machine.machine}"
        libc = "" if machine.is_glibc else " without glibc"
        return [
            f"this is a {kind}{libc}: numpy, OpenCV, the INDI client and the network's runtime are "
            "published for 64-bit Linux with glibc on x86_64 and aarch64 alone. On a Raspberry Pi "
            "install the 64-bit system (in Raspberry Pi Imager: 'Raspberry Pi OS Lite (64-bit)')"
        ]
    found = []
    if machine.python < OLDEST_PYTHON:
        have, need = (".".join(map(str, each)) for each in (machine.python, OLDEST_PYTHON))
        found.append(
            f"this is Python {have}, {need} is needed: Debian 12, Raspberry Pi OS Bookworm, "
            "Ubuntu 24.04 and later have it"
        )
    if not machine.has_venv:
        found.append(f"Python's venv is not installed: {APT_LINE}")
    if machine.header_fault:
        found.append(f"{machine.header_fault}: {APT_LINE}")
    if machine.free_mb < NEEDED_MB:
        found.append(
            f"{machine.free_mb} MB are free on this disk, {NEEDED_MB} MB are needed: make room"
        )
    return found


def probe_machine(folder: Path) -> Machine:
    """Return this machine's facts for an installation into ``folder`` (virtual environment)."""
    machine = platform.machine()
    is_glibc = platform.libc_ver()[0] == "glibc"
    python = (sys.version_info[0], sys.version_info[1])
    return Machine(
        python=python,
        machine=machine,
        is_64_bit=sys.maxsize > 2**32,
        is_glibc=is_glibc,
        has_venv=all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")),
        header_fault=python_header_fault() if must_compile_astrometry(python, machine) else "",
        free_mb=shutil.disk_usage(folder).free // 1_000_000,
    )


def must_compile_astrometry(python: "tuple[int, int]", machine: str) -> bool:
    """True where pip must compile ``astrometry``, as PyPI has no wheel for this machine."""
    return machine != "x86_64" or python not in WHEEL_PYTHONS


def python_header_fault() -> str:
    """Return why C code that includes Python.h does not compile here; empty where it does."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return "there is no C compiler, and 'astrometry' is compiled on this machine"
    if shutil.which(compiler.split()[0]) is None:
        return f"the C compiler '{compiler}' does not run (CC names it, and it is not there)"
    with tempfile.TemporaryDirectory() as scratch:
        source = Path(scratch) / "probe.c"
        source.write_text("#include <Python.h>\n", encoding="ascii")
        include = [f"-I{sysconfig.get_paths()[name]}" for name in ("include", "platinclude")]
        try:
            done = subprocess.run(
                [*compiler.split(), *include, "-fsyntax-only", str(source)],
                capture_output=True,
                text=True,
                timeout=_COMPILER_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"the C compiler '{compiler}' does not run ({error})"
    if done.returncode == 0:
        return ""
    if "Python.h" in done.stderr:
        return "Python.h is missing, and 'astrometry' is compiled on this machine"
    said = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
    return f"the C compiler fails on Python.h ({said})"


def main() -> int:
    """Check this machine; return the exit status: 0 where rsoconsole can be installed, else 1.

    Every fault is printed on stderr.
    """
    machine = probe_machine(Path.cwd())
    found = installation_faults(machine)
    for fault in found:
        print(f"rsoconsole cannot be installed here yet: {fault}", file=sys.stderr)
    if found:
        return 1
    if must_compile_astrometry(machine.python, machine.machine):
        print("'astrometry' is compiled on this machine: pip is silent for some minutes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
