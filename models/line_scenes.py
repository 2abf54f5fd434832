"""Random frames for the verifier: any telescope, any sky, several things wrong at once.

A frame is a pure function of (seed, number). Its sky is that of the calibration split of
``models.frames``, often with more stars; it is small, since only its lines are looked at.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from models.altered import (
    FAMILIES,
    Rng,
    Scene,
    before_motion,
    is_as_stars,
    lit_streak,
    streak_path,
    true_ends,
)
from models.fields import clip_to_box
from models.frames import TrueTrail, noise_electrons, sky_field
from models.light import log_uniform
from models.nuisances import drawn_out_stars, passing_aircraft, wide_cosmic_rays
from rsoconsole.records import FloatArray, Frame, PixelArray
from rsoconsole.simulator import FieldContent, SensorModel, Streak, frame_rng, render

SEED = 20281130
_AREA_PX, _SHAPE = (3e5, 5e6), (0.7, 1.5)
_LENGTH_PX, _SHORTEST_FWHM, _LONGEST_SHARE = (15.0, 1500.0), 4.0, 0.9
_SNR, _FAINT_SNR, _FAINT_SHARE = (6.0, 400.0), (6.0, 25.0), 0.5
_SATELLITES = (0.2, 0.3, 0.25, 0.15, 0.1)
"""Shares of frames with 0, 1, ... satellites."""
_ALIKE_SHARE, _IN_ROW_SHARE, _APART = 0.4, 0.5, (1.2, 3.0)
"""Shares of several satellites that move alike, and of those in one row; their pitch in lengths."""
_ALTERING = (
    *("plain", "plain", "plain", "blur", "ring", "ring", "drift", "drift", "wind", "wind"),
    *("stripes", "glow", "gradient", "moonlight", "crossings", "clouds", "undersampled"),
)
_ODD_RIM_SHARE = 0.03
_BESIDES = ("stripes", "gradient", "glow", "clouds", "moonlight")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineScene:
    """A drawn frame, the trails of its satellites, and trails that count neither way.

    ``peak_snr`` of a trail is its integrated SNR here.
    """

    frame: Frame
    trails: tuple[TrueTrail, ...]
    others: tuple[TrueTrail, ...]


def draw_scene(number: int, seed: int = SEED) -> LineScene:
    """Draw one frame."""
    rng = frame_rng(seed, number)
    sensor = _sensor(rng)
    exposure_s = 10.0 if rng.random() < 0.5 else log_uniform(rng, 0.2, 60.0)
    scene = _altered(Scene(sensor=sensor, content=_sky(sensor, exposure_s, rng)), rng)
    scene, others, rays = _with_nuisances(scene, rng)
    sensor, content = scene.sensor, scene.content
    streaks, trails = [], []
    for ends in _places(scene, int(rng.choice(len(_SATELLITES), p=_SATELLITES)), rng):
        drawn = _satellite(scene, ends, rng)
        if drawn is not None:
            streaks.append(drawn[0])
            trails.append(drawn[1])
    content = replace(content, streaks=(*streaks, *others, *rays))
    frame = Frame(
        frame_id=number,
        name=f"lines-{number}",
        pixels=_with_odd_rim(render(sensor, content, frame_rng(seed, number, 1)), rng),
        exposure_s=exposure_s,
        scale_arcsec_px=sensor.scale_arcsec_px,
        saturation_adu=sensor.saturation_adu,
    )
    unasked = []
    for other in others:
        seen = _clipped(np.stack([other.x_px[[0, -1]], other.y_px[[0, -1]]], axis=1), sensor)
        if seen is not None:
            unasked.append(_trail(seen, 0.0, is_cut=True))
    return LineScene(frame=frame, trails=tuple(trails), others=tuple(unasked))


def _sensor(rng: Rng) -> SensorModel:
    """A sensor behind a telescope: half of them as the paper's, half any."""
    area, shape = log_uniform(rng, *_AREA_PX), float(rng.uniform(*_SHAPE))
    sensor = SensorModel(
        width_px=int(math.sqrt(area * shape)),
        height_px=int(math.sqrt(area / shape)),
        seed=int(rng.integers(1 << 30)),
    )
    if rng.random() < 0.5:
        gain = log_uniform(rng, 0.3, 8.0)
        sensor = replace(
            sensor,
            focal_length_mm=sensor.focal_length_mm * log_uniform(rng, 0.2, 2.5),
            zero_point_mag=sensor.zero_point_mag + float(rng.uniform(-3.0, 1.0)),
            read_noise_e=log_uniform(rng, 1.0, 12.0),
            e_per_adu12=gain,
            full_well_e=4096.0 * gain,
            vignetting_corner=float(rng.uniform(0.0, 0.4)),
            prnu=float(rng.uniform(0.001, 0.01)),
        )
    chance = rng.random()
    if chance < 0.06:
        step_e = float(rng.uniform(6.0, 20.0))
        return replace(
            sensor, adc_bits=8, stored_shift_bits=0, e_per_adu12=step_e, offset_adu12=4.0
        )
    if chance < 0.12:
        return replace(sensor, is_bayer=True)
    if chance < 0.22:
        return replace(sensor, hot_fraction=log_uniform(rng, 1e-4, 3e-3))
    if chance < 0.32:
        bad, partial, dark = (int(n) for n in rng.integers(0, 4, size=3))
        blooming = float(rng.choice([0.0, 0.9]))
        return replace(
            sensor, bad_columns=bad, partial_columns=partial, dark_columns=dark, blooming=blooming
        )
    return sensor


