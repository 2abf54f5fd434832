"""A world's settings applied to the parts of a scene: sensor, clouds, sky, stars and plate."""

import math
from dataclasses import replace

import numpy as np

from rsoconsole.config import OpticsConfig
from rsoconsole.records import FloatArray, Wcs
from rsoconsole.simulator.camera.motion import ImageMotion, image_motion
from rsoconsole.simulator.camera.psf import (
    FWHM_PER_SIGMA,
    east_unit_vector_px,
    image_shift_px,
    with_radial_distortion,
    with_shifted_image,
)
from rsoconsole.simulator.camera.rendering import FieldContent, Float32Array, frame_rng
from rsoconsole.simulator.camera.sensor import (
    CATALOGUE_SIGMA_ARCSEC,
    SensorModel,
    catalogue_errors_arcsec,
)
from rsoconsole.simulator.sky.clouds import CloudDeck
from rsoconsole.simulator.world.world import (
    CatalogueWorld,
    CloudsWorld,
    MoonWorld,
    SeeingWorld,
    World,
)
from rsoconsole.sky import tan_wcs

_CLOUDS, _ROWS, _COLUMNS = 32, 33, 34
NIGHT_S = 43_200.0
_CLOUD_EDGE_S = 20.0
_CLOUD_STRUCTURE = 0.2
_RING_OBSTRUCTION = 0.45


def binned_optics(optics: OpticsConfig, world: World) -> OpticsConfig:
    """Configured optics with the world's binning: fewer and larger pixels."""
    factor = world.sensor.binning
    if factor == 1:
        return optics
    return optics.model_copy(
        update={
            "width_px": optics.width_px // factor,
            "height_px": optics.height_px // factor,
            "pixel_um": optics.pixel_um * factor,
        }
    )


def sensor_in_world(world: World, sensor: SensorModel) -> SensorModel:
    """Return the sensor with the world's imperfections; its size and pitch are binned already.

    Binning averages pixel values: a binned pixel has factor^2 as many electrons per ADU and in its
    full well. Another number of bits leaves the full well at full scale.
    """
    own, factor = world.sensor, world.sensor.binning
    steps = 2.0**own.bits / 2.0**sensor.adc_bits
    e_per_adu = sensor.e_per_adu12 / steps if own.gain_e_adu is None else own.gain_e_adu
    hot = sensor.hot_fraction if own.hot_fraction is None else own.hot_fraction
    return replace(
        sensor,
        focal_length_mm=sensor.focal_length_mm * (1.0 + world.optics.scale_error),
        adc_bits=own.bits,
        stored_shift_bits=16 - own.bits,
        e_per_adu12=e_per_adu * factor**2,
        offset_adu12=sensor.offset_adu12 * steps,
        full_well_e=sensor.full_well_e * factor**2,
        read_noise_e=sensor.read_noise_e * factor,
        dark_e_s=sensor.dark_e_s * factor**2,
        prnu=sensor.prnu / factor,
        hot_fraction=hot * factor**2,
        glow_e_s=own.glow_e_s * factor**2,
        # Joined pixels of a colour sensor have seen all colours.
        is_bayer=own.bayer and factor == 1,
    )


def clouds_in_world(world: CloudsWorld, seed: int, own: CloudDeck) -> CloudDeck:
    """Return the world's random cloud banks, or the scenario's clouds ``own`` at rate 0."""
    if world.rate_h <= 0.0:
        return own
    rng = frame_rng(seed, _CLOUDS)
    count = int(rng.poisson(world.rate_h * NIGHT_S / 3600.0))
    schedule = [(0.0, 0.0)]
    for begins_s in np.sort(rng.uniform(0.0, NIGHT_S, count)):
        first_s = max(float(begins_s), schedule[-1][0])
        thick_s = (first_s + _CLOUD_EDGE_S, first_s + _CLOUD_EDGE_S + world.duration_s)
        schedule += [(first_s, 0.0), *((t, world.extinction_mag) for t in thick_s)]
        schedule.append((thick_s[1] + _CLOUD_EDGE_S, 0.0))
    return CloudDeck(schedule=tuple(schedule), structure=_CLOUD_STRUCTURE)


def seeing_arcsec(world: SeeingWorld, own_arcsec: float, since_night_s: float) -> float:
    """FWHM of stars at the zenith, ``since_night_s`` after the night's start.

    ``own_arcsec``: the scenario's, used where the world sets none.
    """
    fwhm = own_arcsec if world.fwhm_arcsec is None else world.fwhm_arcsec
    if world.drift_percent_h == 0.0:
        return fwhm
    return float(fwhm * (1.0 + world.drift_percent_h / 100.0) ** (since_night_s / 3600.0))


