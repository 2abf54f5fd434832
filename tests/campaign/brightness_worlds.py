"""Frames whose lights have a known magnitude, drawn at random by number, for ``brightness``.

Two exposures of one piece of the real sky: the first without satellites, the second with some, each
of a magnitude that is known. Light falls on the pixels as the renderer's disc has it, to its
faintest wings; photons, gain and converter are drawn here. Stars are those of the catalogue, each
off by a little, and fainter ones by count.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from models.altered import Scene, before_motion, drifted, lit_streak, streak_path, true_ends, windy
from models.light import log_uniform
from models.telescopes import QUARTER
from rsoconsole.records import FloatArray, Frame, Solution, Wcs
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    NS,
    WINGS,
    CloudDeck,
    FieldContent,
    SensorModel,
    Streak,
    frame_rng,
    image_motion_kernel,
    streak_points,
    transmission_at,
    vignetting,
)
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.simulator.camera.rendering import Float32Array, expected_electrons
from rsoconsole.simulator.camera.sensor import flat_field
from rsoconsole.simulator.sky.star_background import faint_stars
from rsoconsole.sky import (
    StarCatalogue,
    Stars,
    describe_field,
    iso_to_utc_ns,
    julian_year,
    pixel_to_sky,
    sky_to_pixel,
    tan_wcs,
)

Rng = np.random.Generator

SUN_COLOUR_MAG = 0.73
"""BT - VT, as all colours here; magnitudes are VT."""
STAR_SIGMA_MAG = 0.02
"""One sigma by which a drawn star is off its catalogue magnitude."""
HALF = replace(QUARTER, width_px=3292, height_px=2488)
STREAKS, SNR, LENGTH_PX = 6, (20.0, 250.0), (30.0, 500.0)
MIN_STARS = 8
"""Catalogue stars of a frame that are not saturated: another is drawn where it has fewer."""
_OBJECT_COLOUR_MAG = 0.85, 0.23
"""Mean and one sigma: satellites are a little redder than the Sun."""
_STAR_COLOUR_MAG = 0.75, 0.35
"""Of stars without a colour in the catalogue, and of those fainter than it."""
_FAINTEST_MAG, _MARGIN_PX = 16.5, 40.0
_PLACE_SIGMA_ARCSEC, _PLATE_SIGMA_PX = 0.15, 0.1
_RIM_PX, _MAX_SKY = 40.0, 0.3
_CADENCE_S = 30.0
_FAINTEST_E = 0.002
_T0_UTC_NS = iso_to_utc_ns("2026-09-12T02:00:00Z")
_SEED = 20261130


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One kind of nights."""

    title: str
    is_any_telescope: bool = False
    is_cloudy: bool = False
    is_catalogue_off: bool = False
    """True where stars are off by the catalogue's own errors too."""