def _sky(sensor: SensorModel, exposure_s: float, rng: Rng) -> FieldContent:
    """Stars and sky, often of another seeing, often with the Milky Way's faint stars."""
    content = sky_field("calibrate", "satellites", sensor, rng)
    if rng.random() < 0.5 or content.fwhm_px > 30.0:
        content = replace(content, fwhm_px=log_uniform(rng, 1.0, 8.0))
    times = exposure_s / 10.0
    x, y, light = content.star_x_px, content.star_y_px, content.star_electrons * times
    if rng.random() < 0.3 and len(x):
        more = len(x) * int(rng.integers(1, 6))
        faint = light[rng.integers(0, len(light), more)] * rng.uniform(0.02, 0.5, more)
        x = np.concatenate([x, rng.uniform(0.0, sensor.width_px, more)])
        y = np.concatenate([y, rng.uniform(0.0, sensor.height_px, more)])
        light = np.concatenate([light, faint])
    sky_e = min(content.sky_electrons_px * times, 0.3 * sensor.full_well_e)
    return replace(content, sky_electrons_px=sky_e, star_x_px=x, star_y_px=y, star_electrons=light)


def _altered(scene: Scene, rng: Rng) -> Scene:
    """The scene with one imperfection, or with two."""
    names = [str(rng.choice(_ALTERING))]
    if rng.random() < 0.3:
        names.append(str(rng.choice(_BESIDES)))
    for name in names:
        family = FAMILIES[name]
        severity = float(rng.uniform(family.low, family.high))
        if family.is_counted:
            severity = float(rng.integers(round(family.low), round(family.high) + 1))
        scene = family.alter(scene, severity, rng)
    return scene


def _with_nuisances(scene: Scene, rng: Rng) -> tuple[Scene, tuple[Streak, ...], tuple[Streak, ...]]:
    """The scene, its trails that count neither way, and cosmic rays as wide as stars."""
    sensor, content, others = scene.sensor, scene.content, scene.others
    noise_e = noise_electrons(sensor, content)
    width_px, height_px = sensor.width_px, sensor.height_px
    chance = rng.random()
    if chance < 0.06:
        others = (*others, *passing_aircraft(width_px, height_px, content.fwhm_px, noise_e, rng))
    elif chance < 0.10 and scene.motion is None and len(content.star_x_px) < 3000:
        content = drawn_out_stars(content, noise_e, rng)
    rays: tuple[Streak, ...] = ()
    if rng.random() < 0.15:
        rays = wide_cosmic_rays(width_px, height_px, rng)
        area = width_px * height_px / (4656 * 3520)
        content = replace(content, cosmic_rays=area * log_uniform(rng, 20.0, 1500.0))
    return replace(scene, content=content), others, rays


