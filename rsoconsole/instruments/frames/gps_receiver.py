"""The start of an exposure by the camera's own GPS receiver, as its drivers write it."""

import re
from collections.abc import Mapping
from typing import Any

from rsoconsole.instruments.frames.header_cards import Cards, shown_value
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S

LOCKED = 3
_FARTHEST_S = 900.0
"""Largest difference of the receiver's time from DATE-OBS that is believed, s."""
_SAME_SHARE, _SAME_S = 0.05, 0.01
"""Largest differences of the receiver's exposure time from the header's, as share and seconds."""


def gps_time(
    header: Mapping[str, Any], header_start_utc_ns: int | None, exposure_s: float | None
) -> tuple[int | None, str | None]:
    """Return the start of the exposure by the camera's GPS receiver, and why it is not used.

    (start in UTC ns, None), or (None, reason); (None, None) where the header has no receiver. The
    start is chosen so that the middle of the exposure is the middle that the receiver states.
    """
    start_ns = _instant(header, "GPS_SUTC", "GPS_ST", "GPS_SU")
    if start_ns is None:
        return None, _unread(header)
    for key in ("GPS_SFLG", "GPS_EFLG"):
        flag = header.get(key)
        if isinstance(flag, int) and (flag >> 4 if flag > 15 else flag) != LOCKED:
            return _not_used(f"its receiver was not locked ({key} is {shown_value(flag)})")
    if header_start_utc_ns is not None:
        off_s = (start_ns - header_start_utc_ns) / NS_PER_S
        if abs(off_s) > _FARTHEST_S:
            return _not_used(f"it is {off_s:.0f} s from DATE-OBS")
    end_ns = _instant(header, "GPS_EUTC", "GPS_ET", "GPS_EU")
    if end_ns is None or exposure_s is None:
        return start_ns, None
    open_s = (end_ns - start_ns) / NS_PER_S
    if abs(open_s - exposure_s) > max(_SAME_SHARE * exposure_s, _SAME_S):
        return _not_used(f"its shutter was open for {open_s:.3f} s, by EXPTIME {exposure_s:g} s")
    return (start_ns + end_ns - round(exposure_s * NS_PER_S)) // 2, None


def _not_used(why: str) -> tuple[None, str]:
    return None, f"the time by the camera's GPS is not used, DATE-OBS is: {why}"


def _unread(header: Mapping[str, Any]) -> str | None:
    """Reason why a receiver's time that the header states is not used; None without one."""
    cards = Cards(header)
    stated = [key for key in ("GPS_SUTC", "GPS_ST") if cards.value(key) is not None]
    return (
        _not_used(f"{stated[0]} {shown_value(header[stated[0]])} is no time")[1] if stated else None
    )


def _instant(header: Mapping[str, Any], whole: str, second: str, micro: str) -> int | None:
    """Instant in one of the two notations."""
    stated = header.get(whole)
    if isinstance(stated, str):
        return _iso(stated)
    stated, microseconds = header.get(second), header.get(micro)
    if not isinstance(stated, str):
        return None
    if isinstance(microseconds, bool) or not isinstance(microseconds, int | float):
        return _iso(stated)
    if not 0.0 <= microseconds < 1e6:
        return None
    # The text is cut to milliseconds, or has none at all.
    seconds = _iso(re.sub(r"\.\d*", "", stated))
    return None if seconds is None else seconds + round(float(microseconds) * 1000.0)


def _iso(text: str) -> int | None:
    try:
        return iso_to_utc_ns(text.strip())
    except ValueError:
        return None
