"""Rows of exported tables: a measurement with the results of its track, and their columns."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, get_args

from rsoconsole.night import FRAME_FACTS, NightFrame, frame_quantities
from rsoconsole.orbits import reduced_magnitude
from rsoconsole.pipeline import RangeAndPhase, ranges_by_orbit
from rsoconsole.records import (
    TABLES,
    Column,
    ColumnType,
    Measurement,
    OrbitEstimate,
    Site,
    StreakLight,
    TrackState,
    column_value,
)
from rsoconsole.sky import wrap_360
from rsoconsole.tracking import sky_covariance_arcsec2, sky_rate_arcsec_s
from rsoconsole.words import utc_ns_to_iso

AS_RECORDED = ""
"""Stands for the meaning of a column that has the same meaning in the session's tables."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredRow:
    """One measurement of one frame; fields of the track are None where it is assigned to none.

    Directions are ICRS, astrometric, in degrees; errors and residuals on the sky in arcsec, those
    in right ascension times cos Dec; pixels 0-based.
    """

    frame_id: Annotated[int, AS_RECORDED]
    track: Annotated[int | None, "track that took it, from 1 in order of time"]
    t_mid_utc_ns: Annotated[int, "the same since 1970-01-01, POSIX count"]
    """Mid-exposure by the shutter, UTC nanoseconds; ``t_mid_utc`` is the same instant as text."""
    exposure_s: Annotated[float | None, AS_RECORDED]
    ra_icrs_deg: Annotated[float, "measured right ascension, astrometric"]
    dec_icrs_deg: Annotated[float, "measured declination, astrometric"]
    sigma_ra_arcsec: Annotated[float, "one sigma in right ascension times cos Dec"]
    sigma_dec_arcsec: Annotated[float, "one sigma in declination"]
    correlation: Annotated[float, "of both errors"]
    x_px: Annotated[float, "column of the streak's midpoint, 0-based"]
    y_px: Annotated[float, "row of it"]
    confidence: Annotated[float, AS_RECORDED]
    source: Annotated[str, AS_RECORDED]
    is_clipped: Annotated[bool, AS_RECORDED]
    """True for a streak cut by the frame's edge: only the position across it is measured."""
    is_taken: Annotated[bool, "a track took it"]
    not_taken_because: Annotated[str | None, "why none did"]
    """Reason why no track took the measurement; of a superseded one, why it was refused."""
    ra_a_icrs_deg: Annotated[float | None, "one end of the streak"]
    """Right ascension of one end of the streak; which end came first in time is not known."""
    dec_a_icrs_deg: Annotated[float | None, "one end of the streak"]
    ra_b_icrs_deg: Annotated[float | None, "its other end"]
    dec_b_icrs_deg: Annotated[float | None, "its other end"]
    predicted_ra_icrs_deg: Annotated[float | None, "where the track expected it"] = None
    predicted_dec_icrs_deg: Annotated[float | None, "where the track expected it"] = None
    predicted_sigma_ra_arcsec: Annotated[float | None, "one sigma of that, times cos Dec"] = None
    predicted_sigma_dec_arcsec: Annotated[float | None, "one sigma of that"] = None
    residual_ra_arcsec: Annotated[float | None, "measured minus predicted, times cos Dec"] = None
    residual_dec_arcsec: Annotated[float | None, "measured minus predicted"] = None
    sigma_residual_ra_arcsec: Annotated[float | None, "sqrt(S) of the innovation"] = None
    sigma_residual_dec_arcsec: Annotated[float | None, "sqrt(S) of the innovation"] = None
    nis: Annotated[float | None, "normalised innovation squared"] = None
    updated_ra_icrs_deg: Annotated[float | None, "the track after it"] = None
    updated_dec_icrs_deg: Annotated[float | None, "the track after it"] = None
    rate_ra_arcsec_s: Annotated[float | None, "motion of the track, times cos Dec"] = None
    rate_dec_arcsec_s: Annotated[float | None, "motion of the track"] = None
    mag: Annotated[float | None, AS_RECORDED] = None
    mag_sigma: Annotated[float | None, AS_RECORDED] = None
    """One sigma of ``mag`` by noise and zero point, without the object's unknown colour."""
    mag_sigma_colour: Annotated[float | None, AS_RECORDED] = None
    band: Annotated[str | None, AS_RECORDED] = None
    """"V", or "instrumental" where no star gave a zero point."""
    is_saturated: Annotated[bool | None, AS_RECORDED] = None
    """True where the streak has saturated pixels: the object is brighter than ``mag``."""
    range_km: Annotated[float | None, "distance by the track's last orbit, light time out"] = None
    """None without an orbit, and where its label says that it determines no distance."""
    phase_deg: Annotated[float | None, "angle at the object between Sun and site, by it"] = None
    reduced_mag: Annotated[float | None, "mag at 1000 km, 90 deg, as of a diffuse sphere"] = None
    """Of magnitudes in V of streaks that are not saturated; never without ``mag``."""
    is_superseded: Annotated[bool, "counts no more, by the operator's word"]
    """True where a decision of the operator replaced this result; only in exports of everything."""
    beside: tuple[tuple[str, Any], ...] = ()
    """Names and values of further recorded columns of the measurement and its frame."""

    def value(self, name: str) -> Any:
        """Return the value in a column; None where the column is empty."""
        found = dict(self.beside)
        return found[name] if name in found else getattr(self, name, None)

    @property
    def sigma_mag(self) -> float | None:
        """One sigma of ``mag`` with everything in it: noise, zero point and colour."""
        if self.mag_sigma is None:
            return None
        return math.hypot(self.mag_sigma, self.mag_sigma_colour or 0.0)

    @property
    def mag_v(self) -> float | None:
        """Apparent magnitude in V; None without a zero point, and of a saturated streak."""
        return self.mag if self.band == "V" and not self.is_saturated else None

    @property
    def t_mid_utc(self) -> str:
        """Mid-exposure as ISO 8601 text, UTC, to the nanosecond."""
        return utc_ns_to_iso(self.t_mid_utc_ns, decimals=9)

    @property
    def cov_sky_arcsec2(self) -> tuple[float, float, float]:
        """Covariance on the sky, arcsec^2: east-east, east-north, north-north."""
        east, north = self.sigma_ra_arcsec, self.sigma_dec_arcsec
        return east**2, self.correlation * east * north, north**2


