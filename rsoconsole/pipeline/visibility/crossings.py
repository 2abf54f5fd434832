"""Satellites that cross a field of the sky, and when. Pure.

Every object is computed at long steps; where it can come near the field until the next step it is
computed at fine ones. Between those its line from the site is a parabola, good to centimetres,
and the instants at which it enters and leaves the cone of the field are found by halving.
Directions are as a plate solution measures them: with light time, without annual aberration.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from sgp4.api import SatrecArray

from rsoconsole.orbits import (
    ASSUMED,
    MU_EARTH_KM3_S2,
    CatalogueEntry,
    ElementErrors,
    nearest_epoch_entries,
    orbit_regime,
    position_sigmas_km,
)
from rsoconsole.pipeline.visibility.lost_objects import LostObject, lost_objects
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    EARTH_RADIUS_KM,
    LIGHT_KM_S,
    LIT_SHARE,
    IntArray,
    direction_to_unit,
    earth_velocity_km_s,
    jd_utc,
    lit_fraction,
    phase_angle_deg,
    site_gcrs,
    teme_to_gcrs_rotation,
    unit_to_direction,
    zenith_gcrs,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S

MAX_FIELD_DEG = 60.0
"""Largest diameter of a field, degrees."""
SLOW_PERIGEE_KM = 20_000.0
"""Distance from the Earth's centre below which slow objects never come."""
_STEPS_S, _SLOW_STEPS_S = (180, 4), (600, 30)
"""Long and fine steps, s, of all other objects, and of slow ones."""
_OBJECTS_AT_ONCE = 400
_SITE_KM_S = 0.6
"""More than the speed of any site, km/s."""
_PULL_KM_S2 = 0.01
"""More than the Earth's pull on any satellite, km/s2."""
_ALLOWANCE_KM = 20.0
"""More than the motion of satellite and Earth in the light time, km."""
_SAME_S = 0.01
"""Longest gap within one crossing, s."""
_HALVINGS = 32
_EARTH_TURN_RAD_S = np.array([0.0, 0.0, 7.292115e-5])
"""Rotation of the Earth about the axis of GCRS, near enough for seconds; IERS Conventions 2010."""
IndexArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundField:
    """Field of the sky, as seen from a site."""

    site: Site
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Declination of the centre."""
    diameter_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldPoint:
    """Place of an object at one instant of its crossing."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    alt_deg: float
    """Altitude, geometric, without refraction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldCrossing:
    """Crossing of a field by an object, as far as it is above the horizon and in the span."""

    norad_id: int
    name: str
    enter: FieldPoint
    nearest: FieldPoint
    """Place where it is nearest to the centre of the field."""
    leave: FieldPoint
    offset_deg: float
    """Angle from the centre of the field at ``nearest``."""
    motion_deg: float
    """Position angle of its motion at ``nearest``, from north through east."""
    rate_arcsec_s: float
    """Angular rate against the stars at ``nearest``."""
    range_km: float
    """Distance from the site at ``nearest``."""
    height_km: float
    """Height above the equator's radius at ``nearest``."""
    is_lit: bool
    """True where the Sun shines on it at ``nearest``."""
    phase_deg: float
    """Angle at the object between Sun and site at ``nearest``."""
    tle_age_days: float
    sigma_s: float
    """Sigma of the object's time along its orbit by the elements' age, without a manoeuvre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldCrossings:
    """Crossings of some hundred objects."""

    done: int
    """Number of objects computed so far."""
    crossings: tuple[FieldCrossing, ...]
    lost: tuple[LostObject, ...]
    """Objects for which SGP4 has no place in all or a part of the span, each with why."""


def field_crossings(
    entries: Sequence[CatalogueEntry],
    field: RoundField,
    span_utc_ns: tuple[int, int],
    errors: ElementErrors = ASSUMED,
) -> Iterator[FieldCrossings]:
    """Yield the crossings of a field, some hundred objects at a time.

    ``span_utc_ns``: (start, end) within which crossings are searched. The element set nearest in
    epoch is used.
    """
    nearest = nearest_epoch_entries(entries, span_utc_ns[0])
    is_slow = [each.record.altp * each.record.radiusearthkm > SLOW_PERIGEE_KM for each in nearest]
    done = 0
    for steps_s, wanted in ((_STEPS_S, False), (_SLOW_STEPS_S, True)):
        some = [each for each, slow in zip(nearest, is_slow, strict=True) if slow == wanted]
        search = _Search(field, span_utc_ns, steps_s, errors)
        for start in range(0, len(some), _OBJECTS_AT_ONCE):
            crossings, lost = search.look(some[start : start + _OBJECTS_AT_ONCE])
            done += min(_OBJECTS_AT_ONCE, len(some) - start)
            yield FieldCrossings(done=done, crossings=crossings, lost=lost)
    if not nearest:
        yield FieldCrossings(done=0, crossings=(), lost=())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Arcs:
    """Parabolas (K,) of lines from the site; of vectors (K, 3) along GCRS axes."""

    row: IndexArray
    """Number of the object."""
    t_utc_ns: IntArray
    """Instants of their vertices' middle; a parabola holds for half a fine step either way."""
    line_km: FloatArray
    """Line from the site, with light time."""
    line_km_s: FloatArray
    line_km_s2: FloatArray
    up: FloatArray
    """Zenith."""
    up_s: FloatArray
    """Change of the zenith, 1/s."""
    r_km: FloatArray

    def subset(self, chosen: IndexArray) -> "_Arcs":
        return _Arcs(**{each.name: getattr(self, each.name)[chosen] for each in fields(self)})

    def lines_km(self, s: FloatArray) -> FloatArray:
        """Lines (K, 3), ``s`` (K,) seconds from the instants."""
        s = s[:, None]
        return self.line_km + s * (self.line_km_s + 0.5 * s * self.line_km_s2)

    def ups_km(self, s: FloatArray) -> FloatArray:
        """Heights (K,) above the plane of the horizon, ``s`` (K,) seconds from the instants."""
        return _dot(self.lines_km(s), self.up + s[:, None] * self.up_s)


