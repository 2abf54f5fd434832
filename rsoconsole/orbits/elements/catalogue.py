"""Catalogued objects: their places by SGP4, and how one is found by its name. Pure."""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from sgp4.api import Satrec, SatrecArray

from rsoconsole.base import OrbitError
from rsoconsole.orbits.elements.elements import ElementSet
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    IntArray,
    SkyPlaces,
    astrometric_places,
    jd_utc,
    lit_fraction,
    phase_angle_deg,
    teme_to_gcrs_rotation,
)
from rsoconsole.words import catalogued_name


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueEntry:
    """One element set of one object, ready for SGP4."""

    name: str
    norad_id: int
    epoch_utc_ns: int
    record: Satrec

    @property
    def revolutions_a_day(self) -> float:
        """Mean motion as published, revolutions a day."""
        return float(self.record.no_kozai) * 720.0 / np.pi

    @property
    def eccentricity(self) -> float:
        """Eccentricity as published."""
        return float(self.record.ecco)


def nearest_epoch_entries(
    entries: Iterable[CatalogueEntry], t_utc_ns: int
) -> tuple[CatalogueEntry, ...]:
    """Return each object's element set nearest in epoch to an instant.

    The sets are in order of catalogue number.
    """
    best: dict[int, CatalogueEntry] = {}
    for each in entries:
        rival = best.get(each.norad_id)
        if rival is None or abs(each.epoch_utc_ns - t_utc_ns) < abs(rival.epoch_utc_ns - t_utc_ns):
            best[each.norad_id] = each
    return tuple(best[number] for number in sorted(best))


def states_gcrs(
    entries: Sequence[CatalogueEntry], t_utc_ns: IntArray
) -> tuple[FloatArray, FloatArray]:
    """GCRS positions and velocities (M, N, 3) of M objects at N instants, km and km/s.

    NaN where SGP4 fails (decayed, or elements that it refuses).
    """
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    if not entries:
        return np.empty((0, len(t), 3)), np.empty((0, len(t), 3))
    jd_1, jd_2 = jd_utc(t)
    failed, r_teme, v_teme = SatrecArray([each.record for each in entries]).sgp4(
        np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
    )
    return _in_gcrs(t, failed, r_teme, v_teme)


