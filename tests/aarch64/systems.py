"""Debian systems for ARM in folders, made by debootstrap and run by QEMU in a chroot.

Each has what Raspberry Pi OS Lite brings beside Debian's own base: Python, sudo, the certificates
and an ordinary user with a home. Needs root, debootstrap and qemu-user-static.
"""

import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

MIRROR = "http://deb.debian.org/debian"
USER = "owner"
CPUS = {"aarch64": "cortex-a72", "arm": "cortex-a7"}
"""What a Raspberry Pi 4 has, and a Pi 2: the emulator of 32 bits knows no A72."""
_BASE = "ca-certificates,procps,python3,sudo"
_BINFMT = Path("/proc/sys/fs/binfmt_misc")
_CERTIFICATES = Path("/etc/ssl/certs/ca-certificates.crt")
_INSIDE_CERTIFICATES = "/etc/ssl/certs/of-the-host.crt"
_ENTER = """
set -e
root=$0
mount --rbind /proc "$root/proc"
# Else programs in there read what processor the host has.
mount --bind "$root/etc/cpuinfo" "$root/proc/cpuinfo"
mount --rbind /sys "$root/sys"; mount --rbind /dev "$root/dev"
mount --bind "$1" "$root/home/owner/.cache/pip"
shift
exec chroot "$root" "$@"
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One system to be made."""

    name: str
    suite: str
    architecture: str
    emulator: str
    """As binfmt_misc and qemu-user-static call it."""


KINDS = {
    kind.name: kind
    for kind in (
        Kind(name="bookworm", suite="bookworm", architecture="arm64", emulator="aarch64"),
        Kind(name="trixie", suite="trixie", architecture="arm64", emulator="aarch64"),
        Kind(name="bookworm-32", suite="bookworm", architecture="armhf", emulator="arm"),
    )
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What a command in a system came to."""

    status: int
    seconds: float
    out: str
    error: str


class System:
    """One freshly made system; everything in it happens as its ordinary user."""

    def __init__(self, kind: Kind, folder: Path) -> None:
        """Make it in ``folder``: the base once, a copy of it each time."""
        self.kind = kind
        self.root = folder / f"{kind.name}-run"
        self.wheels = folder / f"{kind.name}-pip"
        """pip's own cache, kept from run to run: what was compiled once is not compiled again."""
        base = folder / kind.name
        _register(kind.emulator)
        if not (base / "home" / USER).exists():
            _bootstrap(kind, base)
        if self.root.exists():
            shutil.rmtree(self.root)
        subprocess.run(["cp", "-a", "--reflink=auto", base, self.root], check=True)
        shutil.copy("/etc/resolv.conf", self.root / "etc" / "resolv.conf")
        shutil.copy(_CERTIFICATES, self.root / _INSIDE_CERTIFICATES.lstrip("/"))
        (self.root / "etc" / "cpuinfo").write_text(_cpuinfo(os.cpu_count() or 1))
        self.wheels.mkdir(exist_ok=True)
        owner = self.home().stat()
        self.home(".cache", "pip").mkdir(parents=True)
        for folder_of_owner in (self.wheels, self.home(".cache"), self.home(".cache", "pip")):
            os.chown(folder_of_owner, owner.st_uid, owner.st_gid)

    def home(self, *parts: str) -> Path:
        """A path in the user's home as this machine sees it."""
        return self.root.joinpath("home", USER, *parts)

    def run(self, script: str, *, folder: str = "", log: Path | None = None) -> Done:
        """Run a script by bash as the user, in a folder of the home, without a terminal."""
        inside = (
            f"cd ~/{folder} && export QEMU_CPU={CPUS[self.kind.emulator]} LANG=C.UTF-8"
            f" PIP_CERT={_INSIDE_CERTIFICATES} PIP_DISABLE_PIP_VERSION_CHECK=1"
            f" PIP_DEFAULT_TIMEOUT=300 PIP_LOG=$HOME/pip.log\n"
        )
        command = ["su", "-", USER, "-c", f"exec bash -euo pipefail -c {_quoted(inside + script)}"]
        started_s = time.monotonic()
        done = subprocess.run(
            ["unshare", "--mount", "bash", "-c", _ENTER, self.root, self.wheels, *command],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            env={"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
            | {"QEMU_CPU": CPUS[self.kind.emulator], "TERM": "dumb"},
        )
        seconds = time.monotonic() - started_s
        if log is not None:
            with log.open("a", encoding="utf-8") as lines:
                lines.write(f"$ {script}\n{done.stdout}{done.stderr}\n")
        return Done(
            status=done.returncode, seconds=seconds, out=done.stdout, error=done.stderr.strip()
        )


def _cpuinfo(cores: int) -> str:
    """``/proc/cpuinfo`` of a Cortex-A72 r0p3 as Linux prints it."""
    lines = (
        "BogoMIPS\t: 108.00",
        "Features\t: fp asimd evtstrm crc32 cpuid",
        "CPU implementer\t: 0x41",
        "CPU architecture: 8",
        "CPU variant\t: 0x0",
        "CPU part\t: 0xd08",
        "CPU revision\t: 3",
    )
    each = ("\n".join((f"processor\t: {core}", *lines, "", "")) for core in range(cores))
    return "".join(each)


def _bootstrap(kind: Kind, base: Path) -> None:
    making = base.with_name(f"{base.name}-making")
    if making.exists():
        shutil.rmtree(making)
    making.parent.mkdir(parents=True, exist_ok=True)
    options = [f"--arch={kind.architecture}", "--variant=minbase", f"--include={_BASE}"]
    subprocess.run(
        ["debootstrap", *options, kind.suite, making, MIRROR],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    (making / "etc" / "apt" / "apt.conf.d" / "90unattended").write_text(
        'APT::Get::Assume-Yes "true";\nDpkg::Use-Pty "false";\n'
    )
    chroot = ["chroot", making]
    subprocess.run([*chroot, "useradd", "-m", "-s", "/bin/bash", USER], check=True)
    sudoers = making / "etc" / "sudoers.d" / USER
    sudoers.write_text(f'{USER} ALL=(ALL) NOPASSWD: ALL\nDefaults env_keep += "DEBIAN_FRONTEND"\n')
    making.rename(base)


def _register(emulator: str) -> None:
    """Have the kernel run this architecture's programs, also from within a chroot."""
    if not (_BINFMT / "register").exists():
        subprocess.run(["mount", "-t", "binfmt_misc", "binfmt_misc", _BINFMT], check=True)
    name = f"rsoconsole-{emulator}"
    if not (_BINFMT / name).exists():
        rule = Path(f"/usr/lib/binfmt.d/qemu-{emulator}.conf").read_text(encoding="ascii").strip()
        # Debian's own rule lacks C (credentials), without which sudo is nobody inside.
        fields = [*rule.split(":")[:-1], f"{rule.rpartition(':')[2]}C"]
        fields[1] = name
        (_BINFMT / "register").write_text(":".join(fields))


def _quoted(script: str) -> str:
    return "'" + script.replace("'", "'\\''") + "'"
