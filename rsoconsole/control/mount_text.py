"""Where the mount itself says that it stands, and what it does: for console and shell alike."""

from rsoconsole.control.status import Status
from rsoconsole.sky import format_dec, format_ra, utc_ns_to_iso

OLD_S = 10.0
"""A word of the mount older than that is told with its instant."""
NS_PER_S = 1_000_000_000


def mount_words(status: Status) -> tuple[str, ...]:
    """Place (ICRS), altitude and azimuth, what it does; empty where the mount never said."""
    ra, dec = status.mount_ra_icrs_deg, status.mount_dec_icrs_deg
    if ra is None or dec is None:
        return ()
    words = [f"mount RA {format_ra(ra, 1)} Dec {format_dec(dec, 0)}"]
    if status.mount_alt_deg is not None and status.mount_az_deg is not None:
        words.append(f"alt {status.mount_alt_deg:.1f} az {status.mount_az_deg:.1f}")
    since = _silent_since(status)
    if since is not None:
        return (*words, f"silent since {since}")
    return *words, motion_words(status)


def motion_words(status: Status) -> str:
    """Slewing and for how long still, tracking, parked, or that it stands."""
    if status.is_parked:
        return "parked"
    if status.is_slewing:
        left_s = status.slew_left_s
        return "slewing" if left_s is None else f"slewing, {left_s:.0f} s left"
    return "tracking" if status.is_tracking else "stands still"


def is_silent(status: Status) -> bool:
    """Whether the mount has said nothing for so long that its word is old."""
    return _silent_since(status) is not None


def _silent_since(status: Status) -> str | None:
    said, now = status.mount_t_utc_ns, status.now_utc_ns
    if said is None or now is None or now - said <= OLD_S * NS_PER_S:
        return None
    return f"{utc_ns_to_iso(said, 0)[11:19]}Z"
