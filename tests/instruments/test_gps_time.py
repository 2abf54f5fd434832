"""Times by a camera's own GPS receiver, as the programs that drive it write them."""

from typing import Any

import pytest

from rsoconsole.instruments import camera_mode, exposure_time
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import utc_ns_to_iso

NINA = {
    "DATE-OBS": "2024-01-21T11:43:31.100",
    "EXPTIME": 2.0,
    "GPS_SFLG": 3,
    "GPS_SUTC": "2024-01-21T11:43:31.9238820",
    "GPS_EFLG": 3,
    "GPS_EUTC": "2024-01-21T11:43:33.9239030",
}
"""QHY174GPS by N.I.N.A.: flags shifted down."""
SHARPCAP = {
    "DATE-OBS": "2023-09-02T09:00:41.0447712",
    "EXPTIME": 8.0,
    "GPS_SFLG": 51,
    "GPS_ST": "2023-09-02T09:00:41.0000000Z",
    "GPS_SU": 44771.2,
    "GPS_EFLG": 51,
    "GPS_ET": "2023-09-02T09:00:49.0000000Z",
    "GPS_EU": 44773.8,
}
"""QHY174GPS by SharpCap; microseconds apart."""
INDI = {
    "DATE-OBS": "2023-09-02T09:00:40.800",
    "EXPTIME": 8.0,
    "GPS_SFLG": 51,
    "GPS_SS": 892554211,
    "GPS_SU": 44771.2,
    "GPS_ST": "2023-09-02T09:00:41.044",
    "GPS_EFLG": 51,
    "GPS_EU": 44773.8,
    "GPS_ET": "2023-09-02T09:00:49.044",
}
"""The same by indi_qhy_ccd: the text cut to milliseconds."""
TOUPTEK = {
    "DATE-OBS": "2025-03-01T00:00:00.900",
    "EXPTIME": 1.0,
    "GPS_SUTC": "2025-03-01T00:00:01.0001234",
    "GPS_ST": "2025-03-01T00:00:01.0001234",
}
"""By N.I.N.A.: no flags, no end."""


@pytest.mark.parametrize(
    ("header", "begins"),
    [
        (NINA, "2024-01-21T11:43:31.923892500Z"),
        (SHARPCAP, "2023-09-02T09:00:41.044772500Z"),
        (INDI, "2023-09-02T09:00:41.044772500Z"),
        (TOUPTEK, "2025-03-01T00:00:01.000123400Z"),
    ],
)
def test_the_receivers_time_is_the_frames(header: dict[str, Any], begins: str) -> None:
    exposed = exposure_time(header)
    assert exposed.notes == ()
    t_utc_ns = exposed.start_utc_ns
    assert t_utc_ns is not None
    # Its middle is the middle of opening and closing: half the microseconds that EXPTIME lacks.
    assert utc_ns_to_iso(t_utc_ns, 9) == begins
    assert camera_mode(header).time_by == "gps"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"GPS_SFLG": 2}, "not locked"),
        ({"GPS_EFLG": 35}, "not locked"),
        ({"GPS_SUTC": "2024-01-21T10:43:31.9"}, "from DATE-OBS"),
        ({"GPS_EUTC": "2024-01-21T11:43:36.9"}, "its shutter was open for 4.976 s"),
    ],
)
def test_a_receiver_that_cannot_be_believed_is_said_and_not_used(change, why) -> None:
    header = NINA | change
    exposed = exposure_time(header)
    assert exposed.start_utc_ns == iso_to_utc_ns("2024-01-21T11:43:31.100")
    (note,) = exposed.notes
    assert why in note
    assert camera_mode(header).time_by == "header"


def test_without_a_lock_and_without_date_obs_there_is_no_time() -> None:
    header = NINA | {"DATE-OBS": "", "GPS_SFLG": 1}
    assert exposure_time(header).start_utc_ns is None


def test_the_mode_is_what_the_header_tells() -> None:
    told = {"XBINNING": 2, "YBINNING": 1, "XORGSUBF": 100, "YORGSUBF": 0, "GAIN": 139}
    mode = camera_mode(told)
    assert (mode.binning, mode.x0_px, mode.y0_px, mode.gain) == ("2x1", 100, 0, 139.0)
    nothing = camera_mode({"XBINNING": "x", "GAIN": True})
    assert (nothing.binning, nothing.gain, nothing.time_by) == (None, None, "header")
