"""A quiet sky with stars where a test wants them, and measures of what a world does to it.

Nothing here reads the truth of a frame: all is measured in its pixels.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from models.star_catalogue import catalogue_of
from rsoconsole.config import OpticsConfig
from rsoconsole.simulator import Scene, binned_optics, scenario_named, world_from
from rsoconsole.simulator.camera.truth import FrameTruth
from rsoconsole.simulator.scene import scene as scene_module
from rsoconsole.simulator.sky.brightness import BrightnessHistory
from rsoconsole.sky import Stars, icrs_of_hour_angle, pixel_to_sky, tan_wcs

NS = 1_000_000_000
SCALE_ARCSEC_PX = 206.264806 * 3.8 / 620.0
STAR_MAG = 11.5
"""Bright and far from saturation in 10 s."""
OPTICS = OpticsConfig(width_px=320, height_px=320)
FOUR_STARS = OpticsConfig(width_px=160, height_px=160)
STRIP = OpticsConfig(width_px=320, height_px=80)
TARGET = 36097
RATE_ARCSEC_S = 14.98
"""Of a geostationary satellite against the stars, on the sky."""


def no_faint_stars(*_: Any) -> Stars:
    """A sky of the catalogue's stars alone."""
    none = np.zeros(0)
    return Stars.without_proper_motion(none, none, none)


def grid_px(optics: OpticsConfig = OPTICS, spacing_px: int = 80) -> tuple[np.ndarray, np.ndarray]:
    """Where the stars of a quiet field lie: never nearer to an edge than half a spacing."""
    x = np.arange(spacing_px / 2, optics.width_px, spacing_px)
    y = np.arange(spacing_px / 2, optics.height_px, spacing_px)
    columns, rows = np.meshgrid(x, y)
    return columns.ravel(), rows.ravel()


@dataclass(frozen=True)
class Field:
    """One rendered frame."""

    pixels: np.ndarray
    truth: FrameTruth

    @property
    def light(self) -> np.ndarray:
        """Converter steps above the sky."""
        light = self.pixels.astype(float) / 16.0
        return light - np.median(light)


def expose(
    monkeypatch: Any,
    world: dict[str, Any] | None = None,
    *,
    second: float = 60.0,
    exposure_s: float = 10.0,
    seed: int = 1,
    stars: bool = True,
    satellite_mag: float | None = None,
    optics: OpticsConfig = OPTICS,
    star_mag: float = STAR_MAG,
    mount_path_arcsec: np.ndarray | None = None,
) -> Field:
    """One frame; north up, the stars on a grid, the satellite (steady) in the middle or none."""
    monkeypatch.setattr(scene_module, "faint_stars", no_faint_stars)
    made = world_from({"catalogue": {"random_arcsec": 0.0}} | (world or {}))
    scenario = scenario_named("intelsat-14")
    [target] = [s for s in scenario.satellites if s.element_set.norad_id == TARGET]
    target = replace(
        target, standard_magnitude=satellite_mag or 0.0, brightness=BrightnessHistory()
    )
    shown = () if satellite_mag is None else (target,)
    scenario = replace(scenario, satellites=shown, cosmic_rays_s=0.0)
    t = scenario.t_start_utc_ns + round(second * NS)
    ra, dec = icrs_of_hour_angle(scenario.site, -41.0, scenario.start_declination_deg, t)
    if satellite_mag is not None:
        # Where it is at mid-exposure by UTC, so that it crosses the middle of a perfect frame.
        from rsoconsole.orbits import Satellite

        mid = np.array([t + round(exposure_s * NS / 2)])
        place = Satellite(target.element_set).astrometric_place(scenario.site, mid)
        ra, dec = place.ra_icrs_deg[0], place.dec_icrs_deg[0]
    plate = tan_wcs(
        float(ra),
        float(dec),
        scale_arcsec_px=SCALE_ARCSEC_PX,
        rotation_deg=0.0,
        is_flipped=False,
        width_px=optics.width_px,
        height_px=optics.height_px,
    )
    star_ra, star_dec = pixel_to_sky(plate, *grid_px(optics))
    order = np.argsort(star_dec) if stars else np.zeros(0, dtype=int)
    catalogue = catalogue_of(
        Stars.without_proper_motion(star_ra[order], star_dec[order], np.full(len(order), star_mag))
    )
    scene = Scene(
        scenario, seed, optics=binned_optics(optics, made), catalogue=catalogue, world=made
    )
    pixels, truth = scene.expose(
        float(ra), float(dec), 0.0, False, t, exposure_s, mount_path_arcsec
    )
    return Field(pixels, truth)


