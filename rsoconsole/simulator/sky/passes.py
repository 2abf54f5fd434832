"""Satellites that cross the field during one exposure: their streaks and their truth."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.orbits import Satellite
from rsoconsole.records import FloatArray, Site, Wcs
from rsoconsole.simulator.camera.motion import ImageMotion
from rsoconsole.simulator.camera.psf import FWHM_PER_SIGMA, WINGS
from rsoconsole.simulator.camera.rendering import FieldContent, Streak, transmission_at
from rsoconsole.simulator.camera.sensor import SensorModel, vignetting
from rsoconsole.simulator.camera.streak_snr import integrated_snr
from rsoconsole.simulator.camera.truth import SatelliteTruth, TrueExposureTiming
from rsoconsole.sky import IntArray, SkyPlaces, lit_fraction, sky_to_pixel

ExtraMagnitude = Callable[[IntArray], FloatArray]
"""Function from instants (n,), UTC ns, to magnitudes (n,) that a satellite has lost by itself."""

NS = 1_000_000_000
MARGIN_PX = 250.0
"""Distance outside the sensor up to which a source is drawn and reported."""
NODES = 11
"""Usual number of instants along an exposure; unsteady and very fast satellites need more."""
_MAX_NODES = 641
STRAIGHT_PX = 0.05
"""Largest distance of a path from the chord between two successive positions."""
_SAME_INSTANT_S = 1e-8
_FAR_AWAY_S = 10.0
"""Delay of a row that lies far outside any frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SatellitePass:
    """One satellite's path over the sensor during one exposure; arrays (n,) of equal time steps."""

    name: str
    norad_id: int
    streak: Streak
    """The satellite's streak without the air's extinction or clouds; 0 electrons if unlit."""
    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    rates_deg_s: tuple[float, float]
    """Rates of right ascension and declination at mid-exposure."""
    lit_fraction: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExposureGeometry:
    """Geometry and timing of one exposure."""

    site: Site
    sensor: SensorModel
    wcs: Wcs
    t_start_utc_ns: int
    """Opening as the operator computes it; directions are given for instants from then on."""
    exposure_s: float
    shutter_error_s: float = 0.0
    """Small delay of the shutter's opening, applied where ``true`` is None."""
    wander_px: tuple[float, float] = (0.0, 0.0)
    """Displacement (dx, dy) of the whole streak by the atmosphere."""
    true: TrueExposureTiming | None = None
    """True timing where clock or shutter are imperfect; None: ``shutter_error_s`` describes it."""
    motion: ImageMotion | None = None
    nodes: int = NODES
    """Number of instants along the exposure, odd; more where brightness or image are unsteady."""

    @property
    def centre_px(self) -> tuple[float, float]:
        """Middle of the frame, (x, y)."""
        return (self.sensor.width_px - 1) / 2.0, (self.sensor.height_px - 1) / 2.0


def satellite_passes(
    satellites: Iterable[tuple[Satellite, ExtraMagnitude]], sight: ExposureGeometry
) -> tuple[SatellitePass, ...]:
    """Return the passes of satellites whose streak comes within ``MARGIN_PX`` of the sensor.

    ``ra_icrs_deg`` and ``dec_icrs_deg`` of a pass are for the exposure as the operator's clock
    times it; the streak is for the true times, with all errors of clock and shutter.
    """
    found = []
    for satellite, extra_mag in satellites:
        own = sight
        places, seen, x, y, pace = _way(satellite, own)
        if not np.all(np.isfinite(x)) or not _is_near(own.sensor, x, y):
            continue
        nodes = _nodes_for(x, y)
        if nodes > own.nodes:
            own = replace(sight, nodes=nodes)
            places, seen, x, y, pace = _way(satellite, own)
            if not np.all(np.isfinite(x)):
                continue
        magnitude = satellite.magnitude(seen) + extra_mag(seen.t_utc_ns)
        per_second = own.sensor.electrons(magnitude, 1.0) * pace
        mean = float(np.trapezoid(per_second, dx=1.0 / (own.nodes - 1)))
        brightness = per_second / mean if mean > 0.0 else np.zeros(own.nodes)
        lit = lit_fraction(seen.position_gcrs_km, seen.t_utc_ns)
        middle = own.nodes // 2
        found.append(
            SatellitePass(
                name=satellite.element_set.name,
                norad_id=satellite.element_set.norad_id,
                streak=Streak(
                    x_px=x, y_px=y, electrons=mean * sight.exposure_s, brightness=brightness
                ),
                ra_icrs_deg=places.ra_icrs_deg,
                dec_icrs_deg=places.dec_icrs_deg,
                rates_deg_s=(
                    float(places.ra_rate_deg_s[middle]),
                    float(places.dec_rate_deg_s[middle]),
                ),
                lit_fraction=float(np.mean(lit)),
            )
        )
    return tuple(found)