def with_moonlight(content: FieldContent, moon: MoonWorld) -> FieldContent:
    """Return the field with a sky brightened by the Moon, and with the Moon's gradient."""
    if moon.brightening_mag == moon.gradient == 0.0:
        return content
    angle = math.radians(moon.gradient_angle_deg)
    return replace(
        content,
        sky_electrons_px=content.sky_electrons_px * 10.0 ** (0.4 * moon.brightening_mag),
        sky_gradient=(
            content.sky_gradient[0] + moon.gradient * math.cos(angle),
            content.sky_gradient[1] + moon.gradient * math.sin(angle),
        ),
    )


def star_displacements_arcsec(
    world: CatalogueWorld, ra_icrs_deg: FloatArray, dec_icrs_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Displacement (east, north), each (n,), of stars from the catalogue's positions of 1991.

    A random part for each star, and a common drift.
    """
    own = world.random_arcsec
    sigma = CATALOGUE_SIGMA_ARCSEC if own is None else own
    east, north = catalogue_errors_arcsec(ra_icrs_deg, dec_icrs_deg, sigma)
    if world.drift_arcsec == 0.0:
        return east, north
    angle = math.radians(world.drift_angle_deg)
    return (
        east + world.drift_arcsec * math.sin(angle),
        north + world.drift_arcsec * math.cos(angle),
    )


def with_row_and_column_offsets(
    content: FieldContent, world: World, sensor: SensorModel, seed: int, t_start_utc_ns: int
) -> FieldContent:
    """Return the field with random offsets of rows and columns, multiples of the sky's noise.

    Row offsets differ from frame to frame, column offsets last all night.
    """
    own = world.sensor
    noise_e = pixel_noise_e(sensor, content)

    def offsets(sigma: float, size: int, *key: int) -> Float32Array | None:
        if sigma == 0.0:
            return None
        normal = frame_rng(seed, *key).standard_normal(size, dtype=np.float32)
        return np.asarray(normal * np.float32(sigma * noise_e), dtype=np.float32)

    return replace(
        content,
        row_offsets_e=offsets(own.row_noise_sigma, sensor.height_px, t_start_utc_ns, _ROWS),
        column_offsets_e=offsets(own.column_noise_sigma, sensor.width_px, _COLUMNS),
    )


def pixel_noise_e(sensor: SensorModel, content: FieldContent) -> float:
    """One sigma of the noise of a pixel of empty sky in the middle of the frame, electrons."""
    sky_e = content.sky_electrons_px * sensor.mean_filter_transmission
    dark_e = sensor.dark_e_s * content.exposure_s
    return math.sqrt(sky_e + dark_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0)


def undisturbed_plate(
    world: World,
    sensor: SensorModel,
    boresight_icrs_deg: tuple[float, float],
    rotation_deg: float,
    is_flipped: bool,
) -> Wcs:
    """Return the plate of an image without motion, centred exactly on the boresight.

    It has the world's distortion, and the world's scale error by way of ``sensor``.
    """
    wcs = tan_wcs(
        *boresight_icrs_deg,
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=rotation_deg,
        is_flipped=is_flipped,
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    return with_radial_distortion(wcs, world.optics.distortion)


def plate_in_motion(  # noqa: PLR0917 - drawn the way it is spoken: of what, when, how long
    world: World,
    plate: Wcs,
    scale_arcsec_px: float,
    key: tuple[int, int],
    exposure_s: float,
    since_night_s: float,
    mount_path_arcsec: FloatArray | None,
) -> tuple[Wcs, ImageMotion | None]:
    """The plate shifted by the image's mean displacement, and the motion about that mean.

    The motion is None for a still image. ``key``: the night's seed and the exposure's start (UTC
    ns). ``since_night_s``: seconds from the night's start to the exposure's. ``mount_path_arcsec``:
    (2, k) as in ``Scene.expose``.
    """
    mount_px = None if mount_path_arcsec is None else image_shift_px(plate, *mount_path_arcsec)
    east = east_unit_vector_px(plate)
    found = image_motion(world, *key, exposure_s, since_night_s, scale_arcsec_px, east, mount_px)
    if found is None:
        return plate, None
    motion, mean_px = found
    return with_shifted_image(plate, mean_px), motion


def with_defocus_and_motion(
    content: FieldContent, world: World, sensor: SensorModel, motion: ImageMotion | None
) -> FieldContent:
    """Return the field blurred by the world's defocus and the image's motion (None: still)."""
    ring_px = world.focus.ring_px
    if motion is None and ring_px == 0.0:
        return content
    moving_px2 = 0.0 if motion is None else motion.variance_px2
    sigma_px = content.fwhm_px / FWHM_PER_SIGMA
    reach_px = 0.5 * math.hypot(sensor.width_px, sensor.height_px)
    return replace(
        content,
        defocus_px=ring_px,
        stands=None if motion is None else motion.positions_with_dwell(sigma_px, reach_px),
        # The ring with the dark middle that ``psf.annulus`` gives it, on one axis.
        blur_variance_px2=moving_px2 + ring_px**2 * (1.0 + _RING_OBSTRUCTION**2) / 4.0,
    )
