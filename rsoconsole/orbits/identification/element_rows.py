"""Errors of elements: observed minus computed of surely identified tracks. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.elements.catalogue import states_gcrs
from rsoconsole.orbits.identification.element_errors import Regime, orbit_regime
from rsoconsole.orbits.identification.single import CatalogueComparison, Identification
from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD
from rsoconsole.words import NS_PER_S

SURE_NAMED = 0.95
"""Least probability of an identification that makes a row."""
_NIGHT_NS = 8 * 3600 * NS_PER_S
"""Pause of one object after which another night begins."""
_MIN_SEEN = 0.1
"""Least share of the orbital motion that is across the line of sight for a measured place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementErrorRow:
    """One track of one night compared with the elements of its object."""

    session: str
    track: str
    norad_id: int
    name: str
    t_utc_ns: int
    """Instant of the track's middle."""
    tle_epoch_utc_ns: int
    age_days: float
    """Age of the elements, days; negative where their epoch is after the track."""
    regime: Regime
    along_s: float
    """Observed minus computed along the orbit, s; positive: the object is ahead of its elements."""
    sigma_along_s: float
    """One sigma of ``along_s`` by the measurement alone; so are the other sigmas."""
    along_km: float
    """Observed minus computed along the orbit."""
    sigma_along_km: float
    across_arcsec: float
    """Observed minus computed across the motion; positive to the north of an eastward motion."""
    sigma_across_arcsec: float
    across_km: float
    """Observed minus computed across the motion, at the object's distance."""
    sigma_across_km: float
    along_by: tuple[float, float, float]
    """Change of ``along_km`` by a kilometre of error in the orbit: radial, along, across."""
    across_by: tuple[float, float, float]
    """Change of ``across_km`` by a kilometre of error in the orbit: radial, along, across."""
    observations: int
    probability: float
    standard_mag: float | None = None
    """Median of the track's V magnitudes at 1000 km and 90 deg; None where they are too few."""
    standard_mag_sigma: float | None = None
    """Robust scatter of one of them."""

    @property
    def key(self) -> tuple[str, str]:
        """Session and track; a new row with the same key replaces the earlier one."""
        return (self.session, self.track)


def element_error_row(
    session: str, track: str, compared: CatalogueComparison, found: Identification
) -> ElementErrorRow | None:
    """Return the row of one track; None where the object is not identified with certainty.

    Also None where the object moves nearly along the line of sight.
    """
    if found.verdict != "identified" or found.matches[0].probability < SURE_NAMED:
        return None
    match, with_all = found.matches[0], compared.found
    n = next(i for i, each in enumerate(with_all.entries) if each.norad_id == match.norad_id)
    scale = float(with_all.range_km[n]) * ARCSEC_RAD
    along_by, across_by = with_all.by_errors[n][:2, :3] * scale
    if along_by[1] < _MIN_SEEN:
        return None
    sigma_along, sigma_across = np.sqrt(np.diag(with_all.covariance[n])[:2]).tolist()
    per_arcsec = scale / float(along_by[1])
    entry = with_all.entries[n]
    _, (v,) = states_gcrs((entry,), np.array([found.t_utc_ns], np.int64))
    speed_km_s = float(np.linalg.norm(v))
    along_km, sigma_along_km = match.along_track_arcsec * per_arcsec, sigma_along * per_arcsec
    return ElementErrorRow(
        session=session,
        track=track,
        norad_id=match.norad_id,
        name=match.name,
        t_utc_ns=found.t_utc_ns,
        tle_epoch_utc_ns=match.tle_epoch_utc_ns,
        age_days=match.tle_age_days,
        regime=orbit_regime(entry.revolutions_a_day, entry.eccentricity),
        along_s=along_km / speed_km_s,
        sigma_along_s=sigma_along_km / speed_km_s,
        along_km=along_km,
        sigma_along_km=sigma_along_km,
        across_arcsec=match.cross_track_arcsec,
        sigma_across_arcsec=sigma_across,
        across_km=match.cross_track_arcsec * scale,
        sigma_across_km=sigma_across * scale,
        along_by=_three(along_by / float(along_by[1])),
        across_by=_three(across_by),
        observations=len(compared.seen),
        probability=match.probability,
    )


def _three(values: FloatArray) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))


def rows_by_shared_error(rows: Sequence[ElementErrorRow]) -> list[list[int]]:
    """Groups of rows that share an error, as indices into ``rows``.

    A group is of one object, in one night or by one element set.
    """
    order = sorted(range(len(rows)), key=lambda n: (rows[n].norad_id, rows[n].t_utc_ns))
    groups: list[list[int]] = []
    by_elements: dict[tuple[int, int], list[int]] = {}
    last: ElementErrorRow | None = None
    of_last: list[int] = []
    for n in order:
        row = rows[n]
        is_same_night = (
            last is not None
            and last.norad_id == row.norad_id
            and row.t_utc_ns - last.t_utc_ns <= _NIGHT_NS
        )
        elements = (row.norad_id, row.tle_epoch_utc_ns)
        group = by_elements.get(elements) or (of_last if is_same_night else [])
        if not group:
            groups.append(group)
        group.append(n)
        by_elements[elements] = group
        last, of_last = row, group
    return groups