FAMILIES: Mapping[str, Family] = {
    "clear": Family(title="clear"),
    "cloud": Family(title="thin cloud", is_cloudy=True),
    "worlds": Family(title="any telescope", is_any_telescope=True),
    "errors": Family(
        title="any telescope, catalogue errors", is_any_telescope=True, is_catalogue_off=True
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """A telescope, its field and the air above it in one exposure."""

    scene: Scene
    wcs: Wcs
    colour_term: float
    """Change of a star's magnitude in the camera's band with its colour."""
    catalogue_stars: int
    """Those in the frame that are not saturated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueLight:
    """One satellite: its ends (px), integrated SNR and magnitude."""

    ends: tuple[float, float, float, float]
    snr: float
    sun_mag: float
    """VT, were it of the Sun's colour."""
    mag: float
    """VT by its own colour."""
    flux_adu: float
    """What the converter makes of its light, after cloud and vignetting."""
    is_steady: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnFrames:
    """A frame with satellites and the one before it without, their plates, and the truth."""

    before: tuple[Frame, Solution]
    frame: tuple[Frame, Solution]
    lights: tuple[TrueLight, ...]
    world: World


def draw(name: str, number: int) -> DrawnFrames:
    """One pair of frames of a family; a pure function of its name and number."""
    key = _SEED, list(FAMILIES).index(name), number
    rng = frame_rng(*key)
    world = world_of(FAMILIES[name], rng)
    lights, streaks = satellites(world, rng)
    shifts = (rng.uniform(-15.0, 15.0, 2), np.zeros(2))
    pairs = []
    for turn, shift_px in enumerate(shifts):
        pixels = exposed(world, streaks if turn else (), shift_px, frame_rng(*key, 1 + turn))
        pairs.append(_framed(world, shift_px, pixels, turn, rng))
    return DrawnFrames(before=pairs[0], frame=pairs[1], lights=lights, world=world)


def world_of(family: Family, rng: Rng) -> World:
    """Draw telescope, field, sky and air until the frame has enough stars that are measurable."""
    while True:
        world = any_world(family, rng)
        if world.catalogue_stars >= MIN_STARS:
            return world


def any_world(family: Family, rng: Rng) -> World:
    """Draw telescope, field, sky and air."""
    sensor, content = any_telescope(rng) if family.is_any_telescope else usual_telescope(rng)
    wcs = tan_wcs(
        float(rng.uniform(0.0, 360.0)),
        float(rng.uniform(-9.0, 9.0)),
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=float(rng.uniform(0.0, 360.0)),
        is_flipped=bool(rng.random() < 0.5),
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    field = describe_field(wcs, sensor.width_px, sensor.height_px)
    half_px = 0.5 * math.hypot(sensor.width_px, sensor.height_px) + _MARGIN_PX
    cone = (field.ra_icrs_deg, field.dec_icrs_deg, half_px * sensor.scale_arcsec_px / 3600.0)
    known = StarCatalogue.load().cone(*cone, epoch_jyear=julian_year(_T0_UTC_NS))
    term = float(rng.uniform(-0.4, 0.1))
    stars = (known, faint_stars(*cone, _FAINTEST_MAG))
    x, y, electrons = star_lights(sensor, content.exposure_s, wcs, stars, term, family, rng)
    content = replace(content, star_x_px=x, star_y_px=y, star_electrons=electrons)
    if family.is_cloudy:
        content = replace(content, cloud_transmission=cloud_over(sensor, rng))
    scene = Scene(sensor=sensor, content=content)
    if rng.random() < 0.4:
        scene = windy(scene, float(rng.uniform(0.1, 0.6)), rng)
    elif rng.random() < 0.3:
        scene = drifted(scene, float(rng.uniform(0.5, 3.0)), rng)
    usable = measurable_stars(sensor, content, wcs, known)
    return World(scene=scene, wcs=wcs, colour_term=term, catalogue_stars=usable)


def measurable_stars(sensor: SensorModel, content: FieldContent, wcs: Wcs, known: Stars) -> int:
    """Count catalogue stars in the frame that a still image does not saturate."""
    x, y = sky_to_pixel(wcs, known.ra_icrs_deg, known.dec_icrs_deg)
    inside = (x > _RIM_PX) & (x < sensor.width_px - _RIM_PX)
    inside &= (y > _RIM_PX) & (y < sensor.height_px - _RIM_PX)
    sigma_px = content.fwhm_px / FWHM_PER_SIGMA
    peak_share = math.erf(0.5 / (math.sqrt(2.0) * sigma_px)) ** 2
    peak_e = sensor.electrons(known.magnitude, content.exposure_s) * peak_share
    room_e = (sensor.largest_value_adu12 - sensor.offset_adu12) * sensor.e_per_adu12
    return int(np.sum(inside & (peak_e < 0.8 * (room_e - content.sky_electrons_px))))


def usual_telescope(rng: Rng) -> tuple[SensorModel, FieldContent]:
    """The demo's camera, half of it, with its sky and seeing."""
    sensor, exposure_s = HALF, 10.0
    per_s = log_uniform(rng, 8.0, 40.0)
    fwhm_px = log_uniform(rng, 2.2, 4.0) / sensor.scale_arcsec_px
    content = FieldContent(
        exposure_s=exposure_s,
        fwhm_px=max(fwhm_px, 1.5),
        sky_electrons_px=per_s * exposure_s,
        sky_gradient=(0.03, -0.04),
    )
    return sensor, content


def any_telescope(rng: Rng) -> tuple[SensorModel, FieldContent]:
    """Scale, FWHM, gain, bits, sky and size of the frame at random."""
    scale, pixel_um = log_uniform(rng, 0.8, 8.0), float(rng.uniform(2.4, 9.0))
    bits, full_well_e = int(rng.choice((8, 10, 12, 14, 16))), log_uniform(rng, 1e4, 1e5)
    read_noise_e, exposure_s = log_uniform(rng, 1.0, 10.0), log_uniform(rng, 1.0, 20.0)
    step_e = min(full_well_e / 2.0**bits, float(rng.uniform(0.7, 2.0)) * read_noise_e)
    sensor = SensorModel(
        width_px=int(rng.integers(1400, 2600)),
        height_px=int(rng.integers(1200, 2000)),
        pixel_um=pixel_um,
        focal_length_mm=206.264806 * pixel_um / scale,
        zero_point_mag=float(rng.uniform(19.5, 22.5)),
        e_per_adu12=step_e,
        offset_adu12=4.0 if bits == 8 else 2.0 ** (bits - 7),
        read_noise_e=read_noise_e,
        full_well_e=full_well_e,
        adc_bits=bits,
        stored_shift_bits=0 if bits == 8 or rng.random() < 0.5 else 16 - bits,
        vignetting_corner=float(rng.uniform(0.0, 0.15)),
        prnu=float(rng.uniform(0.001, 0.01)),
        seed=int(rng.integers(1 << 30)),
    )
    sky_mag = float(rng.uniform(18.0, 21.5))
    sky_e = float(sensor.electrons(sky_mag, exposure_s)) * scale**2
    angle, slope = float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.uniform(0.0, 0.2))
    content = FieldContent(
        exposure_s=exposure_s,
        fwhm_px=log_uniform(rng, 1.5, 6.0),
        sky_electrons_px=min(sky_e, _MAX_SKY * sensor.largest_value_adu12 * step_e),
        sky_gradient=(slope * math.cos(angle), slope * math.sin(angle)),
    )
    return sensor, content


def cloud_over(sensor: SensorModel, rng: Rng) -> Float32Array:
    """Transmission of a thin cloud that drifts over the field."""
    deck = CloudDeck(
        schedule=((0.0, log_uniform(rng, 0.15, 1.2)),), structure=float(rng.uniform(0.2, 0.7))
    )
    rows, columns = 24, 32
    x = (np.arange(columns) + 0.5) / columns * sensor.width_px * sensor.scale_arcsec_px / 3600.0
    y = (np.arange(rows) + 0.5) / rows * sensor.height_px * sensor.scale_arcsec_px / 3600.0
    return deck.transmission(*np.meshgrid(x, y), (0.0, 10.0), int(rng.integers(1 << 30)))


def star_lights(  # noqa: PLR0917 - drawn the way it is spoken: whose, how long, where, which
    sensor: SensorModel,
    exposure_s: float,
    wcs: Wcs,
    stars: tuple[Stars, Stars],
    colour_term: float,
    family: Family,
    rng: Rng,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pixels and electrons of the catalogue's stars and of the fainter ones."""
    known, faint = stars
    off_mag = rng.normal(0.0, STAR_SIGMA_MAG, len(known))
    if family.is_catalogue_off:
        off_mag += rng.normal(0.0, 1.0, len(known)) * np.nan_to_num(known.sigma_mag)
    drawn = rng.normal(*_STAR_COLOUR_MAG, len(known))
    colour = np.where(np.isnan(known.colour_mag), drawn, known.colour_mag)
    ra = np.concatenate([known.ra_icrs_deg, faint.ra_icrs_deg])
    dec = np.concatenate([known.dec_icrs_deg, faint.dec_icrs_deg])
    vt_mag = np.concatenate([known.magnitude + off_mag, faint.magnitude])
    colour = np.concatenate([colour, rng.normal(*_STAR_COLOUR_MAG, len(faint))])
    x, y = sky_to_pixel(wcs, ra, dec)
    sigma_px = _PLACE_SIGMA_ARCSEC / sensor.scale_arcsec_px
    x, y = x + rng.normal(0.0, sigma_px, len(x)), y + rng.normal(0.0, sigma_px, len(y))
    near = (x > -_MARGIN_PX) & (x < sensor.width_px + _MARGIN_PX)
    near &= (y > -_MARGIN_PX) & (y < sensor.height_px + _MARGIN_PX)
    mag = vt_mag + colour_term * (colour - SUN_COLOUR_MAG)
    return x[near], y[near], sensor.electrons(mag[near], exposure_s)


def satellites(world: World, rng: Rng) -> tuple[tuple[TrueLight, ...], tuple[Streak, ...]]:
    """Streaks apart from each other, every other one steady, and their true magnitudes."""
    lights: list[TrueLight] = []
    streaks: list[Streak] = []
    sensor, exposure_s = world.scene.sensor, world.scene.content.exposure_s
    for ends in places(world, rng):
        scene, is_steady = world.scene, bool(rng.random() < 0.5)
        if not is_steady:
            scene = replace(scene, brightness=slow_curve(rng))
        path = streak_path(scene, before_motion(scene, ends))
        length_px = float(np.hypot(*(ends[1] - ends[0])))
        streak, snr = lit_streak(scene, path, length_px, log_uniform(rng, *SNR))
        sun_mag = sensor.zero_point_mag - 2.5 * math.log10(streak.electrons / exposure_s)
        redder = float(rng.normal(*_OBJECT_COLOUR_MAG)) - SUN_COLOUR_MAG
        streaks.append(streak)
        x, y, electrons = streak_points(sensor, scene.content, streak)
        per_e = 2.0**sensor.stored_shift_bits / sensor.e_per_adu12
        (x_a, y_a), (x_b, y_b) = true_ends(scene, before_motion(scene, ends))
        lights.append(
            TrueLight(
                ends=(x_a, y_a, x_b, y_b),
                snr=snr,
                sun_mag=sun_mag,
                mag=sun_mag - world.colour_term * redder,
                flux_adu=per_e * float(electrons @ vignetting(sensor, x, y)),
                is_steady=is_steady,
            )
        )
    return tuple(lights), tuple(streaks)


def slow_curve(rng: Rng) -> FloatArray:
    """Brightness that changes slowly over the exposure; its mean is 1."""
    t = np.linspace(0.0, 1.0, 401)
    wave = np.sin(2.0 * math.pi * (float(rng.uniform(0.2, 1.5)) * t + rng.random()))
    curve = 1.0 + float(rng.uniform(0.1, 0.6)) * wave
    return np.asarray(curve / np.trapezoid(curve, t))


def places(world: World, rng: Rng) -> list[FloatArray]:
    """Ends (2, 2) of streaks that lie in the frame, well apart from each other."""
    sensor, content = world.scene.sensor, world.scene.content
    size = np.array([sensor.width_px, sensor.height_px], dtype=np.float64)
    apart_px, found = 30.0 + 10.0 * content.fwhm_px, []
    shortest = max(LENGTH_PX[0], 6.0 * content.fwhm_px)
    for _ in range(40 * STREAKS):
        length_px, angle = log_uniform(rng, shortest, LENGTH_PX[1]), rng.uniform(0.0, 2.0 * math.pi)
        half = 0.5 * length_px * np.array([math.cos(angle), math.sin(angle)])
        room = size / 2.0 - np.abs(half) - _RIM_PX
        ends = size / 2.0 + rng.uniform(-room, room) + np.stack([-half, half])
        if all(_apart_px(ends, other) > apart_px for other in found):
            found.append(ends)
        if len(found) == STREAKS:
            break
    return found


def _apart_px(one: FloatArray, other: FloatArray) -> float:
    share = np.linspace(0.0, 1.0, 60)[:, None]
    a, b = (ends[0] + share * (ends[1] - ends[0]) for ends in (one, other))
    return float(np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1)).min())


def exposed(
    world: World, streaks: tuple[Streak, ...], shift_px: FloatArray, rng: Rng
) -> np.ndarray:
    """Pixels (height, width) of one exposure whose stars are shifted by (dx, dy)."""
    sensor, content = world.scene.sensor, world.scene.content
    none = np.zeros(0)
    bare = replace(content, star_x_px=none, star_y_px=none, star_electrons=none)
    mean_e = expected_electrons(sensor, bare)
    light_e = star_cores(world, shift_px)
    sigma_px = content.fwhm_px / FWHM_PER_SIGMA
    for streak in streaks:
        points = streak_points(sensor, content, streak)
        add_points(light_e, *points, sigma_px=sigma_px, faintest_e=_FAINTEST_E)
    light_e = with_wings(light_e, sigma_px)
    mean_e += light_e * flat_field(sensor)
    electrons = rng.poisson(mean_e) + rng.normal(0.0, sensor.read_noise_e, mean_e.shape)
    value = np.rint(electrons / sensor.e_per_adu12 + sensor.offset_adu12)
    value = np.clip(value, 0.0, math.floor(sensor.largest_value_adu12))
    return value.astype(np.uint16) << np.uint16(sensor.stored_shift_bits)


def star_cores(world: World, shift_px: FloatArray) -> Float32Array:
    """Electrons of all stars, (height, width), as discs without wings, with the image's motion."""
    sensor, content = world.scene.sensor, world.scene.content
    x, y = content.star_x_px + shift_px[0], content.star_y_px + shift_px[1]
    electrons = content.star_electrons * transmission_at(sensor, content.cloud_transmission, x, y)
    kernel = None if content.stands is None else image_motion_kernel(content.stands)
    rim = 0 if kernel is None else kernel.shape[0] // 2
    image = np.zeros((sensor.height_px + 2 * rim, sensor.width_px + 2 * rim), dtype=np.float32)
    sigma_px = content.fwhm_px / FWHM_PER_SIGMA
    add_points(image, x + rim, y + rim, electrons, sigma_px=sigma_px, faintest_e=_FAINTEST_E)
    if kernel is None:
        return image
    moved = cv2.filter2D(image, -1, kernel[::-1, ::-1], borderType=cv2.BORDER_CONSTANT)
    return np.ascontiguousarray(moved[rim : rim + sensor.height_px, rim : rim + sensor.width_px])


def with_wings(cores_e: Float32Array, sigma_px: float) -> Float32Array:
    """Spread discs as the renderer's wings do, those of faint lights as those of bright ones."""
    height, width = cores_e.shape
    light_e = np.zeros_like(cores_e)
    for share, wide in WINGS:
        wider_px = sigma_px * math.sqrt(wide**2 - 1.0)
        if wider_px == 0.0:
            light_e += np.float32(share) * cores_e
            continue
        # A wide wing is as well drawn on coarser pixels.
        coarse = max(1, int(wider_px / 3.0))
        size = (math.ceil(width / coarse), math.ceil(height / coarse))
        grown = cv2.copyMakeBorder(
            cores_e,
            0,
            size[1] * coarse - height,
            0,
            size[0] * coarse - width,
            cv2.BORDER_CONSTANT,
        )
        small = cv2.resize(grown, size, interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(small, (0, 0), wider_px / coarse, borderType=cv2.BORDER_CONSTANT)
        full = (size[0] * coarse, size[1] * coarse)
        wing = cv2.resize(blurred, full, interpolation=cv2.INTER_LINEAR)
        light_e += np.float32(share) * wing[:height, :width]
    return light_e


def _framed(
    world: World, shift_px: FloatArray, pixels: np.ndarray, turn: int, rng: Rng
) -> tuple[Frame, Solution]:
    """A frame with its header's facts, and its plate as a solver finds it."""
    sensor, exposure_s = world.scene.sensor, world.scene.content.exposure_s
    off_x, off_y = shift_px + rng.normal(0.0, _PLATE_SIGMA_PX, 2)
    wcs = replace(
        world.wcs,
        crpix_x_px=world.wcs.crpix_x_px + float(off_x),
        crpix_y_px=world.wcs.crpix_y_px + float(off_y),
    )
    middle = pixel_to_sky(wcs, (sensor.width_px - 1) / 2.0, (sensor.height_px - 1) / 2.0)
    ra, dec = (float(each) for each in middle)
    field = describe_field(wcs, sensor.width_px, sensor.height_px)
    frame = Frame(
        frame_id=turn + 1,
        name=f"frame {turn + 1}",
        pixels=pixels,
        t_start_utc_ns=_T0_UTC_NS + round(turn * _CADENCE_S * NS),
        exposure_s=exposure_s,
        scale_arcsec_px=sensor.scale_arcsec_px,
        pointing_ra_icrs_deg=ra,
        pointing_dec_icrs_deg=dec,
        saturation_adu=sensor.saturation_adu,
    )
    solution = Solution(
        frame_id=frame.frame_id,
        wcs=wcs,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=field.rotation_deg,
        is_flipped=field.is_flipped,
        matched=world.catalogue_stars,
        rms_arcsec=_PLACE_SIGMA_ARCSEC,
        path="full",
        ms=0.0,
    )
    return frame, solution
