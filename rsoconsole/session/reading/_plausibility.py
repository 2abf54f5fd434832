"""Checks records for impossible values: invalid times, directions and covariances.

JSON in the form of a record may contain any values, which computations must not receive.
"""

from rsoconsole.records import FrameTaken, Measurement, NotFollowed, Record, Ruling, TrackState

LAST_UTC_NS = 7_258_118_400 * 10**9
"""Latest plausible instant, the year 2200."""
_LONGEST_S = 1e6
_WIDEST_ARCSEC2 = 1e20
_LARGEST_DEG = 1e6
_NUMBERS = 4
"""Length of a state."""


def expect_plausible(record: Record) -> None:
    """Raise ValueError, naming the value, for a record with an impossible value."""
    match record:
        case Measurement():
            _expect_measurement(record)
        case NotFollowed():
            _expect_measurement(record.measurement)
        case Ruling():
            for each in (record.taken, *record.refused):
                if each is not None:
                    _expect_measurement(each)
        case TrackState():
            _expect_time(record.t_utc_ns)
            _expect_state(record)
        case FrameTaken():
            if record.t_start_utc_ns is not None:
                _expect_time(record.t_start_utc_ns)
            if record.exposure_s is not None and not 0.0 < record.exposure_s <= _LONGEST_S:
                raise ValueError(f"{record.exposure_s:g} s is no exposure")
        case _:
            pass


def _expect_measurement(measurement: Measurement) -> None:
    _expect_time(measurement.t_mid_utc_ns)
    _expect_direction(measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    for ra_deg, dec_deg in measurement.ends_icrs_deg or ():
        _expect_direction(ra_deg, dec_deg)
    _expect_covariance(*measurement.cov_sky_arcsec2)


def _expect_time(t_utc_ns: int) -> None:
    if not 0 <= t_utc_ns <= LAST_UTC_NS:
        raise ValueError(f"{t_utc_ns} ns is no time of a night")


def _expect_direction(ra_deg: float, dec_deg: float) -> None:
    if not (-360.0 <= ra_deg <= 720.0 and -90.0 <= dec_deg <= 90.0):
        raise ValueError(f"({ra_deg:g}, {dec_deg:g}) is no direction")


def _expect_covariance(east: float, both: float, north: float) -> None:
    is_one = min(east, north) >= 0.0 and max(east, north) <= _WIDEST_ARCSEC2
    if not (is_one and both * both <= east * north * 1.001 + 1e-12):
        raise ValueError(f"({east:g}, {both:g}, {north:g}) arcsec² is no covariance")


def _expect_state(state: TrackState) -> None:
    if [len(row) for row in state.P] != [_NUMBERS] * _NUMBERS:
        raise ValueError("P is no matrix of 4 by 4")
    if max(map(abs, state.x)) > _LARGEST_DEG:
        raise ValueError(f"x = {state.x} is no direction and rate")
    if any(row[k] < 0.0 for k, row in enumerate(state.P)):
        raise ValueError("P is no covariance")
