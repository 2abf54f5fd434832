"""``rso.crossings``: which catalogued objects cross a field of the sky, and when."""

from typing import TYPE_CHECKING

import numpy as np

from rsoconsole.base import InputError
from rsoconsole.library._given import (
    ConfigLike,
    Instant,
    Number,
    Place,
    SkyCoordLike,
    direction_deg,
    in_unit,
    instants_utc_ns,
    resolve_config,
    site_of,
)
from rsoconsole.library.identification import ElementsLike, given_element_sets
from rsoconsole.pipeline import (
    MAX_FIELD_DEG,
    FieldPoint,
    RoundField,
    catalogue_errors,
    field_crossings,
    predicted_magnitude,
)
from rsoconsole.session import element_ledger_path, read_element_ledger
from rsoconsole.words import NS_PER_S

if TYPE_CHECKING:
    from astropy.table import QTable

MAX_HOURS = 48.0


def crossings(
    center: SkyCoordLike,
    field: Number,
    *,
    start: Instant,
    duration: Number,
    tle: ElementsLike | None = None,
    site: Place | None = None,
    config: ConfigLike = None,
) -> "QTable":
    """Return the crossings of a round field, in order of time, as ``rsoconsole crossings`` does.

    ``center``: centre of the field, which stays among the stars. ``field``: its diameter, degrees.
    ``start``, ``duration``: from when on, and for how many hours. ``tle``: files of element sets
    (TLE; OMM as XML, JSON, CSV), or their text; None: those of ``catalogue.tle_files`` in the
    configuration. ``site``: of the observer; None: the configured one.

    A crossing counts while the object is above the horizon. Columns, a row a crossing:

    ``norad_id``, ``name``: the object.
    ``t_enter``, ``t_nearest``, ``t_leave``: instants at which it comes in, is nearest to the
    centre, and goes out (or rises, sets, or the span begins or ends).
    ``enter``, ``nearest``, ``leave``: its directions then, ICRS, as a plate solution measures them.
    ``offset``: angle from the centre at ``t_nearest``, as are all that follow.
    ``motion``: position angle of its motion, from north through east; ``rate``: its angular rate.
    ``altitude``: above the horizon, without refraction. ``range``: from the site; ``height``: above
    the equator's radius.
    ``is_sunlit``: True where the Sun shines on it; ``phase``: angle there between Sun and site.
    ``mag``: magnitude (V) as a diffuse sphere, above the air, of objects whose brightness was
    measured on your own nights (``rsoconsole calibrate-elements``); NaN of others and in the
    Earth's shadow. ``mag_sigma``: its one sigma, by the scatter of those measurements.
    ``elements_age``: negative where the elements are newer. ``sigma``: one sigma of the times by
    that age, without a manoeuvre.

    ``meta["not_used"]``: a sentence on each element set that cannot be read, and on each object
    for which SGP4 has a place at no time. ``meta["placed_in_part"]``: a sentence on each object
    that has one in a part of the time only.

    Raises OrbitError for element sets that cannot be read or are missing, InputError for a value
    out of range, SessionError for a ledger of brightness that a later version has written.

    >>> rso.crossings(SkyCoord(313.7, -4.8, unit="deg"), 1.5, start=Time.now(), duration=8)
    """
    from astropy import units
    from astropy.coordinates import SkyCoord
    from astropy.table import QTable
    from astropy.time import Time

    from rsoconsole.sky import jd_utc

    ra_deg, dec_deg = direction_deg(center, "center")
    field_deg, hours = in_unit(field, "deg", "field"), in_unit(duration, "hour", "duration")
    if not 0.0 < field_deg <= MAX_FIELD_DEG:
        raise InputError(f"field: {field_deg:g} deg: above 0, and {MAX_FIELD_DEG:g} at most")
    if not 0.0 < hours <= MAX_HOURS:
        raise InputError(f"duration: {hours:g} h: above 0, and {MAX_HOURS:g} at most")
    loaded = resolve_config(config)
    begin_ns = int(instants_utc_ns(start, "start"))
    of = RoundField(
        site=loaded.site.to_site() if site is None else site_of(site),
        ra_icrs_deg=ra_deg,
        dec_icrs_deg=dec_deg,
        diameter_deg=field_deg,
    )
    sets = given_element_sets(tle, None, loaded.catalogue)
    parts = list(
        field_crossings(
            sets.entries,
            of,
            (begin_ns, begin_ns + round(hours * 3600.0 * NS_PER_S)),
            catalogue_errors(loaded.catalogue),
        )
    )
    found = sorted(
        (each for some in parts for each in some.crossings), key=lambda each: each.enter.t_utc_ns
    )
    lost = [each for some in parts for each in some.lost]
    not_used = [*sets.not_used, *(each.unused for each in lost if each.is_always)]
    table = QTable(
        meta={
            "not_used": tuple(each.words for each in not_used),
            "placed_in_part": tuple(each.words for each in lost if not each.is_always),
        }
    )
    table["norad_id"] = np.array([each.norad_id for each in found], np.int64)
    table["name"] = np.array([each.name for each in found], str)
    ends: dict[str, list[FieldPoint]] = {
        "enter": [each.enter for each in found],
        "nearest": [each.nearest for each in found],
        "leave": [each.leave for each in found],
    }
    for name, points in ends.items():
        instants = np.array([each.t_utc_ns for each in points], np.int64)
        table[f"t_{name}"] = Time(*jd_utc(instants), format="jd", scale="utc")
        table[f"t_{name}"].format = "isot"
    for name, points in ends.items():
        table[name] = SkyCoord(
            np.array([each.ra_icrs_deg for each in points], float) * units.deg,
            np.array([each.dec_icrs_deg for each in points], float) * units.deg,
        )
    for name, values, unit in (
        ("offset", [each.offset_deg for each in found], units.deg),
        ("motion", [each.motion_deg for each in found], units.deg),
        ("rate", [each.rate_arcsec_s for each in found], units.arcsec / units.s),
        ("altitude", [each.nearest.alt_deg for each in found], units.deg),
        ("range", [each.range_km for each in found], units.km),
        ("height", [each.height_km for each in found], units.km),
    ):
        table[name] = np.array(values, float) * unit
    table["is_sunlit"] = np.array([each.is_lit for each in found], bool)
    table["phase"] = np.array([each.phase_deg for each in found], float) * units.deg
    standard = read_element_ledger(element_ledger_path()).standard_magnitudes()
    mags = [predicted_magnitude(each, standard) or (np.nan, np.nan) for each in found]
    table["mag"] = np.array([mag for mag, _ in mags], float) * units.mag
    table["mag_sigma"] = np.array([sigma for _, sigma in mags], float) * units.mag
    table["elements_age"] = np.array([each.tle_age_days for each in found], float) * units.day
    table["sigma"] = np.array([each.sigma_s for each in found], float) * units.s
    return table
