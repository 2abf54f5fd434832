"""The kind of disk that a folder lies on, and how many nights fit on it."""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.engine.machine.machine import ROOT, text_of
from rsoconsole.sky import night_span
from rsoconsole.words import NS_PER_S

MediumKind = Literal[
    "SD card", "eMMC", "USB disk", "NVMe disk", "disk", "network share", "memory", "unknown"
]
_NETWORK = {"nfs", "nfs4", "cifs", "smb3", "sshfs", "fuse.sshfs", "9p"}
_MEMORY = {"tmpfs", "ramfs"}
_LIFE_STEP_PERCENT = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingMedium:
    """The disk that a folder lies on."""

    kind: MediumKind
    device: str = ""
    """The kernel's name of the whole disk; empty where the folder is on no disk."""
    life_used_percent: int | None = None
    """Life used, percent, as an eMMC counts it in steps of ten; 110: beyond what it is made for."""


def read_recording_medium(folder: Path, root: Path = ROOT) -> RecordingMedium:
    """Return the disk of a folder that exists or is still to be made; never raises."""
    mount = _mount_of(folder, root)
    if mount is None:
        return RecordingMedium(kind="unknown")
    number, file_system, source = mount
    if file_system in _MEMORY:
        return RecordingMedium(kind="memory")
    if file_system in _NETWORK:
        return RecordingMedium(kind="network share")
    # A file system of several disks (btrfs) has no number of its own but names one of them.
    for path in (root / "sys/dev/block" / number, root / "sys/class/block" / Path(source).name):
        if path.exists():
            return _disk(path.resolve())
    return RecordingMedium(kind="unknown")


def _mount_of(folder: Path, root: Path) -> tuple[str, str, str] | None:
    """Return (major:minor, file system, source) of the mount that the folder is in."""
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


def _disk(device: Path) -> RecordingMedium:
    """Return the whole disk behind a partition, or behind what is mapped onto it."""
    below = sorted((device / "slaves").glob("*"))
    if below:
        return _disk(below[0].resolve())
    whole = device.parent if (device / "partition").exists() else device
    return RecordingMedium(
        kind=_kind(whole), device=whole.name, life_used_percent=_life_used(whole)
    )


def _kind(whole: Path) -> MediumKind:
    if whole.name.startswith("mmcblk"):
        return "eMMC" if text_of(whole / "device/type") == "MMC" else "SD card"
    if any(part.startswith("usb") for part in whole.parts):
        return "USB disk"
    return "NVMe disk" if whole.name.startswith("nvme") else "disk"


def _life_used(whole: Path) -> int | None:
    """Return the more worn of an eMMC's two counts (JESD84-B51: 0x01 for the first tenth)."""
    try:
        counts = [int(word, 16) for word in (text_of(whole / "device/life_time") or "").split()]
    except ValueError:
        return None
    most = max(counts, default=0)
    return None if most == 0 else _LIFE_STEP_PERCENT * most


def _unescaped(place: str) -> str:
    """Decode the octal numbers that stand for blanks and the like in mountinfo."""
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), place)


NIGHT_WITHOUT_DARK_S = 10 * 3600.0
"""Assumed length of a night where it does not become dark within a day, s."""
LONGEST_NIGHT_S = 24 * 3600.0
COMPRESSED_SHARE = 0.52
"""Compressed over raw size of frames that fill all 16 bits; with 12 bits it is half of that."""
BYTES_BESIDE_FRAME = 100_000
"""Size of preview and records of one exposure, bytes."""
WARN_BELOW_NIGHTS = 3.0
DISK_REMEDY = (
    "move or remove old sessions ('rsoconsole sessions archive', 'prune'), set session.root to a "
    "larger disk, or set session.keep_frames to detected"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskOutlook:
    """Disk space that the coming night needs, and the number of such nights that fit."""

    bytes_a_night: int
    """Greatest number of bytes of a night: exposures from dusk to dawn, kept as configured."""
    dark_s: float
    nights: float
    warning: str | None
    """Warning with figures and remedy; None while there is room for some nights."""


def disk_outlook(
    config: Config, free_bytes: int, now_utc_ns: int, bytes_a_frame: float | None = None
) -> DiskOutlook:
    """Compute how many nights like the coming one the free disk holds.

    ``bytes_a_frame``: measured size of a frame, without preview and records; None: computed from
    the sensor and how well such frames compress. Where only frames with detections are kept, all
    frames are counted, because the number with detections is not known.
    """
    dark_s = min(_dark_s(config, now_utc_ns, from_utc_ns=0), LONGEST_NIGHT_S)
    need = session_bytes(config, dark_s, bytes_a_frame)
    nights = free_bytes / need
    return DiskOutlook(
        bytes_a_night=round(need),
        dark_s=dark_s,
        nights=nights,
        warning=_warning(disk_words(free_bytes, dark_s, need), nights),
    )


def bytes_until_dawn(config: Config, now_utc_ns: int) -> tuple[float, float]:
    """Return the disk that the rest of the night needs, bytes, and that rest's length, s.

    By day both are for the whole coming night.
    """
    dark_s = _dark_s(config, now_utc_ns, from_utc_ns=now_utc_ns)
    return session_bytes(config, dark_s), dark_s


def _dark_s(config: Config, now_utc_ns: int, *, from_utc_ns: int) -> float:
    """Length of darkness of this night or the coming one, after ``from_utc_ns`` only, s."""
    span = night_span(config.site.to_site(), now_utc_ns, config.limits.twilight_deg)
    return (
        NIGHT_WITHOUT_DARK_S if span is None else (span[1] - max(span[0], from_utc_ns)) / NS_PER_S
    )


def session_bytes(config: Config, duration_s: float, bytes_a_frame: float | None = None) -> float:
    """Return the disk space that exposures over ``duration_s`` need at most, bytes."""
    cadence_s = max(config.exposure.cadence_s, config.exposure.exposure_s)
    if config.session.keep_frames in {"none", "last"}:  # those of the last few weigh little
        kept_bytes = 0.0
    elif bytes_a_frame is not None:
        kept_bytes = bytes_a_frame
    else:
        raw_bytes = 2 * config.optics.width_px * config.optics.height_px
        kept_bytes = COMPRESSED_SHARE * raw_bytes
    return duration_s / cadence_s * (kept_bytes + BYTES_BESIDE_FRAME)


def disk_words(free_bytes: float, dark_s: float, need_bytes: float) -> str:
    """Return words on the free disk space, and on what a night needs."""
    takes = f"{dark_s / 3600:.1f} h of dark take up to {need_bytes / 1e9:.1f} GB"
    return f"{free_bytes / 1e9:.1f} GB free, {takes}"


def _warning(figures: str, nights: float) -> str | None:
    if nights >= WARN_BELOW_NIGHTS:
        return None
    if nights < 1.0:
        return f"the disk fills before the night is over: {figures}; {DISK_REMEDY}"
    return f"the disk holds {nights:.1f} more nights: {figures}; {DISK_REMEDY}"
