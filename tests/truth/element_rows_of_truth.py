"""Rows of element errors whose truth is known.

Two sources: low objects that SGP4 carries along orbits off their elements by known factors times
the assumed errors, seen from the ground with noise; and real elements of three geostationary
satellites over six years, of which the newer set is the truth for the older one.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rsoconsole.config import CatalogueConfig
from rsoconsole.orbits import (
    CatalogueEntry,
    ElementErrorRow,
    ElementErrors,
    MeasuredDirections,
    compare_with_catalogue,
    element_error_row,
    manoeuvred_probability,
    object_places,
    parse_element_sets,
    reduce_directions,
    states_gcrs,
)
from rsoconsole.orbits.identification.element_errors import ErrorSpread
from rsoconsole.orbits.identification.single import identify_alone
from rsoconsole.pipeline import wide_element_errors
from rsoconsole.pipeline.calibrations.element_calibration import GATE_DEG
from rsoconsole.sky import site_gcrs
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.truth.fields_of_truth import DAY_UTC_NS, EARTH_KM, MU, SITE, entry_of, off_its_elements
from tests.truth.seen_satellites import SHARED

HISTORY = SHARED / "tles" / "geo_3sats_history_2019_2025.tle"
NOISE_ARCSEC = 2.0
_HIGH_DEG = 25.0


def times(spread: ErrorSpread, at_epoch: float, by_age: float, across: float) -> ErrorSpread:
    """By hand, as the notes of the model have it."""
    a, c, s = spread.along, spread.across, spread.shape
    return ErrorSpread(
        along=(a[0] * at_epoch, a[1] * by_age, a[2] * by_age),
        across=(c[0] * across, c[1] * across, c[2] * across),
        shape=(s[0] * at_epoch, s[1] * by_age, s[2] * by_age),
    )


def seen_of(true: CatalogueEntry, t_utc_ns: int, rng: np.random.Generator) -> MeasuredDirections:
    """Six directions in ten seconds about an instant, with noise."""
    t = t_utc_ns + np.arange(-5, 7, 2) * NS_PER_S
    places = object_places(true, SITE, t)
    sigma_deg = NOISE_ARCSEC / 3600.0
    dec = places.dec_icrs_deg + rng.normal(0.0, sigma_deg, len(t))
    aside = rng.normal(0.0, sigma_deg, len(t)) / np.cos(np.radians(dec))
    cov = np.tile([NOISE_ARCSEC**2, 0.0, NOISE_ARCSEC**2], (len(t), 1))
    return reduce_directions(SITE, t, (places.ra_icrs_deg + aside) % 360.0, dec, cov)


def low_orbit(rng: np.random.Generator, norad_id: int, epoch_utc_ns: int) -> CatalogueEntry:
    """400 to 1,400 km, inclined so that it comes over the site."""
    a_km = EARTH_KM + rng.uniform(400.0, 1400.0)
    return entry_of(
        norad_id,
        epoch_utc_ns,
        no_kozai=60.0 * math.sqrt(MU / a_km**3),
        e=float(abs(rng.normal(0.0, 0.004))),
        i=math.radians(rng.uniform(45.0, 98.0)),
        node=rng.uniform(0.0, math.tau),
        perigee=rng.uniform(0.0, math.tau),
        mean=rng.uniform(0.0, math.tau),
        bstar=1e-5,
    )


def comes_over(entry: CatalogueEntry, from_utc_ns: int, rng: np.random.Generator) -> int | None:
    """An instant of a day at which it stands high; None: not that day."""
    t = from_utc_ns + np.arange(0, 360) * 240 * NS_PER_S
    (r,), _ = states_gcrs([entry], t)
    site, _ = site_gcrs(SITE, t)
    line = r - site
    up = np.sum(line * site, axis=-1) / np.linalg.norm(line, axis=-1)
    up /= np.linalg.norm(site, axis=-1)
    high = np.flatnonzero(up > math.sin(math.radians(_HIGH_DEG)))
    return int(t[rng.choice(high)]) if len(high) else None


def low_rows(
    count: int,
    rng: np.random.Generator,
    kept: ErrorSpread,
    moved: ErrorSpread,
    *,
    oldest_days: float = 8.0,
) -> Iterator[ElementErrorRow]:
    """Of so many low objects, one each, named as the verb does."""
    named_by = wide_element_errors(CatalogueConfig())
    number = 0
    while count:
        number += 1
        age_days = float(np.exp(rng.uniform(np.log(0.1), np.log(oldest_days))))
        entry = low_orbit(rng, number, DAY_UTC_NS - round(age_days * NS_PER_DAY))
        t = comes_over(entry, DAY_UTC_NS, rng)
        if t is None:
            continue
        age_days = (t - entry.epoch_utc_ns) / NS_PER_DAY
        is_moved = rng.random() < manoeuvred_probability("LEO", age_days)
        spread = moved if is_moved else kept
        # There each of two tilts has the whole swing that the model gives both together.
        tilted = tuple(each / math.sqrt(2.0) for each in spread.across)
        true = off_its_elements(entry, t, rng, replace(spread, across=tilted))
        row = row_by(f"night {number}", seen_of(true, t, rng), [entry], named_by)
        if row is not None:
            count -= 1
            yield row


def row_by(
    session: str,
    seen: MeasuredDirections,
    entries: list[CatalogueEntry],
    errors: ElementErrors,
) -> ElementErrorRow | None:
    """As the verb makes it; None where it is not surely named."""
    compared = compare_with_catalogue(seen, SITE, entries, gate_deg=GATE_DEG, errors=errors)
    return element_error_row(session, "1", compared, identify_alone(compared, GATE_DEG))


def geo_pairs() -> Iterator[tuple[CatalogueEntry, CatalogueEntry]]:
    """(older, newer) sets of one satellite, of two weeks at the most."""
    sets = parse_element_sets(HISTORY.read_text(encoding="ascii"), HISTORY.name).entries
    for norad_id in sorted({each.norad_id for each in sets}):
        own = sorted(
            {each.epoch_utc_ns: each for each in sets if each.norad_id == norad_id}.values(),
            key=lambda each: each.epoch_utc_ns,
        )
        for place, older in enumerate(own):
            for newer in own[place + 1 : place + 4]:
                if newer.epoch_utc_ns - older.epoch_utc_ns <= 30 * NS_PER_DAY:
                    yield older, newer