_RECORDED = {
    column.name: column
    for name in ("image_quality", "photometry", "magnitudes", "frames", "measurements")
    for column in TABLES[name].columns
}


def _own_columns() -> Iterator[Column]:
    """Columns of the annotated fields: with meaning and type of their own, or as on record."""
    for each in fields(MeasuredRow):
        if (meaning := getattr(each.type, "__metadata__", None)) is None:
            continue
        if each.name == "t_mid_utc_ns":
            yield Column(name="t_mid_utc", type="text", meaning="mid-exposure by the shutter, UTC")
        kind = get_args(each.type)[0]
        kind = next(iter(get_args(kind)), kind)
        own = Column(name=each.name, type=_TYPES[kind], meaning=meaning[0])
        yield own if own.meaning else _RECORDED[each.name]


_TYPES: Mapping[type, ColumnType] = {int: "integer", float: "real", bool: "truth", str: "text"}
_OWN: tuple[Column, ...] = tuple(_own_columns())
_IN_OTHER_COLUMNS = frozenset(
    (*("cov_ee_arcsec2", "cov_en_arcsec2", "cov_nn_arcsec2"), *("ends_icrs_deg", "measurement_id"))
)
"""Columns of measurements on record that other columns replace here; the id has none."""
_BESIDE: tuple[Column, ...] = tuple(
    column
    for column in TABLES["measurements"].own
    if column.name not in {*_IN_OTHER_COLUMNS, *(own.name for own in _OWN)}
    and column.type != "json"
    and not (column.shape or column.has_sentence)
)
"""Remaining columns of a measurement on record that a cell of a table can hold."""
_OF_FRAME: tuple[Column, ...] = tuple(
    _RECORDED[fact.name] for fact in FRAME_FACTS if fact.name in _RECORDED
)
"""Image and sky quality of the frame."""
COLUMNS: tuple[Column, ...] = (*_OWN, *_BESIDE, *_OF_FRAME)
_SAME = MeasuredRow.__dataclass_fields__.keys() & Measurement.__dataclass_fields__.keys()
"""Fields that a row copies from the measurement."""