def _way(
    satellite: Satellite, sight: ExposureGeometry
) -> tuple[SkyPlaces, SkyPlaces, FloatArray, FloatArray, FloatArray]:
    """Places as the operator would name them, as truly seen, pixels, and the pace of time."""
    share = np.linspace(0.0, 1.0, sight.nodes)
    offsets = np.rint(share * sight.exposure_s * NS).astype(np.int64)
    places = satellite.astrometric_place(sight.site, np.int64(sight.t_start_utc_ns) + offsets)
    if sight.true is None:
        # Over a few hundredths of a second the rates of the instant serve.
        x, y = _on_frame(sight, share, places, sight.shutter_error_s)
        return places, places, x, y, np.ones(sight.nodes)
    return places, *_truly_seen(satellite, sight, sight.true, share)


def _truly_seen(
    satellite: Satellite, sight: ExposureGeometry, true: TrueExposureTiming, share: FloatArray
) -> tuple[SkyPlaces, FloatArray, FloatArray, FloatArray]:
    """Places, pixels, and how much time a step of the exposure takes, at the true instants.

    With a rolling shutter a satellite is seen at the time of the row on which it then is: solved
    by going there again and again; every step is some hundred times nearer.
    """
    late_s = np.zeros(len(share))
    while True:
        t_s = share * sight.exposure_s + late_s
        t_utc_ns = np.int64(true.t_open_utc_ns) + np.rint(t_s * NS).astype(np.int64)
        places = satellite.astrometric_place(sight.site, t_utc_ns)
        x, y = _on_frame(sight, share, places, 0.0)
        row_s = y * true.line_time_s
        if not np.all(np.isfinite(y)) or np.max(np.abs(row_s - late_s)) < _SAME_INSTANT_S:
            return places, x, y, np.gradient(t_s) / (sight.exposure_s / (len(share) - 1))
        if np.max(np.abs(row_s)) > _FAR_AWAY_S:
            return places, np.full_like(x, np.nan), y, np.ones(len(share))
        late_s = row_s


def _on_frame(
    sight: ExposureGeometry, share: FloatArray, places: SkyPlaces, later_s: float
) -> tuple[FloatArray, FloatArray]:
    x, y = sky_to_pixel(
        sight.wcs,
        places.ra_icrs_deg + places.ra_rate_deg_s * later_s,
        places.dec_icrs_deg + places.dec_rate_deg_s * later_s,
    )
    x, y = x + sight.wander_px[0], y + sight.wander_px[1]
    if sight.motion is not None:
        x, y = sight.motion.displace_points(share, x, y, sight.centre_px)
    return x, y


def _nodes_for(x_px: FloatArray, y_px: FloatArray) -> int:
    """Places that keep the way straight between them, an odd number: one is the middle."""
    steps = len(x_px) - 1
    bend_px = float(np.max(np.hypot(np.diff(x_px, 2), np.diff(y_px, 2)), initial=0.0)) / 8.0
    if bend_px <= STRAIGHT_PX:
        return len(x_px)
    finer = math.ceil(math.sqrt(bend_px / STRAIGHT_PX))
    return max(len(x_px), min(steps * finer + 1, _MAX_NODES))