class _Search:
    """Field and site, through a span in long steps."""

    def __init__(
        self,
        field: RoundField,
        span_utc_ns: tuple[int, int],
        steps_s: tuple[int, int],
        errors: ElementErrors,
    ) -> None:
        self._site, self._span, self._errors = field.site, span_utc_ns, errors
        self._step_s, self._fine_s = steps_s
        self._radius_rad = np.radians(field.diameter_deg / 2.0)
        self._centre = direction_to_unit(
            np.asarray(field.ra_icrs_deg), np.asarray(field.dec_icrs_deg)
        )
        step_ns = self._step_s * NS_PER_S
        count = -(-(span_utc_ns[1] - span_utc_ns[0]) // step_ns) + 1
        self._t = span_utc_ns[0] + np.arange(count, dtype=np.int64) * step_ns
        self._earth_km_s = earth_velocity_km_s(self._t)
        # The site is turned towards the objects' axes: there are far more of those.
        to_teme = np.swapaxes(teme_to_gcrs_rotation(self._t), -1, -2)
        turned = (
            site_gcrs(self._site, self._t)[0],
            zenith_gcrs(self._site, self._t),
            self._centre,
        )
        self._site_teme, self._up_teme, self._centre_teme = (
            np.einsum("nij,...nj->...ni", to_teme, np.broadcast_to(each, (len(self._t), 3)))
            for each in turned
        )

    def look(
        self, entries: Sequence[CatalogueEntry]
    ) -> tuple[tuple[FieldCrossing, ...], tuple[LostObject, ...]]:
        """Return the crossings of these objects, and those of them without a place."""
        jd_1, jd_2 = jd_utc(self._t)
        failed, r, v = SatrecArray([each.record for each in entries]).sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        half_s = self._step_s / 2.0
        speed = np.sqrt(_dot(v, v)) + _SITE_KM_S
        reach_km = (speed + _PULL_KM_S2 * half_s) * half_s + _ALLOWANCE_KM
        line = r - self._site_teme
        with np.errstate(invalid="ignore"):
            is_near = self._is_reached(line, self._up_teme, self._centre_teme, reach_km)
        rows, steps = np.nonzero(is_near & (failed == 0))
        offsets_ns = np.arange(
            -self._step_s // 2 + self._fine_s // 2, self._step_s // 2, self._fine_s
        )
        t_utc_ns = self._t[steps][:, None] + offsets_ns * NS_PER_S
        found = self._fine(entries, np.repeat(rows, len(offsets_ns)), t_utc_ns.ravel())
        return tuple(found), lost_objects(entries, failed, self._t, self._span)

    def _is_reached(
        self, line_km: FloatArray, up: FloatArray, centre: FloatArray, reach_km: FloatArray
    ) -> npt.NDArray[np.bool_]:
        """Say (...,) whether lines (..., 3) moved by ``reach_km`` at most can be in the field."""
        range_km = np.sqrt(_dot(line_km, line_km))
        cosine = np.clip(_dot(line_km, centre) / range_km, -1.0, 1.0)
        beside_rad = np.clip(np.arccos(cosine) - self._radius_rad, 0.0, np.pi / 2.0)
        is_beside = range_km * np.sin(beside_rad) > reach_km
        return np.asarray(~is_beside & (_dot(line_km, up) > -reach_km))

    def _fine(
        self, entries: Sequence[CatalogueEntry], rows: IndexArray, t_utc_ns: IntArray
    ) -> list[FieldCrossing]:
        """Crossings of objects (K,) about instants (K,), for half a fine step either way."""
        arcs = self._arcs(entries, rows, t_utc_ns)
        half_s = self._fine_s / 2.0
        reach_km = (np.sqrt(_dot(arcs.line_km_s, arcs.line_km_s)) + _PULL_KM_S2) * half_s
        arcs = arcs.subset(
            np.flatnonzero(self._is_reached(arcs.line_km, arcs.up, self._centre, reach_km))
        )
        first_s, last_s = self._inside(arcs)
        from_s, to_s = ((each - arcs.t_utc_ns) / NS_PER_S for each in self._span)
        first_s, last_s = np.maximum(first_s, from_s), np.minimum(last_s, to_s)
        kept = np.flatnonzero(last_s > first_s)
        if not len(kept):
            return []
        arcs, first_s, last_s = arcs.subset(kept), first_s[kept], last_s[kept]
        nearest_s, cosine = self._nearest(arcs, first_s, last_s)
        gap_s = np.diff(arcs.t_utc_ns) / NS_PER_S + first_s[1:] - last_s[:-1]
        is_new = (np.diff(arcs.row) != 0) | (gap_s > _SAME_S)
        edges = [0, *(np.flatnonzero(is_new) + 1), len(kept)]
        found = []
        for first, end in pairwise(edges):
            best = first + int(np.argmax(cosine[first:end]))
            three = arcs.subset(np.array([first, best, end - 1]))
            s = np.array([first_s[first], nearest_s[best], last_s[end - 1]])
            found.append(self._crossing(entries[int(three.row[0])], three, s))
        return found

    def _arcs(
        self, entries: Sequence[CatalogueEntry], rows: IndexArray, t_utc_ns: IntArray
    ) -> _Arcs:
        r, v = np.full((len(rows), 3), np.nan), np.full((len(rows), 3), np.nan)
        jd_1, jd_2 = (np.ascontiguousarray(each) for each in jd_utc(t_utc_ns))
        edges = np.flatnonzero(np.diff(rows, prepend=-1, append=-1))
        for first, last in pairwise(edges):
            of = slice(first, last)
            failed, r[of], v[of] = entries[int(rows[first])].record.sgp4_array(jd_1[of], jd_2[of])
            r[of][failed != 0] = np.nan
        rotation = teme_to_gcrs_rotation(t_utc_ns)
        r, v = (np.einsum("nij,nj->ni", rotation, each) for each in (r, v))
        site_km, site_km_s = site_gcrs(self._site, t_utc_ns)
        up = zenith_gcrs(self._site, t_utc_ns)
        seconds, steps_s = ((each - self._t[0]) / NS_PER_S for each in (t_utc_ns, self._t))
        earth_km_s = np.stack(
            [np.interp(seconds, steps_s, each) for each in self._earth_km_s.T], axis=-1
        )
        light_s = np.linalg.norm(r - site_km, axis=-1, keepdims=True) / LIGHT_KM_S
        line = r - site_km - (v + earth_km_s) * light_s
        along = line / np.linalg.norm(line, axis=-1, keepdims=True)
        light_rate = np.sum(along * (v - site_km_s), axis=-1, keepdims=True) / LIGHT_KM_S
        return _Arcs(
            row=rows,
            t_utc_ns=t_utc_ns,
            line_km=line,
            line_km_s=v * (1.0 - light_rate) - site_km_s - earth_km_s * light_rate,
            line_km_s2=-MU_EARTH_KM3_S2 * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3,
            up=up,
            up_s=np.cross(_EARTH_TURN_RAD_S, up),
            r_km=r,
        )

    def _inside(self, arcs: _Arcs) -> tuple[FloatArray, FloatArray]:
        """Seconds (K,) from which and to which lines are in the field and above the horizon.

        The first is after the last where they never are.
        """
        half = np.full(len(arcs.row), self._fine_s / 2.0)
        cone = float(np.sin(self._radius_rad) ** 2)

        def beside(vectors: FloatArray) -> FloatArray:
            return vectors - _dot(vectors, self._centre)[:, None] * self._centre

        def depth(s: FloatArray) -> FloatArray:
            """Positive in the field, with its one maximum where the line is deepest in the cone."""
            line = arcs.lines_km(s)
            inside = cone * _dot(line, line) - _dot(beside(line), beside(line))
            return np.where(_dot(line, self._centre) > 0.0, inside, -1.0)

        def sinking(s: FloatArray) -> FloatArray:
            line, moves = arcs.lines_km(s), arcs.line_km_s + s[:, None] * arcs.line_km_s2
            return _dot(beside(line), beside(moves)) - cone * _dot(line, moves)

        deepest = _crossed(sinking, -half, half)
        first_s = -_crossed(lambda s: -depth(-s), -deepest, half)
        last_s = _crossed(lambda s: -depth(s), deepest, half)
        rises, sets = arcs.ups_km(-half) <= 0.0, arcs.ups_km(half) <= 0.0
        horizon = _crossed(lambda s: np.where(rises, 1.0, -1.0) * arcs.ups_km(s), -half, half)
        first_s = np.where(rises, np.maximum(first_s, horizon), first_s)
        last_s = np.where(sets, np.minimum(last_s, horizon), last_s)
        is_never = (depth(deepest) <= 0.0) | (rises & sets)
        return np.where(is_never, np.inf, first_s), np.where(is_never, -np.inf, last_s)

    def _nearest(
        self, arcs: _Arcs, first_s: FloatArray, last_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Seconds (K,) at which lines are nearest to the centre, and the cosines of that angle."""

        def receding(s: FloatArray) -> FloatArray:
            line, moves = arcs.lines_km(s), arcs.line_km_s + s[:, None] * arcs.line_km_s2
            along = _dot(line, moves) / _dot(line, line)
            return along * _dot(line, self._centre) - _dot(moves, self._centre)

        s = _crossed(receding, first_s, last_s)
        line = arcs.lines_km(s)
        return s, _dot(line, self._centre) / np.sqrt(_dot(line, line))

    def _crossing(self, entry: CatalogueEntry, three: _Arcs, s: FloatArray) -> FieldCrossing:
        """The crossing that begins, is nearest and ends ``s`` (3,) seconds from three instants."""
        lines = three.lines_km(s)
        range_km = float(np.linalg.norm(lines[1]))
        along = lines[1] / range_km
        move = (three.line_km_s[1] + s[1] * three.line_km_s2[1]) / range_km
        east = np.array([-along[1], along[0], 0.0]) / max(float(np.hypot(*along[:2])), 1e-12)
        by_east, by_north = float(move @ east), float(move @ np.cross(along, east))
        ra_deg, dec_deg = unit_to_direction(lines)
        up = three.ups_km(s) / np.sqrt(_dot(lines, lines))
        t_utc_ns = np.clip(three.t_utc_ns + np.rint(s * NS_PER_S).astype(np.int64), *self._span)
        enter, nearest, leave = (
            FieldPoint(
                t_utc_ns=int(t_utc_ns[n]),
                ra_icrs_deg=float(ra_deg[n]),
                dec_icrs_deg=float(dec_deg[n]),
                alt_deg=float(np.degrees(np.arcsin(np.clip(up[n], -1.0, 1.0)))),
            )
            for n in range(3)
        )
        r_km = three.r_km[1]
        site_km = site_gcrs(self._site, np.array([nearest.t_utc_ns]))[0][0]
        age_days = (nearest.t_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY
        return FieldCrossing(
            norad_id=entry.norad_id,
            name=entry.name or str(entry.norad_id),
            enter=enter,
            nearest=nearest,
            leave=leave,
            offset_deg=math.degrees(_angle(along, self._centre)),
            motion_deg=math.degrees(math.atan2(by_east, by_north)) % 360.0,
            rate_arcsec_s=math.degrees(math.hypot(by_east, by_north)) * 3600.0,
            range_km=range_km,
            height_km=float(np.linalg.norm(r_km)) - EARTH_RADIUS_KM,
            is_lit=bool(lit_fraction(r_km, nearest.t_utc_ns) >= LIT_SHARE),
            phase_deg=float(phase_angle_deg(site_km + lines[1], site_km, nearest.t_utc_ns)),
            tle_age_days=age_days,
            sigma_s=self._sigma_s(entry, age_days, r_km),
        )

    def _sigma_s(self, entry: CatalogueEntry, age_days: float, r_km: FloatArray) -> float:
        regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
        spread = self._errors.spread_for(regime, is_moved=False)
        speed_km_s = entry.revolutions_a_day * 2.0 * np.pi / 86_400.0 * np.linalg.norm(r_km)
        return float(position_sigmas_km(spread, age_days)[1] / speed_km_s)


def _crossed(
    rising: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Places (K,) from ``low`` to ``high`` at which rising functions pass zero, by halving.

    ``high`` where a function stays below zero, ``low`` where it is above from the beginning.
    """
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_above = rising(middle) > 0.0
        low, high = np.where(is_above, low, middle), np.where(is_above, middle, high)
    return 0.5 * (low + high)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between two unit vectors, rad; exact for small ones too."""
    return 2.0 * math.asin(min(float(np.linalg.norm(a - b)) / 2.0, 1.0))
