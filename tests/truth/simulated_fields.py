"""Frames of the simulated observatory that low and high objects cross, off their elements."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from astropy.io import fits
from sgp4.api import SatrecArray

from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import CatalogueEntry
from rsoconsole.orbits.elements.sky_paths import Exposure, streak_path
from rsoconsole.simulator import Scene, scenario_named
from rsoconsole.simulator.camera.truth import FrameTruth
from rsoconsole.simulator.nights.scenarios import ScenarioSatellite
from rsoconsole.sky import lit_fraction, unit_to_direction
from rsoconsole.words import NS_PER_S, utc_ns_to_iso
from tests.truth.fields_of_truth import DAY_UTC_NS, SITE, off_its_elements, plate_at, replicated

OPTICS = OpticsConfig(width_px=2328, height_px=1760, pixel_um=7.6, focal_length_mm=620.0)
"""The paper's camera, two pixels joined each way."""
LOW_KM = 3000.0
HIGH_MAG, LOW_MAG = 10.5, 14.5
"""Fully lit, at 36,000 km; a low one at 1,000 km is 7.8 magnitudes brighter."""
_TRIED = 400
T0_UTC_NS = DAY_UTC_NS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crowd:
    """A catalogue, and where its objects really are."""

    entries: tuple[CatalogueEntry, ...]
    true: tuple[CatalogueEntry, ...]


def crowd(seed: int, count: int = 30_000) -> Crowd:
    """Elements, some of which are tens of seconds off."""
    rng = np.random.default_rng(seed)
    entries = replicated(count, seed)
    t = DAY_UTC_NS + 7200 * NS_PER_S
    return Crowd(entries=entries, true=tuple(off_its_elements(each, t, rng) for each in entries))


def frames_in(
    many: Crowd, folder: Path, seed: int, count: int, exposure_s: float = 5.0
) -> list[tuple[Path, FrameTruth, frozenset[int]]]:
    """Frames in which at least two low and one high object should be seen; the truth of each, and
    which of its objects are low."""
    rng = np.random.default_rng(seed)
    satellites = SatrecArray([each.record for each in many.true])
    found: list[tuple[Path, FrameTruth, frozenset[int]]] = []
    for _ in range(_TRIED):
        t = DAY_UTC_NS + round(rng.uniform(1.2, 3.2) * 3600) * NS_PER_S
        three = Exposure(SITE, t, exposure_s).places_through_exposure(satellites, np.zeros(1))
        middle = three[1]
        path = streak_path(*(each.u[:, 0] for each in three), 9)
        is_lit = lit_fraction(np.nan_to_num(middle.r_km[:, 0], nan=1.0), t) > 0.9
        is_low = middle.range_km[:, 0] < LOW_KM
        _, dec = unit_to_direction(middle.u[:, 0])
        zenith = plate_zenith(t)
        up = (middle.u[:, 0] @ zenith > 0.5) & is_lit & (np.abs(dec) < 10.0)
        for n in rng.permutation(np.flatnonzero(up & ~is_low))[:300]:
            centre = middle.u[n, 0]
            off = np.arccos(np.clip(path @ centre, -1.0, 1.0)).min(axis=1)
            near = (off < math.radians(0.55)) & is_lit
            if np.count_nonzero(near & is_low) >= 2:
                ra, dec_deg = (float(x) for x in unit_to_direction(centre))
                found.append(
                    _frame(many, folder, (seed, len(found)), (ra, dec_deg), (t, exposure_s))
                )
                break
        if len(found) == count:
            break
    return found


def plate_zenith(t_utc_ns: int) -> np.ndarray:
    """Unit vector overhead."""
    from rsoconsole.sky import site_gcrs

    up = site_gcrs(SITE, np.array([t_utc_ns]))[0][0]
    return np.asarray(up / np.linalg.norm(up))


def _frame(
    many: Crowd,
    folder: Path,
    seed: tuple[int, int],
    centre: tuple[float, float],
    when: tuple[int, float],
) -> tuple[Path, FrameTruth, frozenset[int]]:
    """Only what comes near the field is drawn. ``when``: middle and length of the exposure."""
    view = plate_at(*centre, *when, 3.0).view
    three = Exposure(SITE, *when).places_through_exposure(
        SatrecArray([e.record for e in many.true]), np.zeros(1)
    )
    path = streak_path(*(each.u[:, 0] for each in three), 9)
    with np.errstate(invalid="ignore"):
        near = np.flatnonzero((path @ view.centre).max(axis=1) > math.cos(view.radius_rad))
    is_low = three[1].range_km[:, 0] < LOW_KM
    there = [(many.true[n], LOW_MAG if is_low[n] else HIGH_MAG) for n in near]
    name = folder / f"field_{seed[0]}_{seed[1]}.fits"
    truth = rendered(name, there, centre, when, seed=seed[0])
    return name, truth, frozenset(many.true[n].norad_id for n in near if is_low[n])


def rendered(
    path: Path,
    there: Sequence[tuple[CatalogueEntry, float]],
    centre: tuple[float, float],
    when: tuple[int, float],
    *,
    seed: int = 1,
    optics: OpticsConfig = OPTICS,
) -> FrameTruth:
    """Write a frame of objects with their standard magnitudes; its plate is in the header."""
    t_utc_ns, exposure_s = when
    scenario = replace(
        scenario_named("intelsat-14"),
        site=SITE,
        t_start_utc_ns=T0_UTC_NS,
        satellites=tuple(
            ScenarioSatellite(element_set=each, standard_magnitude=magnitude)
            for each, magnitude in there
        ),
    )
    scene = Scene(scenario, seed, optics=optics)
    opens = t_utc_ns - round(exposure_s * NS_PER_S / 2)
    pixels, truth = scene.expose(*centre, 0.0, False, opens, exposure_s)
    hdu = fits.PrimaryHDU(pixels)
    hdu.header["DATE-OBS"] = utc_ns_to_iso(truth.t_start_utc_ns, 6).removesuffix("Z")
    hdu.header["EXPTIME"] = exposure_s
    for key, value in truth.wcs_cards.items():
        hdu.header[key] = value
    hdu.writeto(path, overwrite=True)
    return truth