def _places(scene: Scene, count: int, rng: Rng) -> list[FloatArray]:
    """Ends (2, 2) of streaks anywhere, now and then along rows, or alike and one behind another."""
    sensor = scene.sensor
    diagonal = math.hypot(sensor.width_px, sensor.height_px)
    shortest = max(_LENGTH_PX[0], _SHORTEST_FWHM * scene.content.fwhm_px)
    is_alike, found = count > 1 and rng.random() < _ALIKE_SHARE, list[FloatArray]()
    half = np.zeros(2)
    for number in range(count):
        middle = rng.uniform(0.0, 1.0, 2) * np.array([sensor.width_px, sensor.height_px])
        if number and is_alike and rng.random() < _IN_ROW_SHARE:
            pitch = float(rng.uniform(*_APART)) * int(rng.choice([-1, 1]))
            off = rng.normal(0.0, scene.content.fwhm_px, 2)
            middle = found[-1].mean(axis=0) + 2.0 * pitch * half + off
        elif not (number and is_alike):
            length = log_uniform(rng, shortest, min(_LENGTH_PX[1], _LONGEST_SHARE * diagonal))
            angle = float(rng.uniform(0.0, 2.0 * math.pi))
            if rng.random() < 0.05:
                angle = float(rng.choice([0.0, 0.5])) * math.pi + float(rng.normal(0.0, 0.01))
            half = 0.5 * length * np.array([math.cos(angle), math.sin(angle)])
        found.append(np.stack([middle - half, middle + half]))
    return found


def _satellite(scene: Scene, ends: FloatArray, rng: Rng) -> tuple[Streak, TrueTrail] | None:
    """A streak between ``ends`` (2, 2), or what the edges leave of it; None where it is unseen."""
    sensor, length = scene.sensor, float(np.hypot(*(ends[1] - ends[0])))
    wanted = log_uniform(rng, *(_FAINT_SNR if rng.random() < _FAINT_SHARE else _SNR))
    lit = replace(scene, brightness=_light_curve(rng))
    if is_as_stars(scene, ends):
        return None
    before = before_motion(lit, ends)
    shown = _clipped(np.array(true_ends(lit, before)), sensor)
    if shown is None or math.hypot(shown[2] - shown[0], shown[3] - shown[1]) < 6.0:
        return None
    streak, snr = lit_streak(lit, streak_path(lit, before), length, wanted)
    if not 0.5 * wanted < snr < 2.0 * wanted:
        return None
    is_cut = math.hypot(shown[2] - shown[0], shown[3] - shown[1]) < length - 0.5
    return streak, _trail(shown, snr, is_cut=is_cut)


def _with_odd_rim(pixels: PixelArray, rng: Rng) -> PixelArray:
    """The frame, now and then with brighter or darker rows or columns at one edge, as in videos."""
    if rng.random() >= _ODD_RIM_SHARE:
        return pixels
    count, scatter = int(rng.integers(1, 5)), float(np.std(pixels[::7, ::7]))
    rim = (pixels[:count], pixels[-count:], pixels[:, :count], pixels[:, -count:])
    odd = rim[int(rng.integers(4))]
    shifted = odd + float(rng.normal(0.0, 3.0)) * scatter
    odd[...] = np.clip(shifted, 0.0, float(np.iinfo(np.uint16).max)).astype(pixels.dtype)
    return pixels


def _light_curve(rng: Rng) -> FloatArray | None:
    """Relative brightness along a streak: mostly steady, else periodic or fading."""
    chance, t = rng.random(), np.linspace(0.0, 1.0, 200)
    if chance < 0.15:
        depth, phase = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.0, 2.0 * math.pi))
        periods = float(rng.uniform(0.5, 10.0))
        return np.asarray(1.0 + depth * np.cos(2.0 * math.pi * periods * t + phase))
    if chance < 0.22:
        fading = 1.0 - t * (1.0 - float(rng.uniform(0.0, 0.6)))
        return fading[:: int(rng.choice([-1, 1]))]
    return None


def _clipped(ends: FloatArray, sensor: SensorModel) -> tuple[float, float, float, float] | None:
    """The part of a line between ``ends`` (2, 2) that the frame shows, px; None outside."""
    (x_a, y_a), (x_b, y_b) = (ends + 0.5).tolist()
    seen = clip_to_box((x_a, y_a, x_b, y_b), sensor.width_px, sensor.height_px)
    if seen is None:
        return None
    return seen[0] - 0.5, seen[1] - 0.5, seen[2] - 0.5, seen[3] - 0.5


def _trail(ends: tuple[float, float, float, float], snr: float, *, is_cut: bool) -> TrueTrail:
    x_a, y_a, x_b, y_b = ends
    return TrueTrail(x_a_px=x_a, y_a_px=y_a, x_b_px=x_b, y_b_px=y_b, peak_snr=snr, is_cut=is_cut)
