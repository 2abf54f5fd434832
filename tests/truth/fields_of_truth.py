"""Random fields whose truth is known: a catalogue of any size, and what crossed a frame.

The catalogue holds elements; the objects themselves go by elements that are off these within the
error model, changed as orbits change (mean anomaly, plane, shape), and moved by SGP4. Nothing that
matches has a part in it but the model's own figures.
"""

import math
from dataclasses import dataclass

import numpy as np
from sgp4.api import WGS72, Satrec, SatrecArray

from rsoconsole.orbits import (
    CatalogueEntry,
    FieldOfView,
    StreakLine,
    manoeuvred_probability,
    orbit_regime,
    parse_element_sets,
    position_sigmas_km,
)
from rsoconsole.orbits.elements.sky_paths import Exposure, Observer, streak_path
from rsoconsole.orbits.identification.element_errors import MANOEUVRED, UNDISTURBED, ErrorSpread
from rsoconsole.records import FloatArray, Site, Wcs
from rsoconsole.sky import (
    ARCSEC_RAD,
    direction_to_unit,
    site_gcrs,
    sky_to_pixel,
    tan_wcs,
    teme_to_gcrs_rotation,
    unit_to_direction,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.truth.seen_satellites import SHARED

TLES = SHARED / "tles"
EARTH_KM = 6378.137
MU = 398_600.8
SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
DAY_UTC_NS = 1_687_392_000 * NS_PER_S
"""22 June 2023, midnight."""
_SGP4_DAYS = 7306
"""From 1949-12-31 to 1970-01-01."""


def entry_of(
    norad_id: int,
    epoch_utc_ns: int,
    *,
    no_kozai: float,
    e: float,
    i: float,
    node: float,
    perigee: float,
    mean: float,
    bstar: float = 0.0,
    name: str = "",
) -> CatalogueEntry:
    """An element set; angles in radians, mean motion in radians a minute."""
    record = Satrec()
    record.sgp4init(
        WGS72,
        "i",
        min(norad_id, 339_999),
        epoch_utc_ns / NS_PER_DAY + _SGP4_DAYS,
        bstar,
        0.0,
        0.0,
        min(max(e, 1e-7), 0.95),
        perigee % math.tau,
        abs(i),
        mean % math.tau,
        no_kozai,
        node % math.tau,
    )
    return CatalogueEntry(
        name=name or f"OBJECT {norad_id}",
        norad_id=norad_id,
        epoch_utc_ns=epoch_utc_ns,
        record=record,
    )


def low_entry(rng: np.random.Generator, norad_id: int, t_utc_ns: int) -> CatalogueEntry:
    """A low orbit as they are: 350 to 1,500 km, mostly inclined by 50 to 100 degrees."""
    a_km = EARTH_KM + rng.choice([550.0, 800.0, 1000.0, 1400.0]) + rng.normal(0.0, 60.0)
    return entry_of(
        norad_id,
        t_utc_ns - round(rng.uniform(0.05, 4.0) * NS_PER_DAY),
        no_kozai=60.0 * math.sqrt(MU / a_km**3),
        e=float(abs(rng.normal(0.0, 0.004))),
        i=math.radians(rng.choice([53.0, 65.0, 74.0, 82.0, 98.0]) + rng.normal(0.0, 1.5)),
        node=rng.uniform(0.0, math.tau),
        perigee=rng.uniform(0.0, math.tau),
        mean=rng.uniform(0.0, math.tau),
        bstar=float(10.0 ** rng.uniform(-5.0, -3.7)),
    )


def passing(
    norad_id: int,
    through: FloatArray,
    t_utc_ns: int,
    *,
    height_km: float,
    inclination_deg: float,
    ascends: bool = True,
) -> CatalogueEntry:
    """A round low orbit on which an object stands in a direction (3,) at an instant.

    Its elements are half a day old. The first guess is Kepler's, the rest SGP4's by Newton.
    """
    a_km = EARTH_KM + height_km
    site = site_gcrs(SITE, np.array([t_utc_ns]))[0][0]
    along = float(site @ through)
    reach = -along + math.sqrt(along**2 + a_km**2 - float(site @ site))
    r = teme_to_gcrs_rotation(np.array([t_utc_ns]))[0].T @ (site + reach * through)
    i = math.radians(inclination_deg)
    latitude = math.asin(math.sin(math.asin(r[2] / a_km)) / math.sin(i))
    latitude = latitude if ascends else math.pi - latitude
    east = math.atan2(math.cos(i) * math.sin(latitude), math.cos(latitude))
    epoch = t_utc_ns - NS_PER_DAY // 2
    pace = 60.0 * math.sqrt(MU / a_km**3)
    angles = np.array([math.atan2(r[1], r[0]) - east, latitude - pace * 720.0])

    def made(node: float, mean: float) -> CatalogueEntry:
        return entry_of(
            norad_id,
            epoch,
            no_kozai=pace,
            e=1e-4,
            i=i,
            node=node,
            perigee=0.0,
            mean=mean,
            name=f"LOW {norad_id}",
        )

    def off(node: float, mean: float) -> FloatArray:
        satellite = SatrecArray([made(node, mean).record])
        u = Observer(SITE, t_utc_ns).places_at_leads(satellite, np.zeros(1)).u[0, 0]
        side = np.cross([0.0, 0.0, 1.0], through)
        return np.array([u @ side, u @ np.cross(through, side)])

    for _ in range(8):
        now = off(*angles)
        slopes = np.stack([(off(*(angles + d)) - now) / 1e-5 for d in 1e-5 * np.eye(2)], axis=1)
        angles = angles - np.clip(np.linalg.solve(slopes, now), -0.1, 0.1)
    return made(*angles)


def behind(entry: CatalogueEntry, seconds: float, number: int | None = None) -> CatalogueEntry:
    """The same orbit, run through so much later."""
    r = entry.record
    return entry_of(
        number or entry.norad_id,
        entry.epoch_utc_ns,
        no_kozai=r.no_kozai,
        e=r.ecco,
        i=r.inclo,
        node=r.nodeo,
        perigee=r.argpo,
        mean=r.mo - r.no_kozai / 60.0 * seconds,
        bstar=r.bstar,
        name=entry.name,
    )


def replicated(count: int, seed: int, t_utc_ns: int = DAY_UTC_NS) -> tuple[CatalogueEntry, ...]:
    """A catalogue of so many objects: the shared element sets, and others made of them.

    Two in three are low. Copies have other planes and places in them.
    """
    rng = np.random.default_rng(seed)
    real = [
        each
        for name in ("geo_all_20230622.tle", "mix_20230622.tle", "meo_20200908.tle")
        for each in parse_element_sets((TLES / name).read_text(), name).entries
    ]
    found: list[CatalogueEntry] = []
    for number in range(1, count + 1):
        if number % 3:
            found.append(low_entry(rng, number, t_utc_ns))
            continue
        r = real[int(rng.integers(len(real)))].record
        found.append(
            entry_of(
                number,
                t_utc_ns - round(rng.uniform(0.05, 6.0) * NS_PER_DAY),
                no_kozai=r.no_kozai,
                e=r.ecco,
                i=r.inclo + rng.normal(0.0, 0.003),
                node=rng.uniform(0.0, math.tau),
                perigee=rng.uniform(0.0, math.tau),
                mean=rng.uniform(0.0, math.tau),
                bstar=r.bstar,
            )
        )
    return tuple(found)


def off_its_elements(
    entry: CatalogueEntry,
    t_utc_ns: int,
    rng: np.random.Generator,
    spread: ErrorSpread | None = None,
) -> CatalogueEntry:
    """Where the object really is: off by what the model says of that age."""
    r = entry.record
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    age_days = (t_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY
    if spread is None:
        is_moved = rng.random() < manoeuvred_probability(regime, age_days)
        spread = (MANOEUVRED if is_moved else UNDISTURBED)[regime]
    shape, along, across = (float(each) for each in position_sigmas_km(spread, age_days))
    along = math.sqrt(max(along**2 - 4.0 * shape**2, 0.0))
    a_km = (MU / (r.no_kozai / 60.0) ** 2) ** (1.0 / 3.0)
    k = r.ecco * math.cos(r.argpo) + rng.normal(0.0, shape / a_km)
    h = r.ecco * math.sin(r.argpo) + rng.normal(0.0, shape / a_km)
    perigee = math.atan2(h, k)
    tilt = across * math.sqrt(2.0) / a_km
    node = rng.normal(0.0, tilt) / max(math.sin(r.inclo), 0.02)
    return entry_of(
        entry.norad_id,
        entry.epoch_utc_ns,
        no_kozai=r.no_kozai,
        e=math.hypot(k, h),
        i=r.inclo + rng.normal(0.0, tilt),
        node=r.nodeo + node,
        perigee=perigee,
        # The place in the plane moves by the error alone.
        mean=r.mo + r.argpo - perigee + rng.normal(0.0, along / a_km) - node * math.cos(r.inclo),
        bstar=r.bstar,
        name=entry.name,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plate:
    """A frame's sky."""

    wcs: Wcs
    side_px: int
    view: FieldOfView


def plate_at(
    ra_deg: float, dec_deg: float, t_utc_ns: int, exposure_s: float, side_deg: float = 1.5
) -> Plate:
    """A square frame of 1,500 pixels a side."""
    side_px = 1500
    wcs = tan_wcs(
        ra_deg,
        dec_deg,
        scale_arcsec_px=side_deg * 3600.0 / side_px,
        rotation_deg=20.0,
        is_flipped=False,
        width_px=side_px,
        height_px=side_px,
    )

    def contains(u: FloatArray) -> FloatArray:
        x, y = sky_to_pixel(wcs, *unit_to_direction(u))
        return (x > -0.5) & (x < side_px - 0.5) & (y > -0.5) & (y < side_px - 0.5)

    side_rad = math.radians(side_deg)
    view = FieldOfView(
        site=SITE,
        t_mid_utc_ns=t_utc_ns,
        exposure_s=exposure_s,
        centre=direction_to_unit(ra_deg, dec_deg),
        radius_rad=side_rad / math.sqrt(2.0),
        area_rad2=side_rad**2,
        contains=contains,
    )
    return Plate(wcs=wcs, side_px=side_px, view=view)


def line_of(plate: Plate, true: CatalogueEntry, rng: np.random.Generator) -> StreakLine | None:
    """What the frame shows of an object, with the noise of a detection; None: nothing."""
    view = plate.view
    exposure = Exposure(view.site, view.t_mid_utc_ns, view.exposure_s)
    three = exposure.places_through_exposure(SatrecArray([true.record]), np.zeros(1))
    if not all(np.all(np.isfinite(each.u)) for each in three):
        return None
    if not float(three[1].u[0, 0] @ view.centre) > math.cos(view.radius_rad + 0.35):
        return None
    path = streak_path(*(each.u[0, 0] for each in three), 801)
    inside = np.flatnonzero(view.contains(path))
    if inside.size < 2:
        return None
    first, last = int(inside[0]), int(inside[-1])
    scale = math.radians(plate.view.radius_rad * 180.0 / math.pi * math.sqrt(2.0)) / plate.side_px
    middle = path[(first + last) // 2]
    along = path[last] - path[first]
    length = float(np.linalg.norm(along))
    if length < 12.0 * scale:
        return None
    along /= length
    across = np.cross(middle, along)
    across_px, along_px = 0.15, 0.4
    turn = rng.normal(0.0, 2.0 * across_px * scale / length)
    off = rng.normal(0.0, across_px * scale)
    ends = [
        path[n]
        + across * (off + sign * turn * length / 2.0)
        + along * rng.normal(0, along_px * scale)
        for n, sign in ((first, -1.0), (last, 1.0))
    ]
    is_end = [first == 0, last == 800]
    if rng.random() < 0.5:
        ends.reverse()
        is_end.reverse()
    a, b = (each / np.linalg.norm(each) for each in ends)
    mid = (a + b) / np.linalg.norm(a + b)
    sigma2 = (0.3 * scale) ** 2 + (0.3 * ARCSEC_RAD) ** 2
    return StreakLine(
        a=a,
        b=b,
        middle=mid,
        is_end_a=is_end[0],
        is_end_b=is_end[1],
        is_ordered=False,
        after_s=0.0,
        cov_sky_rad2=(sigma2, 0.0, sigma2),
        sigma_direction_rad=2.0 * across_px * scale / length,
        sigma_length_rad=2.0 * along_px * scale,
    )


def strange_line(plate: Plate, rng: np.random.Generator) -> StreakLine:
    """Of something that no catalogue has."""
    centre = plate.view.centre
    east = np.cross([0.0, 0.0, 1.0], centre)
    east /= np.linalg.norm(east)
    north = np.cross(centre, east)
    half = plate.view.radius_rad / math.sqrt(2.0)
    place = rng.uniform(-0.8, 0.8, 2) * half
    turn, length = rng.uniform(0.0, math.tau), half * math.exp(rng.uniform(-3.0, -1.0))
    way = 0.5 * length * np.array([math.cos(turn), math.sin(turn)])
    mid, a, b = (
        (v := centre + p[0] * east + p[1] * north) / np.linalg.norm(v)
        for p in (place, place - way, place + way)
    )
    scale = 2.0 * half / plate.side_px
    return StreakLine(
        a=a,
        b=b,
        middle=mid,
        is_end_a=True,
        is_end_b=True,
        is_ordered=False,
        after_s=0.0,
        cov_sky_rad2=((0.3 * scale) ** 2, 0.0, (0.3 * scale) ** 2),
        sigma_direction_rad=0.3 * scale / length,
        sigma_length_rad=0.8 * scale,
    )
