"""Precise orbits as analysis centres publish them: SP3-c and SP3-d. Pure.

Source: Hilla, "The Extended Standard Product 3 Orbit Format (SP3-d)", 2016. Between the epochs of a
file positions are interpolated by a polynomial through ten epochs, along axes that do not turn with
the Earth. The error is centimetres at steps of 5 and 15 min; in the outermost intervals of a file,
where the polynomial is one-sided, decimetres.
"""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from rsoconsole.base import OrbitError
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    IntArray,
    PositionOf,
    SkyPlaces,
    TimeLike,
    astrometric_places,
    itrf_to_gcrs_rotation,
    tai_minus_utc_s,
)
from rsoconsole.words import NS_PER_S, utc_ns_to_iso

EARTH_RAD_S = 7.292115e-5
GPS_MINUS_BDT_S = 14
TAI_MINUS_GPS_S = 19
Kind = Literal["broadcast", "sp3", "tle"]

SIGMA_KM: Mapping[Kind, float] = {"broadcast": 0.002, "sp3": 0.0005, "tle": 1.0}
"""One sigma of a place across the line of sight, km, by kind of source; stated."""
SYSTEMS = {"G": "GPS", "E": "Galileo", "C": "BeiDou", "J": "QZSS", "R": "GLONASS"}