def dim_streak(streak: Streak, transmission: float) -> Streak:
    """The streak with its electrons multiplied by a transmission."""
    return replace(streak, electrons=streak.electrons * transmission)


def satellite_truth(
    each: SatellitePass, sensor: SensorModel, content: FieldContent, air_transmission: float
) -> SatelliteTruth:
    """Return the true values of one satellite's streak in this field.

    ``air_transmission``: fraction transmitted by the cloudless air, relative to the zenith.
    """
    x, y = each.streak.x_px, each.streak.y_px
    middle = len(x) // 2
    clouds = float(np.mean(transmission_at(sensor, content.cloud_transmission, x, y)))
    electrons = each.streak.electrons * air_transmission * clouds
    is_lit = each.streak.electrons > 0.0
    rate = each.streak.electrons / content.exposure_s
    peak, matched = _signal_to_noise(sensor, content, each.streak, electrons)
    return SatelliteTruth(
        name=each.name,
        norad_id=each.norad_id,
        is_in_frame=_is_on_sensor(sensor, x[middle], y[middle]),
        is_whole=_is_on_sensor(sensor, x[0], y[0]) and _is_on_sensor(sensor, x[-1], y[-1]),
        ra_icrs_deg=float(each.ra_icrs_deg[middle]),
        dec_icrs_deg=float(each.dec_icrs_deg[middle]),
        ra_rate_deg_s=each.rates_deg_s[0],
        dec_rate_deg_s=each.rates_deg_s[1],
        x_px=float(x[middle]),
        y_px=float(y[middle]),
        x_start_px=float(x[0]),
        y_start_px=float(y[0]),
        x_end_px=float(x[-1]),
        y_end_px=float(y[-1]),
        magnitude=sensor.zero_point_mag - 2.5 * math.log10(rate) if is_lit else None,
        lit_fraction=each.lit_fraction,
        transmission=clouds,
        electrons=electrons,
        snr_peak_pixel=peak,
        snr_matched=matched,
        snr_integrated=integrated_snr(sensor, content, dim_streak(each.streak, air_transmission)),
    )


def _signal_to_noise(
    sensor: SensorModel, content: FieldContent, streak: Streak, electrons: float
) -> tuple[float, float]:
    """SNR of the brightest pixel, and of the streak weighted by its shape; noise of the sky.

    Across the streak the disc's core alone, widened by the pixel; along it steady.
    """
    x, y = streak.x_px, streak.y_px
    middle = len(x) // 2
    length_px = max(float(np.hypot(np.diff(x), np.diff(y)).sum()), 1.0)
    flat = vignetting(sensor, x[middle : middle + 1], y[middle : middle + 1])
    flat = flat * sensor.mean_filter_transmission
    sigma_px = math.sqrt(
        (content.fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0 + content.blur_variance_px2
    )
    core = electrons * float(flat[0]) * WINGS[0][0]
    peak_e = core / length_px / (sigma_px * math.sqrt(2.0 * math.pi))
    variance_e2 = (
        content.sky_electrons_px * float(flat[0])
        + sensor.dark_e_s * content.exposure_s
        + sensor.read_noise_e**2
        + sensor.e_per_adu12**2 / 12.0
    )
    noise_e = math.sqrt(variance_e2)
    weight_px = 2.0 * math.sqrt(math.pi) * sigma_px * length_px
    return peak_e / noise_e, core / (noise_e * math.sqrt(weight_px))


def _is_on_sensor(sensor: SensorModel, x_px: float, y_px: float) -> bool:
    return bool(-0.5 <= x_px < sensor.width_px - 0.5 and -0.5 <= y_px < sensor.height_px - 0.5)


def _is_near(sensor: SensorModel, x_px: FloatArray, y_px: FloatArray) -> bool:
    return bool(
        x_px.max() > -MARGIN_PX
        and x_px.min() < sensor.width_px + MARGIN_PX
        and y_px.max() > -MARGIN_PX
        and y_px.min() < sensor.height_px + MARGIN_PX
    )