def _in_gcrs(
    t_utc_ns: IntArray, failed: IntArray, r_teme: FloatArray, v_teme: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotate SGP4's positions and velocities (..., N, 3) to GCRS axes.

    NaN where SGP4 failed (..., N).
    """
    rotation, is_good = teme_to_gcrs_rotation(t_utc_ns), (failed == 0)[..., None]
    r, v = (np.einsum("nij,...nj->...ni", rotation, each) for each in (r_teme, v_teme))
    return np.where(is_good, r, np.nan), np.where(is_good, v, np.nan)


def object_places(entry: CatalogueEntry, site: Site, t_utc_ns: IntArray) -> SkyPlaces:
    """Places of one object at instants (N,), as a plate solution measures them.

    NaN where SGP4 fails.
    """

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        r, v = states_gcrs((entry,), at)
        return r[0], v[0]

    return astrometric_places(position_of, site, t_utc_ns)


def entry_of_lines(element_set: ElementSet) -> CatalogueEntry:
    """Return the entry of two lines. Raises OrbitError where SGP4 refuses them."""
    try:
        record = Satrec.twoline2rv(element_set.line_1, element_set.line_2)
    except ValueError as error:
        raise OrbitError(f"satellite {element_set.norad_id}: {error}") from error
    return CatalogueEntry(
        name=element_set.name,
        norad_id=element_set.norad_id,
        epoch_utc_ns=element_set.epoch_utc_ns,
        record=record,
    )


_DECAYED = 6


def failure_words(code: int) -> str:
    """Return why SGP4 gives no place, by its error code (AIAA 2006-6753)."""
    if code == _DECAYED:
        return "SGP4 has no place for it: it has come down by then (error 6)"
    return f"SGP4 has no place for it: its elements become those of no orbit (error {code})"


LISTED = 8


def find_object(entries: Sequence[CatalogueEntry], wanted: str) -> tuple[CatalogueEntry, ...]:
    """Find every element set of one object by its number or name.

    ``wanted``: a catalogue number, or a name. A part of the catalogued name is enough, case and
    punctuation ignored, if it fits one object only. Raises OrbitError for an ambiguous name
    (listing the candidates) and for an unknown one (listing the nearest names).
    """
    text = wanted.strip()
    if text.isdecimal():
        of_number = tuple(each for each in entries if each.norad_id == int(text))
        if of_number:
            return of_number
    plain = _plain(text)
    whole = [each for each in entries if plain and _plain(each.name) == plain]
    found = whole or [each for each in entries if plain and plain in _plain(each.name)]
    numbers = {each.norad_id for each in found}
    if len(numbers) == 1:
        return tuple(found)
    if numbers:
        raise OrbitError(
            f"{wanted!r} is {len(numbers)} objects: {_listed(found)}; name one by its number"
        )
    raise OrbitError(f"no object is called {wanted!r}{_near(entries, text)}")


def _plain(name: str) -> str:
    """Name as letters and digits alone, words apart: INTELSAT-14 and Intelsat 14 are one."""
    return re.sub(r"[^a-z0-9]+", " ", name.casefold()).strip()


def _listed(entries: Iterable[CatalogueEntry]) -> str:
    names = {each.norad_id: each.name for each in entries}
    words = [catalogued_name(name, number) for number, name in sorted(names.items())]
    more = len(words) - LISTED
    return ", ".join(words[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _near(entries: Sequence[CatalogueEntry], text: str) -> str:
    if not entries:
        return ": there are no element sets; give some with --tle FILE"
    by_plain = {_plain(each.name): each for each in entries if each.name}
    near = difflib.get_close_matches(_plain(text), by_plain, n=3, cutoff=0.5)
    if not near:
        count = len({each.norad_id for each in entries})
        return f" among {count} objects: give another file with --tle FILE"
    return f"; near it: {_listed(by_plain[name] for name in near)}"


STANDARD_RANGE_KM = 36_000.0


class Satellite:
    """SGP4 for one element set, with places as a plate solution measures them.

    Raises OrbitError where SGP4 refuses the elements. At instants for which SGP4 fails (decayed)
    all results are NaN.
    """

    def __init__(
        self, element_set: ElementSet | CatalogueEntry, standard_magnitude: float = 11.0
    ) -> None:
        """``standard_magnitude``: of the object fully lit, at 36,000 km."""
        self.element_set = element_set
        self.standard_magnitude = standard_magnitude
        if isinstance(element_set, ElementSet):
            element_set = entry_of_lines(element_set)
        self.record = element_set.record
        if self.record.error:
            raise OrbitError(
                f"satellite {element_set.norad_id}: SGP4 refuses its elements "
                f"(error {self.record.error}); fetch a newer set"
            )

    def position_gcrs(self, t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """GCRS position (N, 3) km and velocity (N, 3) km/s."""
        t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
        jd_1, jd_2 = jd_utc(t)
        failed, r_teme, v_teme = self.record.sgp4_array(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        return _in_gcrs(t, failed, r_teme, v_teme)

    def astrometric_place(self, site: Site, t_utc_ns: IntArray) -> SkyPlaces:
        """Places, ranges and rates at instants (N,), to compare with measured directions."""
        return astrometric_places(self.position_gcrs, site, t_utc_ns)

    def magnitude(self, places: SkyPlaces) -> FloatArray:
        """Magnitudes (N,) of a diffuse sphere at these places; inf in the umbra."""
        lit = lit_fraction(places.position_gcrs_km, places.t_utc_ns)
        phase = phase_angle_deg(places.position_gcrs_km, places.site_gcrs_km, places.t_utc_ns)
        return magnitude(self.standard_magnitude, places.range_km, phase, lit)


def magnitude(
    standard_magnitude: float,
    range_km: FloatArray,
    phase_angle_deg: FloatArray,
    lit_fraction: FloatArray,
) -> FloatArray:
    """Magnitude of a diffuse (Lambert) sphere.

    ``standard_magnitude``: at full phase and 36,000 km. ``lit_fraction``: share of the sunlight
    that reaches it, 0 in the umbra to 1.
    """
    phase = np.radians(phase_angle_deg)
    shine = ((np.pi - phase) * np.cos(phase) + np.sin(phase)) / np.pi * lit_fraction
    with np.errstate(divide="ignore"):
        dimming = -2.5 * np.log10(np.maximum(shine, 0.0))
    return np.asarray(standard_magnitude + 5.0 * np.log10(range_km / STANDARD_RANGE_KM) + dimming)
