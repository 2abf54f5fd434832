"""A night above one site: pixels and truth of any exposure.

``Scene.expose`` depends only on scenario, seed, world and its own arguments: frames may be drawn in
any order, and equal arguments give equal pixels.
"""

import copy
import math
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import Satellite
from rsoconsole.records import FloatArray, Wcs
from rsoconsole.simulator.camera.rendering import FieldContent, FramePixels, frame_rng, render
from rsoconsole.simulator.camera.sensor import (
    SHUTTER_SIGMA_S,
    SensorModel,
    atmospheric_shift_sigma_arcsec,
)
from rsoconsole.simulator.camera.truth import (
    FrameTruth,
    clock_offset_s,
    header_start_utc_ns,
    reported_start_utc_ns,
    true_exposure_timing,
)
from rsoconsole.simulator.nights.scenarios import Scenario, ScenarioSatellite
from rsoconsole.simulator.scene.world_scene import (
    clouds_in_world,
    plate_in_motion,
    seeing_arcsec,
    sensor_in_world,
    star_displacements_arcsec,
    undisturbed_plate,
    with_defocus_and_motion,
    with_moonlight,
    with_row_and_column_offsets,
)
from rsoconsole.simulator.sky.brightness import flash_sample_count, world_extra_mag
from rsoconsole.simulator.sky.other_objects import NearbySatelliteSearch, draw_traffic
from rsoconsole.simulator.sky.passes import (
    MARGIN_PX,
    NODES,
    ExposureGeometry,
    ExtraMagnitude,
    dim_streak,
    satellite_passes,
    satellite_truth,
)
from rsoconsole.simulator.sky.star_background import faint_stars, star_positions_at
from rsoconsole.simulator.world.world import DEFAULT_WORLD, World
from rsoconsole.sky import (
    IntArray,
    StarCatalogue,
    icrs_to_altaz,
    lst_deg,
    pixel_to_sky,
    sky_to_pixel,
    wcs_cards,
)

NS = 1_000_000_000
FAINTEST_STAR_MAG = 19.0
"""Magnitude of the faintest stars drawn; fainter ones are below the noise of a 10 s exposure."""
EXTINCTION_MAG_AIRMASS = 0.15
REFERENCE_SCALE_ARCSEC_PX = 206.264806 * 3.8 / 620.0
_CLOUD_GRID = (33, 44)
_NOISE, _SEEING, _AIR, _SHUTTER = 0, 1, 2, 3
_ALTITUDE_FLOOR_DEG = 5.0


