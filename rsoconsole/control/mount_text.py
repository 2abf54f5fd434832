"""Where the mount itself says that it stands, and what it does: for console and shell alike."""

from rsoconsole.control.status import Status
from rsoconsole.words import NS_PER_S, altaz, clock, format_dec, format_ra

OLD_S = 10.0
"""A word of the mount older than that is told with its instant."""
SLOW_DEG_S = 0.02
"""Below it a rate is told in arcseconds."""
STANDS = "stands, measured"


def mount_words(status: Status) -> tuple[str, ...]:
    """Place (ICRS), altitude and azimuth, what it does; empty where the mount never said."""
    ra, dec = status.mount_ra_icrs_deg, status.mount_dec_icrs_deg
    if ra is None or dec is None:
        return ()
    words = [f"mount RA {format_ra(ra, 1)} Dec {format_dec(dec, 0)}"]
    if high := altaz(status.mount_alt_deg, status.mount_az_deg):
        words.append(high)
    since = _silent_since(status)
    if since is not None:
        return (*words, f"silent since {since}")
    return *words, motion_words(status)


def motion_words(status: Status) -> str:
    """What it does as measured; where that is not known, what its driver says."""
    measured, claimed = _measured(status), _claimed(status)
    if status.is_parked:
        return "parked" if measured in ("", STANDS) else f"parked, but it {measured}"
    if status.is_slewing:
        is_at_rest = status.mount_motion in ("stands", "tracks")
        return f"{claimed}, but it {measured}" if is_at_rest else claimed
    if not measured and status.is_tracking is None:
        return "how it moves is not known"
    return measured or f"{claimed} by its driver's word"


def _measured(status: Status) -> str:
    """Empty: not known."""
    match status.mount_motion:
        case "stands":
            return STANDS
        case "tracks":
            return "tracks, measured"
        case "moves":
            return f"moves{_at_rate(status.mount_rate_deg_s)}, measured"
    return ""


def _at_rate(rate_deg_s: float | None) -> str:
    if rate_deg_s is None:
        return ""
    if rate_deg_s < SLOW_DEG_S:
        return f" at {rate_deg_s * 3600.0:.0f} arcsec/s"
    return f" at {rate_deg_s:.{1 if rate_deg_s >= 1.0 else 2}f} deg/s"


def _claimed(status: Status) -> str:
    if status.is_slewing:
        what, left_s = "parking" if status.is_parking else "slewing", status.slew_left_s
        return what if left_s is None else f"{what}, {left_s:.0f} s left"
    return "tracks" if status.is_tracking else "stands"


def is_silent(status: Status) -> bool:
    """Whether the mount has said nothing for so long that its word is old."""
    return _silent_since(status) is not None


def _silent_since(status: Status) -> str | None:
    said, now = status.mount_t_utc_ns, status.now_utc_ns
    if said is None or now is None or now - said <= OLD_S * NS_PER_S:
        return None
    return clock(said)
