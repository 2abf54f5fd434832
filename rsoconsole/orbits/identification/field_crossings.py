"""Catalogued objects that can have crossed a field during an exposure. Pure.

An object may be ahead of its elements or behind them by some seconds, and off its path by some
angle. It is a candidate where its path within these bounds enters the field during the exposure.
Three sieves, each finer and slower than the one before, look at:

- how far the object can be from its nominal place;
- its path at steps of its lead;
- its streak as drawn in the frame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from sgp4.api import SatrecArray

from rsoconsole.orbits.elements.catalogue import CatalogueEntry, nearest_epoch_entries
from rsoconsole.orbits.elements.sky_paths import Exposure, ObjectPlaces, streak_path
from rsoconsole.orbits.identification.element_errors import (
    ASSUMED,
    ERROR_REGIMES,
    ElementErrors,
    manoeuvred_probabilities,
    position_sigmas_km,
    regime_numbers,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.words import NS_PER_DAY

GATE_SIGMAS = 3.0
OLDEST_DAYS = 60.0
"""Largest age of elements that are used; errors of older ones are not known."""
LOW_GATE_S = 60.0
"""Smallest gate along the path of a low object, as time."""
MAX_GATE_S = 600.0
_STRANGE_SHARE = 0.03
_STRANGE_TIMES = 2.0
"""Width of errors that no model describes, over that of a manoeuvre."""
_STRANGE_LOW_KM = 200.0
"""Along-track error of a low object that no model describes: 27 s along its orbit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementSpread:
    """Errors of M element sets in three cases: undisturbed, manoeuvred, strange.

    Arrays (M, 3), a column for each case; strange errors are those that no model describes.
    """

    share: FloatArray
    radial_km: FloatArray
    """One sigma, radial; ``along_km`` and ``across_km`` are one sigma too."""
    along_km: FloatArray
    across_km: FloatArray
    gate_along_km: FloatArray
    """Largest errors (M,) along the path that are searched."""

    def subset(self, chosen: npt.NDArray[np.intp]) -> "ElementSpread":
        """Errors of the chosen element sets."""
        return ElementSpread(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


def element_spread(
    regimes: npt.NDArray[np.intp],
    age_days: FloatArray,
    speed_km_s: FloatArray,
    errors: ElementErrors = ASSUMED,
) -> ElementSpread:
    """Errors of M element sets by kind of orbit (``regime_numbers``), age and speed."""
    count = len(regimes)
    share, radial, along, across = (np.zeros((count, 3)) for _ in range(4))
    for number, regime in enumerate(ERROR_REGIMES):
        here = np.flatnonzero(regimes == number)
        age = age_days[here]
        moved = manoeuvred_probabilities(regime, age)
        known = 1.0 - _STRANGE_SHARE
        share[here] = np.stack(
            [known * (1.0 - moved), known * moved, np.full(len(here), _STRANGE_SHARE)], axis=-1
        )
        for case in range(2):
            sigmas = position_sigmas_km(errors.spread_for(regime, is_moved=case == 1), age)
            radial[here, case], along[here, case], across[here, case] = sigmas
        for each in (radial, along, across):
            each[here, 2] = _STRANGE_TIMES * each[here, 1]
        if regime == "LEO":
            # What is late by drag keeps its plane.
            across[here, 2] = across[here, 1]
            along[here, 2] = np.maximum(_STRANGE_LOW_KM, along[here, 1])
    gate = GATE_SIGMAS * np.maximum(along[:, 1], along[:, 0])
    gate = np.where(
        regimes == ERROR_REGIMES.index("LEO"), np.maximum(gate, LOW_GATE_S * speed_km_s), gate
    )
    return ElementSpread(
        share=share,
        radial_km=radial,
        along_km=along,
        across_km=across,
        gate_along_km=np.minimum(gate, MAX_GATE_S * speed_km_s),
    )


_STEP_S = 10.0
_LEADS = (41, 801)
"""Fewest and most leads of the window in which a candidate is near the field."""
_PARTS = (5, 81)
"""Fewest and most parts of an exposure's path."""
_FINE = 0.4
"""Longest step along a path, as a share of the field's radius."""
_SAME_SETS_NS = NS_PER_DAY // 4
"""Longest time for which the sets nearest in epoch are kept."""
_ACROSS_NODES = ((-np.sqrt(3.0), 1.0 / 6.0), (0.0, 2.0 / 3.0), (np.sqrt(3.0), 1.0 / 6.0))
"""Nodes of a normal distribution, in sigma, with their weights (Gauss and Hermite)."""
IndexArray = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldOfView:
    """Field of view of one exposure."""

    site: Site
    t_mid_utc_ns: int
    exposure_s: float
    centre: FloatArray
    """Unit vector (3,) of the centre."""
    radius_rad: float
    """Angle from the centre to the farthest corner."""
    area_rad2: float
    contains: Callable[[FloatArray], npt.NDArray[np.bool_]]
    """Function from unit vectors (..., 3) to a mask (...), True for those in the frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A catalogued object that can have crossed a field."""

    entry: CatalogueEntry
    satellite: SatrecArray
    spread: ElementSpread
    age_days: float
    """Age of its elements; below 0 where their epoch is after the exposure."""
    gate_s: float
    """Largest lead or lag over its elements that is searched, s."""
    gate_across_rad: float
    """Largest angle off its path that is searched, where the path is nearest to the field."""
    chance: float
    """Probability that any part of its streak was in the frame."""
    lead_s: FloatArray
    """Leads (L,) over its elements, s, at which it is near the field."""
    u: FloatArray
    """Unit vectors (L, 3) towards it at these leads, at the middle of the exposure."""
    nominal: FloatArray
    """Unit vectors (3, 3) at opening, middle and closing, for a lead of 0."""
    r_km: FloatArray
    """Position (3,), GCRS, at the middle of the exposure, for a lead of 0."""
    range_km: float
    rate: FloatArray
    """Change (3,) of its unit vector for each second, for a lead of 0, rad/s."""


class FieldCatalogue:
    """Element sets prepared for the search of frame after frame."""

    def __init__(self, entries: Sequence[CatalogueEntry], errors: ElementErrors = ASSUMED) -> None:
        """``errors``: of the elements."""
        self._entries = entries
        self._errors = errors
        self._at_utc_ns: int | None = None
        self._sets: tuple[CatalogueEntry, ...] = ()
        self._too_old = 0
        self.without_place: tuple[CatalogueEntry, ...] = ()
        """Objects for which SGP4 has no place at the last frame."""

    @property
    def compared_count(self) -> int:
        """Number of objects compared with the last frame."""
        return len(self._sets)

    @property
    def too_old_count(self) -> int:
        """Number of objects left out for the last frame because their elements were too old."""
        return self._too_old

    def _choose(self, t_utc_ns: int) -> None:
        if self._at_utc_ns is not None and abs(t_utc_ns - self._at_utc_ns) < _SAME_SETS_NS:
            return
        nearest = nearest_epoch_entries(self._entries, t_utc_ns)
        most_ns = OLDEST_DAYS * NS_PER_DAY
        self._sets = tuple(e for e in nearest if abs(t_utc_ns - e.epoch_utc_ns) <= most_ns)
        self._too_old = len(nearest) - len(self._sets)
        self._at_utc_ns = t_utc_ns
        self._satellites = SatrecArray([each.record for each in self._sets])
        self._epoch_ns = np.array([each.epoch_utc_ns for each in self._sets], np.int64)
        self._regimes = regime_numbers(
            np.array([each.revolutions_a_day for each in self._sets]),
            np.array([each.eccentricity for each in self._sets]),
        )

    def candidates(self, view: FieldOfView) -> tuple[Candidate, ...]:
        """Objects that can have crossed a field, in order of catalogue number."""
        self._choose(view.t_mid_utc_ns)
        if not self._sets:
            return ()
        exposure = Exposure(view.site, view.t_mid_utc_ns, view.exposure_s)
        near, spread = self._reachable(view, exposure)
        found: list[Candidate] = []
        for rows, windows in self._windows(view, exposure, near, spread):
            found.extend(
                candidate
                for row, window in zip(rows, windows, strict=True)
                if (candidate := self._candidate(view, exposure, (near, spread), row, window))
            )
        return tuple(sorted(found, key=lambda each: each.entry.norad_id))

    def _reachable(self, view: FieldOfView, exposure: Exposure) -> tuple[IndexArray, ElementSpread]:
        """Indices of the sets whose objects can come near, and their errors.

        By a ball about the place where each object is now.
        """
        seen = exposure.middle.places_at_leads(self._satellites, np.zeros(1))
        speed = np.linalg.norm(seen.v_km_s[:, 0], axis=-1)
        is_there = np.isfinite(speed)
        self.without_place = tuple(self._sets[n] for n in np.flatnonzero(~is_there))
        age_days = (view.t_mid_utc_ns - self._epoch_ns) / NS_PER_DAY
        speed_known = np.where(is_there, speed, 1.0)
        spread = element_spread(self._regimes, age_days, speed_known, self._errors)
        across = GATE_SIGMAS * np.hypot(spread.across_km[:, 1], spread.radial_km[:, 1])
        ball_km = spread.gate_along_km + across + speed * view.exposure_s
        with np.errstate(invalid="ignore"):
            off = np.arccos(np.clip(seen.u[:, 0] @ view.centre, -1.0, 1.0))
            size = np.arcsin(np.clip(ball_km / seen.range_km[:, 0], 0.0, 1.0))
            is_near = off <= size + view.radius_rad
        is_near |= ball_km >= seen.range_km[:, 0]
        near = np.flatnonzero(is_near & is_there)
        return near, spread.subset(near)

    def _windows(
        self, view: FieldOfView, exposure: Exposure, near: IndexArray, spread: ElementSpread
    ) -> list[tuple[IndexArray, list[tuple[float, float]]]]:
        """Rows of ``near`` and the leads from and to which each is near the field."""
        if not len(near):
            return []
        satellites = SatrecArray([self._sets[n].record for n in near])
        now = exposure.middle.places_at_leads(satellites, np.zeros(1))
        gate_s = spread.gate_along_km / np.linalg.norm(now.v_km_s[:, 0], axis=-1)
        found = []
        low = 0.0
        for high in (60.0, 200.0, np.inf):
            rows = np.flatnonzero((gate_s > low) & (gate_s <= high))
            low = high
            if not len(rows):
                continue
            most_s = float(np.max(gate_s[rows]))
            steps = max(3, int(np.ceil(most_s / _STEP_S)))
            leads = np.linspace(-most_s, most_s, 2 * steps + 1)
            chosen = SatrecArray([self._sets[near[n]].record for n in rows])
            seen = exposure.middle.places_at_leads(chosen, leads)
            across = GATE_SIGMAS * np.max(
                np.hypot(spread.across_km[rows, :2], spread.radial_km[rows, :2]), axis=-1
            )
            reach = view.radius_rad + across[:, None] / seen.range_km[:, :-1]
            rate = np.linalg.norm(seen.by_time, axis=-1)
            reach = reach + np.maximum(rate[:, :-1], rate[:, 1:]) * view.exposure_s / 2.0
            off = _nearest_rad(seen.u[:, :-1], seen.u[:, 1:], view.centre)
            is_near = off <= reach
            kept = np.flatnonzero(is_near.any(axis=1))
            windows = []
            for row in kept:
                steps_in = np.flatnonzero(is_near[row])
                gate = float(gate_s[rows[row]])
                first, last = leads[steps_in[0]], leads[steps_in[-1] + 1]
                windows.append((max(float(first), -gate), min(float(last), gate)))
            inside = [n for n, (first, last) in enumerate(windows) if last > first]
            found.append((rows[kept[inside]], [windows[n] for n in inside]))
        return found

    def _candidate(
        self,
        view: FieldOfView,
        exposure: Exposure,
        of: tuple[IndexArray, ElementSpread],
        row: int,
        window: tuple[float, float],
    ) -> Candidate | None:
        near, spreads = of
        entry, spread = self._sets[near[row]], spreads.subset(np.array([row]))
        satellite = SatrecArray([entry.record])
        leads = _leads(view, exposure, satellite, window)
        opening, middle, closing = exposure.places_through_exposure(
            satellite, np.append(leads, 0.0)
        )
        if not np.all(np.isfinite(middle.u)):
            return None
        speed = float(np.linalg.norm(middle.v_km_s[0, -1]))
        across, sigma_across = across_track_sigmas(spread, middle)
        ends = opening.u[0, :-1], closing.u[0, :-1]
        longest = float(np.linalg.norm(ends[1] - ends[0], axis=-1).max())
        parts = int(np.clip(np.ceil(longest / (_FINE * view.radius_rad)) + 1, *_PARTS))
        paths = streak_path(ends[0], middle.u[0, :-1], ends[1], parts)
        nodes = np.array([sigmas for sigmas, _ in _ACROSS_NODES])
        off = np.einsum("lc,lk,n->clnk", sigma_across[0, :-1], across[0, :-1], nodes)
        # (cases, L, nodes)
        is_in = view.contains(paths[None, :, None] + off[:, :, :, None]).any(axis=-1)
        if not is_in.any():
            return None
        along_s = spread.along_km[0] / speed
        density = np.exp(-0.5 * (leads / along_s[:, None]) ** 2) / (
            along_s[:, None] * np.sqrt(2.0 * np.pi)
        )
        inside = is_in @ np.array([weight for _, weight in _ACROSS_NODES])
        chances = np.trapezoid(density * inside, leads, axis=-1)
        # A window much wider than what the case allows is not resolved by its leads.
        step = leads[1] - leads[0]
        at_zero = float(np.interp(0.0, leads, inside[0])) if leads[0] <= 0.0 <= leads[-1] else 0.0
        chances = np.where(along_s < step, at_zero, np.minimum(chances, 1.0))
        nearest = int(np.argmax(middle.u[0, :-1] @ view.centre))
        known = np.max(sigma_across[0, nearest, :2])
        return Candidate(
            entry=entry,
            satellite=satellite,
            spread=spread,
            age_days=(view.t_mid_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY,
            gate_s=float(spread.gate_along_km[0]) / speed,
            gate_across_rad=GATE_SIGMAS * float(known),
            chance=float(chances @ spread.share[0]),
            lead_s=leads,
            u=middle.u[0, :-1],
            nominal=np.stack([each.u[0, -1] for each in (opening, middle, closing)]),
            r_km=middle.r_km[0, -1],
            range_km=float(middle.range_km[0, -1]),
            rate=middle.by_time[0, -1],
        )


def _leads(
    view: FieldOfView, exposure: Exposure, satellite: SatrecArray, window: tuple[float, float]
) -> FloatArray:
    """Leads so close together that none steps over the field."""
    seen = exposure.middle.places_at_leads(satellite, np.linspace(*window, 5))
    pace = float(np.nan_to_num(np.linalg.norm(seen.by_lead[0], axis=-1)).max())
    path = pace * (window[1] - window[0])
    count = int(np.clip(np.ceil(path / (_FINE * view.radius_rad)) + 1, *_LEADS))
    return np.linspace(*window, count)


def across_track_sigmas(spread: ElementSpread, seen: ObjectPlaces) -> tuple[FloatArray, FloatArray]:
    """Unit vectors across the paths of objects, and sigmas of the error in this direction, rad.

    Vectors (M objects, L leads, 3), towards the north for an eastward motion; sigmas (M, L, 3), by
    the three cases of ``ElementSpread``.
    """
    across, radial, pole = across_track_components(seen)
    by_radial = radial[..., None] * spread.radial_km[:, None, :]
    by_pole = pole[..., None] * spread.across_km[:, None, :]
    return across, np.hypot(by_radial, by_pole) / seen.range_km[..., None]


def across_track_components(seen: ObjectPlaces) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors across the paths of objects, and their radial and polar components.

    Vectors (M objects, L leads, 3); components (M, L) along the radius of the orbit, and (M, L)
    along its pole.
    """
    r, v = seen.r_km, seen.v_km_s
    across = np.cross(seen.u, seen.by_lead)
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-30)
    radial = r / np.linalg.norm(r, axis=-1, keepdims=True)
    pole = np.cross(r, v)
    pole = pole / np.linalg.norm(pole, axis=-1, keepdims=True)
    return across, np.sum(across * radial, axis=-1), np.sum(across * pole, axis=-1)


def _nearest_rad(a: FloatArray, b: FloatArray, to: FloatArray) -> FloatArray:
    """Smallest angles (...,) between arcs of unit vectors (..., 3) and one vector (3,).

    Infinite for an arc of NaN.
    """
    along = b - a
    size = np.maximum(np.sum(along * along, axis=-1), 1e-30)
    at = np.clip(np.sum((to - a) * along, axis=-1) / size, 0.0, 1.0)
    foot = a + at[..., None] * along
    cosine = foot @ to / np.linalg.norm(foot, axis=-1)
    return np.asarray(np.where(np.isfinite(cosine), np.arccos(np.clip(cosine, -1, 1)), np.inf))
