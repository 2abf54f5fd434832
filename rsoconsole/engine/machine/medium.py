"""Which kind of disk a folder lies on: an SD card wears out, a USB disk is made for nights."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rsoconsole.engine.machine import machine
from rsoconsole.engine.machine.machine import text_of

MediumKind = Literal[
    "SD card", "eMMC", "USB disk", "NVMe disk", "disk", "network share", "memory", "unknown"
]
_NETWORK = {"nfs", "nfs4", "cifs", "smb3", "sshfs", "fuse.sshfs", "9p"}
_MEMORY = {"tmpfs", "ramfs"}
_LIFE_STEP_PERCENT = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """What a folder lies on."""

    kind: MediumKind
    device: str = ""
    """As the kernel calls the whole disk; empty where it is none."""
    life_used_percent: int | None = None
    """As an eMMC counts it itself, in steps of ten; 110: beyond what it is made for."""


def medium_of(folder: Path, root: Path | None = None) -> Medium:
    """What the folder lies on, or would once it is made. Raises nothing."""
    place = machine.ROOT if root is None else root
    mount = _mount_of(folder, place)
    if mount is None:
        return Medium(kind="unknown")
    number, file_system, source = mount
    if file_system in _MEMORY:
        return Medium(kind="memory")
    if file_system in _NETWORK:
        return Medium(kind="network share")
    # A file system of several disks (btrfs) has no number of its own but names one of them.
    for path in (
        place / "sys/dev/block" / number,
        place / "sys/class/block" / Path(source).name,
    ):
        if path.exists():
            return _disk(path.resolve())
    return Medium(kind="unknown")


def _mount_of(folder: Path, root: Path) -> tuple[str, str, str] | None:
    """(major:minor, file system, source) of the mount that the folder is in."""
    found: tuple[int, tuple[str, str, str]] | None = None
    wanted = Path(os.path.realpath(folder))
    for line in (text_of(root / "proc/self/mountinfo") or "").splitlines():
        fields = line.split()
        if len(fields) < 10 or "-" not in fields:
            continue
        beyond = fields[fields.index("-") + 1 :]
        point = Path(_unescaped(fields[4]))
        # Of two mounts on one place the later hides the earlier.
        if wanted.is_relative_to(point) and (found is None or len(point.parts) >= found[0]):
            found = len(point.parts), (fields[2], beyond[0], beyond[1])
    return None if found is None else found[1]


def _disk(device: Path) -> Medium:
    """The whole disk behind a partition, or behind what is mapped onto it."""
    below = sorted((device / "slaves").glob("*"))
    if below:
        return _disk(below[0].resolve())
    whole = device.parent if (device / "partition").exists() else device
    return Medium(kind=_kind(whole), device=whole.name, life_used_percent=_life_used(whole))


def _kind(whole: Path) -> MediumKind:
    if whole.name.startswith("mmcblk"):
        return "eMMC" if text_of(whole / "device/type") == "MMC" else "SD card"
    if any(part.startswith("usb") for part in whole.parts):
        return "USB disk"
    return "NVMe disk" if whole.name.startswith("nvme") else "disk"


def _life_used(whole: Path) -> int | None:
    """The more worn of an eMMC's two counts (JESD84-B51: 0x01 for the first tenth)."""
    try:
        counts = [int(word, 16) for word in (text_of(whole / "device/life_time") or "").split()]
    except ValueError:
        return None
    most = max(counts, default=0)
    return None if most == 0 else _LIFE_STEP_PERCENT * most


def _unescaped(place: str) -> str:
    """Blanks and the like stand in mountinfo as octal numbers."""
    for escaped, meant in (("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")):
        place = place.replace(escaped, meant)
    return place