class EarthFixedOrbit(Protocol):
    """Interface of one satellite's orbit, whatever the kind of file."""

    def states_earth_fixed(self, t_gps_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (N, 3), km and km/s, along Earth-fixed axes.

        The velocity is that relative to non-rotating axes. NaN outside the time span of the
        file.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationSatellite:
    """One satellite with a published orbit."""

    name: str
    """Name: system and number, as ``G04``; for elements the object's name."""
    kind: Kind
    position_gcrs: PositionOf
    """Function from instants to GCRS position and velocity; NaN outside the file's time span."""
    norad_id: int | None = None

    @property
    def sigma_km(self) -> float:
        """Assumed error of its place across the line of sight, one sigma."""
        return SIGMA_KM[self.kind]

    def places(self, site: Site, t_utc_ns: IntArray) -> SkyPlaces:
        """Places at instants, seen from a site, as a plate solution measures them."""
        return astrometric_places(self.position_gcrs, site, t_utc_ns)


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationFile:
    """Satellites read from one or several files of one kind."""

    kind: Kind
    satellites: tuple[NavigationSatellite, ...]
    first_utc_ns: int
    last_utc_ns: int
    skipped: Mapping[str, int]


def gps_ns_of_utc(t_utc_ns: TimeLike) -> IntArray:
    """Convert UTC to GPS time, both in nanoseconds."""
    later_s = tai_minus_utc_s(t_utc_ns) - TAI_MINUS_GPS_S
    return np.asarray(np.asarray(t_utc_ns, np.int64) + np.rint(later_s).astype(np.int64) * NS_PER_S)


def utc_ns_of_gps(t_gps_ns: TimeLike) -> IntArray:
    """Convert GPS time to UTC, both in nanoseconds."""
    t = np.asarray(t_gps_ns, np.int64)
    guess = t - (gps_ns_of_utc(t) - t)
    return np.asarray(t - (gps_ns_of_utc(guess) - guess))


def make_satellite(name: str, kind: Kind, orbit: EarthFixedOrbit) -> NavigationSatellite:
    """Make a satellite from its orbit along Earth-fixed axes."""

    def position_gcrs(t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        r, v = orbit.states_earth_fixed(gps_ns_of_utc(t_utc_ns))
        rotation = itrf_to_gcrs_rotation(t_utc_ns)
        return (
            np.asarray(np.einsum("...ij,...j->...i", rotation, r)),
            np.asarray(np.einsum("...ij,...j->...i", rotation, v)),
        )

    return NavigationSatellite(name=name, kind=kind, position_gcrs=position_gcrs)


def make_navigation_file(
    kind: Kind,
    orbits: Mapping[str, EarthFixedOrbit],
    reach_gps_ns: tuple[int, int],
    skipped: Mapping[str, int],
) -> NavigationFile:
    """Make a file of these orbits; ``reach_gps_ns``: its first and last instant."""
    first, last = utc_ns_of_gps(np.array(reach_gps_ns)).tolist()
    return NavigationFile(
        kind=kind,
        satellites=tuple(make_satellite(name, kind, orbit) for name, orbit in orbits.items()),
        first_utc_ns=first,
        last_utc_ns=last,
        skipped=skipped,
    )


def expect_covered(found: NavigationFile, t_utc_ns: Sequence[int], source: str) -> None:
    """Raise OrbitError where none of the instants is within the time span of the file."""
    inside = [t for t in t_utc_ns if found.first_utc_ns <= t <= found.last_utc_ns]
    if t_utc_ns and not inside:
        first, last = (utc_ns_to_iso(t, 0) for t in (found.first_utc_ns, found.last_utc_ns))
        raise OrbitError(
            f"{source} reaches from {first} to {last}, the measurements are of"
            f" {utc_ns_to_iso(min(t_utc_ns), 0)} to {utc_ns_to_iso(max(t_utc_ns), 0)}: give the"
            " file of that day"
        )


NODES, MIN_NODES = 10, 6
"""Epochs of a polynomial, and least number of them, which gives a metre at steps of 15 min."""
_HALF_S = 0.5
_NEAREST_KM, _FARTHEST_KM = 6_400.0, 60_000.0
_EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 -- a calendar, which of the time systems the file says
_LONGEST_STEP_S = 1800.0
_SECONDS_LATER = {"GPS": 0.0, "GAL": 0.0, "QZS": 0.0, "IRN": 0.0, "BDT": float(GPS_MINUS_BDT_S)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledOrbit:
    """Orbit of one satellite as positions at the epochs of a file."""

    t_gps_ns: IntArray
    """Epochs (M,), ascending."""
    r_km: FloatArray
    """Positions (M, 3), Earth-fixed."""

    def states_earth_fixed(self, t_gps_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities as ``EarthFixedOrbit``, by interpolation.

        NaN outside the epochs of the file and in a gap between them.
        """
        t = np.atleast_1d(np.asarray(t_gps_ns, np.int64))
        nodes, is_known = self._nodes(t)
        since_s = (self.t_gps_ns[nodes] - t[:, None]) / NS_PER_S
        turn = EARTH_RAD_S * since_s
        cos_a, sin_a = np.cos(turn), np.sin(turn)
        x, y, z = np.moveaxis(self.r_km[nodes], -1, 0)
        still = np.stack([cos_a * x - sin_a * y, sin_a * x + cos_a * y, z], axis=-1)
        r, before, after = (
            np.einsum("nk,nki->ni", _weights(since_s, at_s), still)
            for at_s in (0.0, -_HALF_S, _HALF_S)
        )
        unknown = ~is_known[:, None]
        return (
            np.where(unknown, np.nan, r),
            np.where(unknown, np.nan, (after - before) / (2.0 * _HALF_S)),
        )

    def _nodes(self, t: IntArray) -> tuple[IntArray, npt.NDArray[np.bool_]]:
        """Indices (N, NODES) of the epochs about each instant, and whether they enclose it."""
        count = min(NODES, len(self.t_gps_ns))
        after = np.searchsorted(self.t_gps_ns, t)
        first = np.clip(after - count // 2, 0, len(self.t_gps_ns) - count)
        nodes = first[:, None] + np.arange(count)
        span_s = (self.t_gps_ns[nodes[:, -1]] - self.t_gps_ns[nodes[:, 0]]) / NS_PER_S
        is_inside = (t >= self.t_gps_ns[0]) & (t <= self.t_gps_ns[-1])
        step_s = float(np.median(np.diff(self.t_gps_ns))) / NS_PER_S
        is_whole = (count >= MIN_NODES) & (span_s <= (count - 0.5) * step_s)
        return nodes, is_inside & is_whole & (step_s <= _LONGEST_STEP_S)


def _weights(since_s: FloatArray, at_s: float) -> FloatArray:
    """Weights (N, K) of Lagrange's polynomial at an instant, for nodes (N, K)."""
    apart = since_s[:, :, None] - since_s[:, None, :]
    ahead = at_s - since_s[:, None, :]
    same = np.eye(since_s.shape[1], dtype=bool)
    return np.asarray(np.prod(np.where(same, 1.0, ahead / np.where(same, 1.0, apart)), axis=-1))


def parse_sp3(texts: dict[str, str]) -> NavigationFile:
    """Read SP3 texts, keyed by file name, as one set of orbits; successive days are joined.

    Raises OrbitError, naming file and line, for another format than SP3-c or SP3-d, or damage.
    """
    samples: dict[str, dict[int, tuple[float, float, float]]] = defaultdict(dict)
    skipped: Counter[str] = Counter()
    for source, text in texts.items():
        _read(text, source, samples, skipped)
    orbits = {}
    for name, found in sorted(samples.items()):
        if len(found) < MIN_NODES:
            skipped[f"fewer than {MIN_NODES} epochs"] += 1
            continue
        t = np.array(sorted(found), np.int64)
        orbits[name] = SampledOrbit(t_gps_ns=t, r_km=np.array([found[int(each)] for each in t]))
    if not orbits:
        raise OrbitError(
            f"{', '.join(texts)}: no satellite has {MIN_NODES} epochs: give a whole day"
        )
    first = min(int(each.t_gps_ns[0]) for each in orbits.values())
    last = max(int(each.t_gps_ns[-1]) for each in orbits.values())
    return make_navigation_file("sp3", orbits, (first, last), skipped)


def _read(
    text: str,
    source: str,
    samples: dict[str, dict[int, tuple[float, float, float]]],
    skipped: Counter[str],
) -> None:
    lines = text.splitlines()
    if not lines or lines[0][:2] not in ("#c", "#d"):
        raise OrbitError(f"{source} is no SP3-c or SP3-d file: its first line begins with #c or #d")
    system = next((line[9:12] for line in lines if line.startswith("%c")), "GPS")
    t_gps_ns: int | None = None
    for number, line in enumerate(lines, start=1):
        if line.startswith("EOF"):
            return
        try:
            if line.startswith("*"):
                t_gps_ns = _epoch_gps_ns(line, system)
            elif line.startswith("P") and t_gps_ns is not None:
                _take(line, samples, skipped, t_gps_ns)
        except ValueError as error:
            if number == len(lines):
                skipped["a line that breaks off"] += 1
                return
            raise OrbitError(f"{source}, line {number}: {error}: fetch the file again") from error


def _take(
    line: str,
    samples: dict[str, dict[int, tuple[float, float, float]]],
    skipped: Counter[str],
    t_gps_ns: int,
) -> None:
    name = f"{line[1].strip() or 'G'}{int(line[2:4]):02d}"
    x, y, z = (float(line[at : at + 14]) for at in (4, 18, 32))
    distance_km = float(np.linalg.norm([x, y, z]))
    if distance_km == 0.0:
        skipped["no place at an epoch"] += 1
    elif "M" in line[78:79]:
        skipped["a manoeuvre at an epoch"] += 1
    elif not _NEAREST_KM <= distance_km <= _FARTHEST_KM:
        raise ValueError(f"{name} would be {distance_km:.0f} km from the Earth's centre")
    else:
        samples[name][t_gps_ns] = (x, y, z)


def _epoch_gps_ns(line: str, system: str) -> int:
    year, month, day, hour, minute = (int(part) for part in line[1:].split()[:5])
    second = float(line[1:].split()[5])
    minutes = datetime(year, month, day, hour, minute)  # noqa: DTZ001 -- of the file's system
    whole_s = round((minutes - _EPOCH).total_seconds())
    t_ns = whole_s * NS_PER_S + round(second * NS_PER_S)
    if system in ("UTC", "GLO"):
        return int(gps_ns_of_utc(t_ns))
    if system == "TAI":
        return t_ns - 19 * NS_PER_S
    if system not in _SECONDS_LATER:
        raise ValueError(f"time system {system!r} is not known")
    return t_ns + round(_SECONDS_LATER[system] * NS_PER_S)
