"""How the engine stands, and where the mount itself says that it stands and what it does."""

from typing import Literal

from rsoconsole.control import Status
from rsoconsole.words import NS_PER_S, altaz, clock, format_dec, format_ra, rate_text

HOLDERS = {
    "autonomy": ("AUTO has the mount", "autonomy has the mount", "AUTO had the mount"),
    "operator": ("YOU have the mount", "the operator has the mount", "the operator had it"),
    "nobody": ("nobody has the mount", "nobody has the mount", "nobody had the mount"),
}
"""Each for the seat that commands, for one that looks, and of the past."""

OLD_S = 10.0
"""A word of the mount older than that is told with its instant."""
STANDS, NOT_KNOWN = "stands, measured", "how it moves is not known"


def holder_words(holder: str | None, form: Literal["seat", "plain", "past"]) -> str:
    """Who has the mount."""
    if holder in HOLDERS:
        return HOLDERS[holder][("seat", "plain", "past").index(form)]
    return "" if form == "past" else "who has the mount is not known"


def fault_words(status: Status) -> list[str]:
    """Its faults, or that none is left, and what is overridden."""
    words = [f"FAULT {fault}" for fault in dict.fromkeys(status.faults)]
    if status.state == "FAULT" and not words:
        words = ["the cause of the FAULT is over: arm it to go on"]
    return [*words, f"overridden: {', '.join(status.lifted)}"] if status.lifted else words


def held_words(status: Status) -> str:
    """That autonomy gives the mount no slews; empty where it does."""
    if not status.is_held:
        return ""
    return "HELD until it clears" if status.resumes_when_clear else "HELD"


def limit_left_s(status: Status) -> float | None:
    """Until sidereal tracking runs into a limit; None: not within hours."""
    return _left_s(status, status.next_limit_utc_ns)


def limit_words(status: Status) -> str:
    """Which limit that is, and when; empty where there is none."""
    left_s = limit_left_s(status)
    return "" if left_s is None else f"{status.next_limit} in {left_s / 60.0:.0f} min"


def shutter_words(status: Status) -> str:
    """Until when it is open or closed; empty where that is not known."""
    left_s = _left_s(status, status.exposing_until_utc_ns)
    wait_s = _left_s(status, status.next_start_utc_ns)
    if left_s is not None:
        return f"exposing, {max(left_s, 0.0):.0f} s left"
    return "" if wait_s is None else f"next exposure in {max(wait_s, 0.0):.0f} s"


def _left_s(status: Status, until_utc_ns: int | None) -> float | None:
    if status.now_utc_ns is None or until_utc_ns is None:
        return None
    return (until_utc_ns - status.now_utc_ns) / NS_PER_S


def mount_words(status: Status, name: str = "mount ") -> tuple[str, ...]:
    """Place (ICRS), altitude and azimuth, what it does; empty where the mount never said."""
    ra, dec = status.mount_ra_icrs_deg, status.mount_dec_icrs_deg
    if ra is None or dec is None:
        return ()
    words = [f"{name}RA {format_ra(ra, 1)} Dec {format_dec(dec, 0)}"]
    if high := altaz(status.mount_alt_deg, status.mount_az_deg):
        words.append(high)
    does = motion_words(status)
    if is_silent(status):
        does = f"silent since {clock(status.mount_t_utc_ns)}"
    return *words, does


def motion_words(status: Status) -> str:
    """What it does as measured; where that is not known, what its driver says."""
    measured, claimed = _measured(status), _claimed(status)
    if status.is_parked:
        return "parked" if measured in ("", STANDS) else f"parked, but it {measured}"
    if status.is_slewing:
        is_at_rest = status.mount_motion in ("stands", "tracks")
        return f"{claimed}, but it {measured}" if is_at_rest else claimed
    if not measured and status.is_tracking is None:
        return NOT_KNOWN
    return measured or f"{claimed} by its driver's word"


def _measured(status: Status) -> str:
    """Empty: not known."""
    match status.mount_motion:
        case "stands":
            return STANDS
        case "tracks":
            return "tracks, measured"
        case "moves":
            rate_deg_s = status.mount_rate_deg_s
            at = "" if rate_deg_s is None else f" at {rate_text(rate_deg_s)}"
            return f"moves{at}, measured"
    return ""


def _claimed(status: Status) -> str:
    if status.is_slewing:
        what, left_s = "parking" if status.is_parking else "slewing", status.slew_left_s
        return what if left_s is None else f"{what}, {left_s:.0f} s left"
    return "tracks" if status.is_tracking else "stands"


def is_silent(status: Status) -> bool:
    """Whether the mount has said nothing for so long that its word is old."""
    said_s = _left_s(status, status.mount_t_utc_ns)
    return said_s is not None and said_s < -OLD_S
