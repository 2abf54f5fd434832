"""How long the disk lasts: nights are large, and a full disk ends the record of one."""

from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.sky import NS_PER_S
from rsoconsole.sky.bodies import night_span

NIGHT_WITHOUT_DARK_S = 10 * 3600.0
"""What is assumed where no dark time begins within a day."""
LONGEST_NIGHT_S = 24 * 3600.0
COMPRESSED_SHARE = 0.52
"""Of a frame whose camera fills all 16 bits; 12 bits in 16 come to half of this."""
BYTES_BESIDE_FRAME = 100_000
"""Preview and records of one exposure."""
WARN_BELOW_NIGHTS = 3.0
DISK_REMEDY = (
    "move or remove old sessions ('rsoconsole sessions archive', 'prune'), set session.root to a "
    "larger disk, or set session.keep_frames to detected"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiskOutlook:
    """What the coming night takes and how many such nights there is room for."""

    bytes_a_night: int
    """At most: exposures from dusk to dawn without a pause, each kept as configured."""
    dark_s: float
    """How long that night is."""
    free_bytes: int
    nights: float
    warning: str | None
    """In words, with the figures and what to do; None while there is room for some nights."""


def disk_outlook(
    config: Config, free_bytes: int, now_utc_ns: int, bytes_a_frame: float | None = None
) -> DiskOutlook:
    """How many nights like the coming one the free disk holds.

    ``bytes_a_frame`` is what a frame has really come to, without preview and records; None
    computes from the sensor and how well such frames compress. For "detected" every frame is
    counted: how many will show something nobody knows.
    """
    span = night_span(config.site.to_site(), now_utc_ns, config.limits.twilight_deg)
    dark_s = NIGHT_WITHOUT_DARK_S if span is None else (span[1] - span[0]) / NS_PER_S
    dark_s = min(dark_s, LONGEST_NIGHT_S)
    need = session_bytes(config, dark_s, bytes_a_frame)
    nights = free_bytes / need
    return DiskOutlook(
        bytes_a_night=round(need),
        dark_s=dark_s,
        free_bytes=free_bytes,
        nights=nights,
        warning=_warning(disk_words(free_bytes, dark_s, need), nights),
    )


def bytes_until_dawn(
    config: Config, now_utc_ns: int, bytes_a_frame: float | None = None
) -> tuple[float, float]:
    """(disk that what is left of this night, or the whole coming one, takes; its seconds)."""
    span = night_span(config.site.to_site(), now_utc_ns, config.limits.twilight_deg)
    if span is None:
        dark_s = NIGHT_WITHOUT_DARK_S
    else:
        dark_s = (span[1] - max(span[0], now_utc_ns)) / NS_PER_S
    return session_bytes(config, dark_s, bytes_a_frame), dark_s


def session_bytes(config: Config, duration_s: float, bytes_a_frame: float | None = None) -> float:
    """Disk that exposures over ``duration_s`` take at most."""
    cadence_s = max(config.exposure.cadence_s, config.exposure.exposure_s)
    if config.session.keep_frames in {"none", "last"}:  # those of the last few weigh little
        kept_bytes = 0.0
    elif bytes_a_frame is not None:
        kept_bytes = bytes_a_frame
    else:
        kept_bytes = COMPRESSED_SHARE * raw_frame_bytes(config)
    return duration_s / cadence_s * (kept_bytes + BYTES_BESIDE_FRAME)


def raw_frame_bytes(config: Config) -> int:
    """One frame as the camera gives it: 16 bits a pixel."""
    return 2 * config.optics.width_px * config.optics.height_px


def disk_words(free_bytes: float, dark_s: float, need_bytes: float) -> str:
    """What is free, and what so much of a night takes."""
    takes = f"{dark_s / 3600:.1f} h of dark take up to {need_bytes / 1e9:.1f} GB"
    return f"{free_bytes / 1e9:.1f} GB free, {takes}"


def _warning(figures: str, nights: float) -> str | None:
    if nights >= WARN_BELOW_NIGHTS:
        return None
    if nights < 1.0:
        return f"the disk fills before the night is over: {figures}; {DISK_REMEDY}"
    return f"the disk holds {nights:.1f} more nights: {figures}; {DISK_REMEDY}"