def make_measured_row(
    measurement: Measurement,
    frame: NightFrame,
    *,
    nis: float | None,
    predicted: TrackState | None,
    corrected: TrackState | None,
    **found: Any,
) -> MeasuredRow:
    """Make a row from the records of a measurement and its frame.

    ``nis``: NIS for which a track refused the measurement; ``predicted``: the track's prediction;
    ``corrected``: the track's state after the update; each None without one. ``found``: further
    fields of ``MeasuredRow``, such as ``track`` and ``is_taken``.
    """
    east2, cross, north2 = measurement.cov_sky_arcsec2
    sigma_east, sigma_north = math.sqrt(max(east2, 0.0)), math.sqrt(max(north2, 0.0))
    both = sigma_east * sigma_north
    end_a, end_b = measurement.ends_icrs_deg or ((None, None), (None, None))
    return MeasuredRow(
        **{name: getattr(measurement, name) for name in _SAME},
        **found,
        exposure_s=None if frame.taken is None else frame.taken.exposure_s,
        sigma_ra_arcsec=sigma_east,
        sigma_dec_arcsec=sigma_north,
        correlation=min(max(cross / both, -1.0), 1.0) if both > 0.0 else 0.0,
        ra_a_icrs_deg=end_a[0],
        dec_a_icrs_deg=end_a[1],
        ra_b_icrs_deg=end_b[0],
        dec_b_icrs_deg=end_b[1],
        **_light(frame.light_of(measurement.measurement_id)),
        **_predicted(predicted),
        **_corrected(corrected, nis),
        beside=(
            *((column.name, column_value(measurement, column)) for column in _BESIDE),
            *frame_quantities(frame).items(),
        ),
    )


def rows_with_ranges(
    rows: Sequence[MeasuredRow], orbits: Mapping[int, OrbitEstimate], site: Site
) -> tuple[MeasuredRow, ...]:
    """Return the rows, with distance, phase and reduced magnitude where an orbit gives them.

    ``orbits``: last orbit of each track, by track id.
    """
    found = list(rows)
    for track, orbit in orbits.items():
        own = [n for n, row in enumerate(rows) if row.track == track]
        ranges = ranges_by_orbit(orbit, site, [rows[n].t_mid_utc_ns for n in own])
        for n, each in zip(own, ranges, strict=True):
            if each is not None:
                found[n] = _with_range(rows[n], each)
    return tuple(found)


def _with_range(row: MeasuredRow, found: RangeAndPhase) -> MeasuredRow:
    mag, (range_km, phase_deg) = row.mag_v, found
    reduced = None if mag is None else reduced_magnitude(mag, range_km, phase_deg)
    return replace(row, range_km=range_km, phase_deg=phase_deg, reduced_mag=reduced)


_OF_LIGHT = ("mag", "mag_sigma", "mag_sigma_colour", "band", "is_saturated")


def _light(light: StreakLight | None) -> dict[str, Any]:
    return {} if light is None else {name: getattr(light, name) for name in _OF_LIGHT}


def _predicted(state: TrackState | None) -> dict[str, Any]:
    if state is None:
        return {}
    covariance = sky_covariance_arcsec2(state)
    return {
        "predicted_ra_icrs_deg": wrap_360(state.x[0]),
        "predicted_dec_icrs_deg": state.x[2],
        "predicted_sigma_ra_arcsec": math.sqrt(float(covariance[0, 0])),
        "predicted_sigma_dec_arcsec": math.sqrt(float(covariance[1, 1])),
    }


def _corrected(state: TrackState | None, nis: float | None) -> dict[str, Any]:
    if state is None:
        return {"nis": nis}
    residual = state.innovation_arcsec or (None, None)
    sigma = state.sigma_innovation_arcsec or (None, None)
    rate = sky_rate_arcsec_s(state)
    return {
        "residual_ra_arcsec": residual[0],
        "residual_dec_arcsec": residual[1],
        "sigma_residual_ra_arcsec": sigma[0],
        "sigma_residual_dec_arcsec": sigma[1],
        "nis": state.nis,
        "updated_ra_icrs_deg": wrap_360(state.x[0]),
        "updated_dec_icrs_deg": state.x[2],
        "rate_ra_arcsec_s": rate[0],
        "rate_dec_arcsec_s": rate[1],
    }