def stamps(field: Field, half_px: int = 30) -> list[np.ndarray]:
    """The light about each place of the grid, (2 half + 1, 2 half + 1)."""
    found = []
    height_px, width_px = field.pixels.shape
    optics = OpticsConfig(width_px=width_px, height_px=height_px)
    for x, y in zip(*grid_px(optics), strict=True):
        column, row = int(x), int(y)
        box = field.light[
            row - half_px : row + half_px + 1, column - half_px : column + half_px + 1
        ]
        edge = np.concatenate([box[0], box[-1], box[:, 0], box[:, -1]])
        found.append(box - np.median(edge))
    return found


def centre_and_spread(box: np.ndarray, threshold: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """First moments (x, y) from the middle, and second moments (2, 2) about them, in pixels."""
    light = np.where(box > threshold, box, 0.0)
    rows, columns = np.indices(light.shape) - (len(light) - 1) / 2.0
    total = light.sum()
    x, y = (light * columns).sum() / total, (light * rows).sum() / total
    dx, dy = columns - x, rows - y
    xx, xy, yy = ((light * each).sum() / total for each in (dx * dx, dx * dy, dy * dy))
    return np.array([x, y]), np.array([[xx, xy], [xy, yy]])


def mean_centre(field: Field, half_px: int = 30) -> np.ndarray:
    """(x, y) by which the stars of the grid are displaced, in the mean."""
    return np.mean([centre_and_spread(box)[0] for box in stamps(field, half_px)], axis=0)


def mean_spread(field: Field, half_px: int = 30) -> np.ndarray:
    """(2, 2) second moments of the stars of the grid, in the mean."""
    return np.mean([centre_and_spread(box)[1] for box in stamps(field, half_px)], axis=0)


def fwhm_px(field: Field) -> float:
    """Of the stars of the grid, by fitting a Gaussian to the sum of them."""
    box = np.mean(stamps(field, 8), axis=0)
    rows, columns = np.indices(box.shape)

    def disc(_: Any, peak: float, x: float, y: float, sigma: float, base: float) -> np.ndarray:
        r2 = (columns - x) ** 2 + (rows - y) ** 2
        return (peak * np.exp(-0.5 * r2 / sigma**2) + base).ravel()

    found, _ = curve_fit(disc, None, box.ravel(), p0=(box.max(), 8.0, 8.0, 1.5, 0.0))
    return float(abs(found[3])) * 2.3548


def streak_along(field: Field, half_width_px: int = 6) -> np.ndarray:
    """Light of a streak that lies along the rows, summed across it, column by column."""
    middle = (len(field.light) - 1) // 2
    rows = field.light[middle - half_width_px : middle + half_width_px + 2]
    return np.asarray(rows.sum(axis=0))


def streak_ends(field: Field, half_width_px: int = 6) -> tuple[float, float]:
    """Columns where the streak's light passes half of its plateau, to a fraction of a pixel."""
    light = np.convolve(streak_along(field, half_width_px), np.ones(3) / 3, "same")
    half = np.median(light[light > 0.5 * np.percentile(light, 90)]) / 2.0
    bright = np.flatnonzero(light > half)
    first, last = int(bright[0]), int(bright[-1])
    begins = first - (light[first] - half) / (light[first] - light[first - 1])
    ends = last + (light[last] - half) / (light[last] - light[last + 1])
    return float(begins), float(ends)


def streak_middle_px(field: Field) -> float:
    """Column of the streak's midpoint."""
    return sum(streak_ends(field)) / 2.0
