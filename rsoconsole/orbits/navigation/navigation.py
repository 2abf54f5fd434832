"""Navigation satellites whose orbits are published: the common form of every such file. Pure.

Times here are GPS time: nanoseconds since 1970 of its own calendar, which has no leap seconds.
Positions are Earth-fixed (ITRF; WGS84 is the same within centimetres), kilometres.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from rsoconsole.errors import OrbitError
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    NS_PER_S,
    IntArray,
    Places,
    PositionOf,
    TimeLike,
    astrometric_places,
    itrf_to_gcrs_rotation,
    tai_minus_utc_s,
    utc_ns_to_iso,
)

EARTH_RAD_S = 7.292115e-5
GPS_MINUS_BDT_S = 14
TAI_MINUS_GPS_S = 19
Kind = Literal["broadcast", "sp3", "tle"]

SIGMA_KM: Mapping[Kind, float] = {"broadcast": 0.002, "sp3": 0.0005, "tle": 1.0}
"""One sigma of a place across the line of sight, stated: what broadcast ephemerides and the
satellite's middle against its antenna come to (metres), and elements (a kilometre)."""
SYSTEMS = {"G": "GPS", "E": "Galileo", "C": "BeiDou", "J": "QZSS", "R": "GLONASS"}


class EarthFixedOrbit(Protocol):
    """Where one satellite is by one kind of file."""

    def position(self, t_gps_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Position (N, 3) km and velocity (N, 3) km/s, both along Earth-fixed axes.

        The velocity is that against axes that do not turn. NaN where the file does not reach.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationSatellite:
    """One satellite of a file."""

    name: str
    """System and number, as ``G04``; of elements the name there."""
    kind: Kind
    position_gcrs: PositionOf
    """NaN where the file does not reach."""
    norad_id: int | None = None

    @property
    def sigma_km(self) -> float:
        """Stated error of its place, one sigma, across the line of sight."""
        return SIGMA_KM[self.kind]

    def places(self, site: Site, t_utc_ns: IntArray) -> Places:
        """As a plate solution measures them."""
        return astrometric_places(self.position_gcrs, site, t_utc_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationFile:
    """What was read of one or several files of a kind."""

    kind: Kind
    satellites: tuple[NavigationSatellite, ...]
    first_utc_ns: int
    last_utc_ns: int
    skipped: Mapping[str, int]
    """What was not used, by reason, and how often."""


def gps_ns_of_utc(t_utc_ns: TimeLike) -> IntArray:
    """GPS time of UTC."""
    later_s = tai_minus_utc_s(t_utc_ns) - TAI_MINUS_GPS_S
    return np.asarray(np.asarray(t_utc_ns, np.int64) + np.rint(later_s).astype(np.int64) * NS_PER_S)


def utc_ns_of_gps(t_gps_ns: TimeLike) -> IntArray:
    """UTC of GPS time."""
    t = np.asarray(t_gps_ns, np.int64)
    guess = t - (gps_ns_of_utc(t) - t)
    return np.asarray(t - (gps_ns_of_utc(guess) - guess))


def satellite(name: str, kind: Kind, orbit: EarthFixedOrbit) -> NavigationSatellite:
    """One whose orbit is known along Earth-fixed axes."""

    def position_gcrs(t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        r, v = orbit.position(gps_ns_of_utc(t_utc_ns))
        rotation = itrf_to_gcrs_rotation(t_utc_ns)
        return (
            np.asarray(np.einsum("...ij,...j->...i", rotation, r)),
            np.asarray(np.einsum("...ij,...j->...i", rotation, v)),
        )

    return NavigationSatellite(name=name, kind=kind, position_gcrs=position_gcrs)


def expect_covered(found: NavigationFile, t_utc_ns: Sequence[int], source: str) -> None:
    """Raises OrbitError where the file is of other days than every one of the instants."""
    inside = [t for t in t_utc_ns if found.first_utc_ns <= t <= found.last_utc_ns]
    if t_utc_ns and not inside:
        first, last = (utc_ns_to_iso(t, 0) for t in (found.first_utc_ns, found.last_utc_ns))
        raise OrbitError(
            f"{source} reaches from {first} to {last}, the measurements are of"
            f" {utc_ns_to_iso(min(t_utc_ns), 0)} to {utc_ns_to_iso(max(t_utc_ns), 0)}: give the"
            " file of that day"
        )