class Scene:
    """The sky of one scenario as seen by one telescope."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        *,
        optics: OpticsConfig | None = None,
        sensor: SensorModel | None = None,
        catalogue: StarCatalogue | None = None,
        world: World = DEFAULT_WORLD,
    ) -> None:
        """Raises SolverError when the star catalogue cannot be read.

        ``optics``: sets frame size and scale of ``sensor``, with the world's binning already in it.
        ``catalogue``: the stars to draw; None: the shipped ones. ``world``: imperfections.
        """
        self.scenario = scenario
        self.seed = seed
        self.site = scenario.site
        self.world = world
        self._plain_sensor = _sensor_of(optics, sensor or SensorModel())
        self.sensor = sensor_in_world(world, self._plain_sensor)
        self.clouds = clouds_in_world(world.clouds, seed, scenario.clouds)
        self.catalogue = StarCatalogue.load() if catalogue is None else catalogue
        self.satellites = tuple(
            Satellite(each.element_set, each.standard_magnitude) for each in scenario.satellites
        )
        self._nearby = NearbySatelliteSearch(self.satellites)

    def binned(self, factor: int) -> "Scene":
        """Return this scene with its pixels binned further, ``factor`` by ``factor``."""
        joined = self.world.sensor.model_copy(
            update={"binning": factor * self.world.sensor.binning}
        )
        other, plain = copy.copy(self), self._plain_sensor
        other.world = self.world.model_copy(update={"sensor": joined})
        other.sensor = sensor_in_world(
            other.world,
            replace(
                plain,
                width_px=plain.width_px // factor,
                height_px=plain.height_px // factor,
                pixel_um=plain.pixel_um * factor,
            ),
        )
        return other

    def field_radius_deg(self) -> float:
        """Half the diagonal of the field, plus the margin in which sources outside are drawn."""
        half_px = 0.5 * math.hypot(self.sensor.width_px, self.sensor.height_px)
        return (half_px + MARGIN_PX) * self.sensor.scale_arcsec_px / 3600.0

    def empty_sky_message(self, dec_icrs_deg: float) -> str | None:
        """Why a frame at this declination shows no stars, with the remedy; None if it has stars."""
        if self.catalogue.covers(dec_icrs_deg):
            return None
        return (
            f"the simulated sky is empty at declination {dec_icrs_deg:+.1f} deg: its stars end at "
            f"{self.catalogue.dec_max_deg:+.0f} deg. Point it within these declinations"
        )

    def expose(  # noqa: PLR0917 - drawn the way it is spoken: where, how turned, when, how long
        self,
        boresight_ra_icrs_deg: float,
        boresight_dec_icrs_deg: float,
        rotation_deg: float,
        is_flipped: bool,
        t_start_utc_ns: int,
        exposure_s: float,
        mount_path_arcsec: FloatArray | None = None,
    ) -> tuple[FramePixels, FrameTruth]:
        """One exposure, tracked at the sidereal rate: pixels uint16 (height, width) and its truth.

        The boresight is the astrometric direction of the array's centre at mid-exposure. Rotation
        and flip are as in ``records.Solution``. ``t_start_utc_ns``: start by the observatory's
        clock. ``mount_path_arcsec``: (2, k) pointing relative to the boresight, east and north, at
        equal steps of time; None: steady pointing.
        """
        t_night_utc_ns = self.scenario.t_start_utc_ns
        boresight = (boresight_ra_icrs_deg, boresight_dec_icrs_deg)
        plate = undisturbed_plate(self.world, self.sensor, boresight, rotation_deg, is_flipped)
        wcs, motion = plate_in_motion(
            self.world,
            plate,
            self.sensor.scale_arcsec_px,
            (self.seed, t_start_utc_ns),
            exposure_s,
            (t_start_utc_ns - t_night_utc_ns) / NS,
            mount_path_arcsec,
        )
        offset_s = clock_offset_s(self.world, t_start_utc_ns, t_night_utc_ns)
        t_sky_utc_ns = t_start_utc_ns + round(offset_s * NS)
        content = self.field_content(wcs, t_sky_utc_ns, exposure_s, t_seed_utc_ns=t_start_utc_ns)
        content = with_defocus_and_motion(content, self.world, self.sensor, motion)
        air = frame_rng(self.seed, t_start_utc_ns, _SHUTTER)
        wander_px = atmospheric_shift_sigma_arcsec(exposure_s) / self.sensor.scale_arcsec_px
        own_s = self.world.shutter.scatter_s
        scatter_s = float(air.normal(0.0, SHUTTER_SIGMA_S if own_s is None else own_s))
        true = true_exposure_timing(self.world, scatter_s, t_start_utc_ns, t_night_utc_ns)
        reported_utc_ns = reported_start_utc_ns(self.world, t_start_utc_ns)
        motion_nodes = 1 if motion is None else len(motion.dx_px)
        sight = ExposureGeometry(
            site=self.site,
            sensor=self.sensor,
            wcs=wcs,
            t_start_utc_ns=reported_utc_ns,
            exposure_s=exposure_s,
            shutter_error_s=scatter_s,
            wander_px=(float(air.normal(0.0, wander_px)), float(air.normal(0.0, wander_px))),
            true=true,
            motion=motion,
            nodes=max(NODES, flash_sample_count(self.world.satellite, exposure_s), motion_nodes),
        )
        passes = satellite_passes(self._with_brightness(wcs, t_sky_utc_ns, exposure_s), sight)
        dimming = self._air_transmission(wcs, t_sky_utc_ns)
        crossing, crossed = draw_traffic(
            self.world.traffic, self.seed, t_start_utc_ns, self.sensor, content
        )
        seen = tuple(dim_streak(each.streak, dimming) for each in passes)
        content = replace(content, streaks=(*seen, *crossing))
        content = with_row_and_column_offsets(
            content, self.world, self.sensor, self.seed, t_start_utc_ns
        )
        pixels = render(self.sensor, content, frame_rng(self.seed, t_start_utc_ns, _NOISE))
        satellites = tuple(satellite_truth(each, self.sensor, content, dimming) for each in passes)
        grid = content.cloud_transmission
        truth = FrameTruth(
            t_start_utc_ns=header_start_utc_ns(self.world, t_start_utc_ns),
            t_place_utc_ns=reported_utc_ns + round(exposure_s * 5e8),
            t_open_utc_ns=t_start_utc_ns if true is None else true.t_open_utc_ns,
            exposure_s=exposure_s,
            boresight_ra_icrs_deg=wcs.crval_ra_deg,
            boresight_dec_icrs_deg=wcs.crval_dec_deg,
            wcs_cards=wcs_cards(wcs, self.sensor.width_px, self.sensor.height_px),
            fwhm_px=content.fwhm_px,
            sky_electrons_px=content.sky_electrons_px,
            cloud_transmission=1.0 if grid is None else float(grid.mean()),
            stars=len(content.star_x_px),
            satellites=satellites,
            traffic=crossed,
        )
        return pixels, truth

    def _with_brightness(
        self, wcs: Wcs, t_start_utc_ns: int, exposure_s: float
    ) -> list[tuple[Satellite, ExtraMagnitude]]:
        """Satellites that may be seen, each with the history of its own brightness."""

        def extra_mag(of: ScenarioSatellite, t_utc_ns: IntArray) -> FloatArray:
            t_s = (t_utc_ns - self.scenario.t_start_utc_ns) / NS
            more = world_extra_mag(self.world.satellite, self.seed, of.element_set.norad_id, t_s)
            return of.brightness.extra_mag(t_s, self.seed) + more

        # A corner of the sensor with its margin is further out than the field's radius with it.
        reach_deg = self.field_radius_deg() + MARGIN_PX * self.sensor.scale_arcsec_px / 3600.0
        t_mid_utc_ns = t_start_utc_ns + round(exposure_s * NS / 2)
        centre = (wcs.crval_ra_deg, wcs.crval_dec_deg)
        near = self._nearby.indices(self.site, t_mid_utc_ns, exposure_s, centre, reach_deg)
        return [(self.satellites[i], partial(extra_mag, self.scenario.satellites[i])) for i in near]

    def field_content(
        self, wcs: Wcs, t_start_utc_ns: int, exposure_s: float, t_seed_utc_ns: int | None = None
    ) -> FieldContent:
        """Content of the exposure without satellites: sky, clouds, cosmic rays, stars.

        ``t_seed_utc_ns``: the instant that seeds random quantities; None: ``t_start_utc_ns``.
        """
        t_seed_utc_ns = t_start_utc_ns if t_seed_utc_ns is None else t_seed_utc_ns
        content = self._empty_field(wcs, t_start_utc_ns, exposure_s, t_seed_utc_ns)
        air = frame_rng(self.seed, t_seed_utc_ns, _AIR)
        wander_px = atmospheric_shift_sigma_arcsec(exposure_s) / self.sensor.scale_arcsec_px
        x_px, y_px, magnitude = self._stars(wcs, t_start_utc_ns)
        x_px, y_px = (at + air.normal(0.0, wander_px, at.shape) for at in (x_px, y_px))
        dimming = self._air_transmission(wcs, t_start_utc_ns)
        return replace(
            content,
            star_x_px=x_px,
            star_y_px=y_px,
            star_electrons=self.sensor.electrons(magnitude, exposure_s) * dimming,
        )

    def _empty_field(
        self, wcs: Wcs, t_start_utc_ns: int, exposure_s: float, t_seed_utc_ns: int
    ) -> FieldContent:
        """Sky, seeing and clouds of one exposure."""
        rng = frame_rng(self.seed, t_seed_utc_ns, _SEEING)
        scale_ratio = self.sensor.scale_arcsec_px / REFERENCE_SCALE_ARCSEC_PX
        area_ratio = scale_ratio**2
        airmass = self._airmass(wcs, t_start_utc_ns)
        since_night_s = (t_start_utc_ns - self.scenario.t_start_utc_ns) / NS
        seeing = seeing_arcsec(self.world.seeing, self.scenario.seeing_arcsec, since_night_s)
        seeing_px = seeing / self.sensor.scale_arcsec_px
        frame_area = self.sensor.width_px * self.sensor.height_px / (4656 * 3520)
        content = FieldContent(
            exposure_s=exposure_s,
            fwhm_px=seeing_px * airmass**0.3 * float(np.exp(rng.normal(0.0, 0.03))),
            sky_electrons_px=self.scenario.sky_electrons_s
            * exposure_s
            * area_ratio
            * (1.0 + 0.12 * (airmass - 1.0)),
            sky_gradient=(0.03, -0.04),
            cloud_transmission=self._clouds(wcs, t_start_utc_ns, exposure_s),
            cosmic_rays=self.scenario.cosmic_rays_s * exposure_s * frame_area,
        )
        return with_moonlight(content, self.world.moon)

    def _airmass(self, wcs: Wcs, t_utc_ns: int) -> float:
        altitude, _ = icrs_to_altaz(self.site, wcs.crval_ra_deg, wcs.crval_dec_deg, t_utc_ns)
        return 1.0 / math.sin(math.radians(max(float(altitude), _ALTITUDE_FLOOR_DEG)))

    def _air_transmission(self, wcs: Wcs, t_utc_ns: int) -> float:
        """Loss to the air, relative to the zenith."""
        extra_mag = EXTINCTION_MAG_AIRMASS * (self._airmass(wcs, t_utc_ns) - 1.0)
        return float(10.0 ** (-0.4 * extra_mag))

    def _clouds(
        self, wcs: Wcs, t_start_utc_ns: int, exposure_s: float
    ) -> npt.NDArray[np.float32] | None:
        deck = self.clouds
        if not deck.schedule:
            return None
        rows, columns = _CLOUD_GRID
        x = (np.arange(columns) + 0.5) * self.sensor.width_px / columns - 0.5
        y = (np.arange(rows) + 0.5) * self.sensor.height_px / rows - 0.5
        ra, dec = pixel_to_sky(wcs, *np.meshgrid(x, y))
        # Fixed to the ground: hour angle grows as the sky turns.
        hour_angle = (lst_deg(self.site.longitude_deg, t_start_utc_ns) - ra + 180.0) % 360.0 - 180.0
        t_s = (t_start_utc_ns - self.scenario.t_start_utc_ns) / NS
        west_deg = hour_angle * np.cos(np.radians(dec))
        return deck.transmission(west_deg, dec, (t_s, t_s + exposure_s), self.seed)

    def _stars(self, wcs: Wcs, t_utc_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pixels and magnitudes of the stars on or near the sensor; none beyond the catalogue."""
        ra, dec, radius = wcs.crval_ra_deg, wcs.crval_dec_deg, self.field_radius_deg()
        bright = self.catalogue.cone(ra, dec, radius)
        faint = faint_stars(ra, dec, radius, FAINTEST_STAR_MAG)
        is_covered = (faint.dec_icrs_deg >= self.catalogue.dec_min_deg) & (
            faint.dec_icrs_deg <= self.catalogue.dec_max_deg
        )
        east, north = star_displacements_arcsec(
            self.world.catalogue, bright.ra_icrs_deg, bright.dec_icrs_deg
        )
        bright_ra, bright_dec = star_positions_at(bright, t_utc_ns)
        bright_ra = bright_ra + east / 3600.0 / np.cos(np.radians(bright_dec))
        bright_dec = bright_dec + north / 3600.0
        ras = np.concatenate([bright_ra, faint.ra_icrs_deg[is_covered]])
        decs = np.concatenate([bright_dec, faint.dec_icrs_deg[is_covered]])
        magnitudes = np.concatenate([bright.magnitude, faint.magnitude[is_covered]])
        x, y = sky_to_pixel(wcs, ras, decs)
        near = (x > -MARGIN_PX) & (x < self.sensor.width_px + MARGIN_PX)
        near &= (y > -MARGIN_PX) & (y < self.sensor.height_px + MARGIN_PX)
        return x[near], y[near], magnitudes[near]


def _sensor_of(optics: OpticsConfig | None, sensor: SensorModel) -> SensorModel:
    if optics is None:
        return sensor
    return replace(
        sensor,
        width_px=optics.width_px,
        height_px=optics.height_px,
        pixel_um=optics.pixel_um,
        focal_length_mm=optics.focal_length_mm,
    )
