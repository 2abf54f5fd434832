"""When a camera with a GPS receiver of its own opened and closed its shutter, by its header.

QHY's cameras, as INDI and SharpCap (GPS_ST with GPS_SU, GPS_ET with GPS_EU) and N.I.N.A. (GPS_SUTC,
GPS_EUTC) write them; those of ToupTek and Moravian as N.I.N.A. does. Source of the flags: QHY's
GPS data structure, whose upper four bits are 3 when the receiver is locked; N.I.N.A. writes those
four alone.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.sky import NS_PER_S, iso_to_utc_ns

LOCKED = 3
_FARTHEST_S = 900.0
"""From DATE-OBS: a receiver that says another quarter of an hour is not believed."""
_SAME_SHARE, _SAME_S = 0.05, 0.01
"""By how much its exposure may differ from the header's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsTime:
    """What the receiver says of one exposure."""

    start_utc_ns: int | None
    """None: nothing that could be used."""
    note: str | None = None
    """Why not."""


def gps_time(
    header: Mapping[str, Any], header_start_utc_ns: int | None, exposure_s: float | None
) -> GpsTime | None:
    """The opening of the shutter, so that its middle is the receiver's; None without a receiver."""
    start_ns = _instant(header, "GPS_SUTC", "GPS_ST", "GPS_SU")
    if start_ns is None:
        return None
    for key in ("GPS_SFLG", "GPS_EFLG"):
        flag = header.get(key)
        if isinstance(flag, int) and (flag >> 4 if flag > 15 else flag) != LOCKED:
            return _not_used(f"its receiver was not locked ({key} is {flag})")
    if header_start_utc_ns is not None:
        off_s = (start_ns - header_start_utc_ns) / NS_PER_S
        if abs(off_s) > _FARTHEST_S:
            return _not_used(f"it is {off_s:.0f} s from DATE-OBS")
    end_ns = _instant(header, "GPS_EUTC", "GPS_ET", "GPS_EU")
    if end_ns is None or exposure_s is None:
        return GpsTime(start_utc_ns=start_ns)
    open_s = (end_ns - start_ns) / NS_PER_S
    if abs(open_s - exposure_s) > max(_SAME_SHARE * exposure_s, _SAME_S):
        return _not_used(f"its shutter was open for {open_s:.3f} s, by EXPTIME {exposure_s:g} s")
    return GpsTime(start_utc_ns=(start_ns + end_ns - round(exposure_s * NS_PER_S)) // 2)


def _not_used(why: str) -> GpsTime:
    return GpsTime(
        start_utc_ns=None,
        note=f"the time by the camera's GPS is not used, DATE-OBS is: {why}",
    )


def _instant(header: Mapping[str, Any], whole: str, second: str, micro: str) -> int | None:
    """An instant as one of the two ways of writing it says."""
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
