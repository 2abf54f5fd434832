"""How often the right name is given: objects of a real catalogue, seen with noise, off their
elements.

Run: ``python -m tests.bench.bench_identify``. Truth is where an object's elements put it, plus an
error: as assumed of an undisturbed object, or as measured on satellites that are kept in their
slots.
"""

import time
from collections import Counter
from pathlib import Path

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    Identification,
    MeasuredDirections,
    covariance_rtn,
    parse_element_sets,
    reduce_directions,
    states_gcrs,
)
from rsoconsole.orbits.identification.element_errors import UNDISTURBED
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, astrometric_places
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.bench.bench_element_errors import MEAN_MOTION_RAD_S, measured_errors
from tests.makers import identify

TLES = Path(__file__).parents[3] / "shared" / "data" / "tles"
SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
SEEN = 20
CADENCE_S = 30.0
SIGMA_ARCSEC = 1.0


def seen_off_elements(
    entry: CatalogueEntry, error_rtn: FloatArray, site: Site, t_utc_ns: IntArray, noise: FloatArray
) -> MeasuredDirections:
    """Directions (N,) of an object that is off its elements by (radial, along, across; rates)."""
    middle_ns = int(np.mean(t_utc_ns))

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        (r,), (v,) = states_gcrs([entry], at)
        radial = r / np.linalg.norm(r, axis=-1, keepdims=True)
        pole = np.cross(r, v)
        pole /= np.linalg.norm(pole, axis=-1, keepdims=True)
        frame = np.stack([radial, np.cross(pole, radial), pole], axis=-1)
        since_s = (at - middle_ns)[:, None] / NS_PER_S
        off = error_rtn[:3] + since_s * error_rtn[3:]
        return r + np.einsum("nij,nj->ni", frame, off), v

    places = astrometric_places(position_of, site, t_utc_ns)
    sigma_2 = SIGMA_ARCSEC**2
    return reduce_directions(
        site,
        t_utc_ns,
        places.ra_icrs_deg + noise[:, 0] / 3600.0 / np.cos(np.radians(places.dec_icrs_deg)),
        places.dec_icrs_deg + noise[:, 1] / 3600.0,
        np.tile([sigma_2, 0.0, sigma_2], (len(t_utc_ns), 1)),
    )


def visible(entries: tuple[CatalogueEntry, ...], t_utc_ns: int) -> list[CatalogueEntry]:
    """Those that stand 15 degrees high."""
    from rsoconsole.sky import site_gcrs

    at = np.array([t_utc_ns])
    r = states_gcrs(entries, at)[0][:, 0]
    site_km = site_gcrs(SITE, at)[0][0]
    u = r - site_km
    high = u @ site_km / np.linalg.norm(u, axis=-1) / np.linalg.norm(site_km)
    return [each for each, sine in zip(entries, high, strict=True) if sine > np.sin(np.radians(15))]


def answer(found: Identification, norad_id: int) -> str:
    """In a word."""
    if found.verdict == "identified":
        return "right" if found.matches[0].norad_id == norad_id else "wrong"
    if found.verdict == "ambiguous":
        near = [each.norad_id for each in found.matches[:3]]
        return "ambiguous, it among the first three" if norad_id in near else "ambiguous, wrong"
    return "unknown"


def trial(
    age_days: float, count: int, errors: FloatArray | None, random: np.random.Generator
) -> tuple[Counter[str], Counter[str]]:
    """Answers for ``count`` objects with the catalogue as it is, and with the object taken out."""
    entries = parse_element_sets(
        (TLES / "geo_all_20230622.tle").read_text(encoding="ascii")
    ).entries
    epoch_ns = int(np.median([each.epoch_utc_ns for each in entries]))
    start_ns = epoch_ns + round(age_days * NS_PER_DAY)
    t = start_ns + np.arange(SEEN) * round(CADENCE_S * NS_PER_S)
    up = visible(entries, start_ns)
    whole: Counter[str] = Counter()
    without: Counter[str] = Counter()
    for entry in random.choice(np.array(up, object), count, replace=False):
        own_age = (start_ns - entry.epoch_utc_ns) / NS_PER_DAY
        if errors is None:
            spread = covariance_rtn(UNDISTURBED["GEO"], own_age, MEAN_MOTION_RAD_S)
            error = random.multivariate_normal(np.zeros(6), spread, method="eigh")
        else:
            error = random.choice(errors)
        seen = seen_off_elements(entry, error, SITE, t, random.normal(0.0, SIGMA_ARCSEC, (SEEN, 2)))
        whole[answer(identify(seen, SITE, entries), entry.norad_id)] += 1
        others = [each for each in entries if each.norad_id != entry.norad_id]
        without[identify(seen, SITE, others).verdict] += 1
    return whole, without


def main() -> None:
    """Print the answers by age and kind of error."""
    count = 300
    random = np.random.default_rng(7)
    history = measured_errors()
    for age, kind in ((0.5, None), (3.0, None), (12.0, None), (5.0, (3, 7)), (10.0, (7, 14))):
        chosen = None
        if kind is not None:
            low, high = kind
            chosen = history[(history[:, 0] >= low) & (history[:, 0] < high), 1:]
        whole, without = trial(age, count, chosen, random)
        words = "undisturbed" if kind is None else f"kept in slots, {kind[0]} to {kind[1]} days"
        print(f"{age:5.1f} days, {words}: {dict(whole)}; taken out: {dict(without)}")
    entries = parse_element_sets(
        (TLES / "geo_all_20230622.tle").read_text(encoding="ascii")
    ).entries
    many = [
        CatalogueEntry(
            name=each.name,
            norad_id=100_000 * copy + each.norad_id,
            epoch_utc_ns=each.epoch_utc_ns,
            record=each.record,
        )
        for copy in range(18)
        for each in entries
    ]
    t = entries[0].epoch_utc_ns + np.arange(SEEN) * round(CADENCE_S * NS_PER_S)
    seen = seen_off_elements(entries[300], np.zeros(6), SITE, t, np.zeros((SEEN, 2)))
    began = time.perf_counter()
    identify(seen, SITE, many)
    print(f"{len(many)} objects in {time.perf_counter() - began:.2f} s")


if __name__ == "__main__":
    main()
