"""Whole frames of the paper's telescope with their truth, for calibration and measurement.

A frame is a pure function of (split, kind, number): the real sky near the geostationary belt
(``simulator.scene``) at a random position, night, seeing and sky brightness, drawn by the simulated
camera's renderer. The splits share no seed, no part of the sky (alternating bands of right
ascension, further apart than a field is wide), no year and no copy of the sensor. They share
nothing with the training, whose star fields are synthetic.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from models.fields import clip_to_box
from models.nuisances import drawn_out_stars, passing_aircraft, wide_cosmic_rays
from rsoconsole.records import Frame
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    NS,
    WINGS,
    CloudDeck,
    FieldContent,
    FloatArray,
    Scene,
    SensorModel,
    frame_rng,
    render,
    scenario_named,
    straight_streak,
    transmission_at,
    vignetting,
)
from rsoconsole.sky import iso_to_utc_ns, tan_wcs

Split = Literal["calibrate", "test"]
Kind = Literal["empty", "satellites", "clouds", "aircraft", "jitter", "rays", "altered"]
KINDS: tuple[Kind, ...] = ("empty", "satellites", "clouds", "aircraft", "jitter", "rays")
"""Kinds of frames of the paper's telescope without imperfections; ``models.altered`` has those."""
HARD: tuple[Kind, ...] = ("aircraft", "jitter", "rays")
"""Kinds without a satellite whose frames hold lights that resemble one."""
EXPOSURE_S = 10.0
GEO_PX = 118.5
"""Length of a geostationary satellite's streak: 15.04 arcsec/s for 10 s at 1.264 arcsec/px."""
PEAK_SNR = 0.8, 30.0
LENGTH_PX = 15.0, 600.0
_SEED = 20270301
_SPLITS: dict[Split, int] = {"calibrate": 11, "test": 12}
_YEARS: dict[Split, int] = {"calibrate": 2023, "test": 2025}
_BANDS_DEG: dict[Split, tuple[float, float]] = {"calibrate": (1.5, 13.5), "test": (16.5, 28.5)}
"""Bands in every 30 deg of right ascension; a field reaches 1.03 deg from its middle."""
_BAND_STEP_DEG = 30.0
_DEC_DEG = 10.0
"""Largest declination of a field: the shipped catalogue ends at 12 deg."""
_CUT_SHARE = 0.08
_APART_PX, _CLUSTER_TURN = (40.0, 900.0), 0.003
"""Distances of neighbours in one slot of the belt; one sigma of their directions, rad."""
_MIDNIGHT_UT_H = 81.05 / 15.0
_MARCH_EQUINOX_DAY = 80.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueTrail:
    """The visible part of one satellite's trail, from end a to end b, in pixels of the frame."""

    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    peak_snr: float
    """Peak SNR: electrons of the ridge's pixels above the sky over one sigma of a pixel's noise."""
    is_cut: bool
    """True where the frame's edge hides a part of the trail."""

    @property
    def length_px(self) -> float:
        """Length of the visible part from end to end."""
        return math.hypot(self.x_b_px - self.x_a_px, self.y_b_px - self.y_a_px)

    @property
    def middle_px(self) -> tuple[float, float]:
        """Column and row of the visible part's midpoint."""
        return 0.5 * (self.x_a_px + self.x_b_px), 0.5 * (self.y_a_px + self.y_b_px)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueFrame:
    """A drawn frame with its truth: kind, trails, content and sensor."""

    frame: Frame
    kind: Kind
    trails: tuple[TrueTrail, ...]
    content: FieldContent
    sensor: SensorModel


def draw(split: Split, kind: Kind, number: int, sensor: SensorModel | None = None) -> TrueFrame:
    """Draw one frame of a split.

    ``sensor``: for smaller frames; its seed is replaced by the split's. None: the paper's.
    """
    key = _SEED, _SPLITS[split], KINDS.index(kind), number
    rng = frame_rng(*key)
    sensor = replace(sensor or SensorModel(), seed=_SEED + _SPLITS[split])
    content = sky_field(split, kind, sensor, rng)
    trails: tuple[TrueTrail, ...] = ()
    if kind in {"satellites", "clouds"}:
        content, trails = _with_satellites(sensor, content, int(rng.integers(1, 4)), rng)
    elif kind == "aircraft":
        noise_e = noise_electrons(sensor, content)
        lights = passing_aircraft(sensor.width_px, sensor.height_px, content.fwhm_px, noise_e, rng)
        content = replace(content, streaks=lights)
    elif kind == "jitter":
        noise_e = noise_electrons(sensor, content)
        content = drawn_out_stars(content, noise_e, rng)
    elif kind == "rays":
        rays = wide_cosmic_rays(sensor.width_px, sensor.height_px, rng)
        area = sensor.width_px * sensor.height_px / (4656 * 3520)
        many = area * math.exp(rng.uniform(math.log(200.0), math.log(900.0)))
        content = replace(content, streaks=rays, cosmic_rays=many)
    frame = Frame(
        frame_id=number,
        name=f"{split}-{kind}-{number}",
        pixels=render(sensor, content, frame_rng(*key, 1)),
        exposure_s=EXPOSURE_S,
        scale_arcsec_px=sensor.scale_arcsec_px,
        saturation_adu=sensor.saturation_adu,
    )
    return TrueFrame(frame=frame, kind=kind, trails=trails, content=content, sensor=sensor)


def sky_field(
    split: Split, kind: Kind, sensor: SensorModel, rng: np.random.Generator
) -> FieldContent:
    """Stars, sky and weather at a random position and night of the split."""
    low, high = _BANDS_DEG[split]
    ra_deg = _BAND_STEP_DEG * int(rng.integers(12)) + float(rng.uniform(low, high))
    wcs = tan_wcs(
        ra_deg,
        float(rng.uniform(-_DEC_DEG, _DEC_DEG)),
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=float(rng.uniform(0.0, 360.0)),
        is_flipped=bool(rng.random() < 0.5),
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    t_utc_ns = _night_for(_YEARS[split], ra_deg + float(rng.uniform(-45.0, 45.0)), rng)
    clouds = CloudDeck(schedule=())
    if kind == "clouds":
        mean_mag = float(rng.uniform(0.2, 2.0))
        clouds = CloudDeck(schedule=((0.0, mean_mag),), structure=float(rng.uniform(0.05, 0.6)))
    night = replace(
        scenario_named("empty"),
        t_start_utc_ns=t_utc_ns,
        clouds=clouds,
        seeing_arcsec=float(np.exp(rng.uniform(math.log(2.2), math.log(4.0)))),
        sky_electrons_s=float(np.exp(rng.uniform(math.log(8.0), math.log(40.0)))),
        cosmic_rays_s=float(np.exp(rng.uniform(math.log(0.1), math.log(2.0)))),
    )
    scene = Scene(night, int(rng.integers(1 << 30)), sensor=sensor)
    return scene.field_content(wcs, t_utc_ns, EXPOSURE_S)


def _night_for(year: int, sidereal_deg: float, rng: np.random.Generator) -> int:
    """UTC (ns) of a night of ``year``, to some degrees, when this right ascension culminates."""
    after_midnight_h = float(rng.uniform(-5.0, 5.0))
    midnight_deg = sidereal_deg - 180.0 - 15.04 * after_midnight_h
    day = (_MARCH_EQUINOX_DAY + midnight_deg / 0.98565) % 365.0
    hours = 24.0 * math.floor(day) + _MIDNIGHT_UT_H + after_midnight_h
    return iso_to_utc_ns(f"{year}-01-01T00:00:00Z") + round(hours * 3600.0) * NS


def _with_satellites(
    sensor: SensorModel, content: FieldContent, count: int, rng: np.random.Generator
) -> tuple[FieldContent, tuple[TrueTrail, ...]]:
    """Satellites anywhere, or, every other time that there are several, a cluster side by side."""
    streaks, trails = [], []
    is_cluster = count > 1 and rng.random() < 0.5
    angle, length_px = float(rng.uniform(0.0, 2.0 * math.pi)), GEO_PX
    x, y = 0.0, 0.0
    for member in range(count):
        peak_snr = float(np.exp(rng.uniform(*np.log(PEAK_SNR))))
        if not is_cluster:
            angle, length_px = float(rng.uniform(0.0, 2.0 * math.pi)), _length_px(rng)
        dx, dy = 0.5 * length_px * math.cos(angle), 0.5 * length_px * math.sin(angle)
        if is_cluster and member:
            away, bearing = rng.uniform(*_APART_PX), rng.uniform(0.0, 2.0 * math.pi)
            x, y = x + float(away * math.cos(bearing)), y + float(away * math.sin(bearing))
            angle += float(rng.normal(0.0, _CLUSTER_TURN))
        else:
            x, y = _place(sensor, dx, dy, rng)
        seen = clip_to_box(
            (x - dx + 0.5, y - dy + 0.5, x + dx + 0.5, y + dy + 0.5),
            sensor.width_px,
            sensor.height_px,
        )
        if seen is None:
            continue
        per_px = electrons_per_px(sensor, content, x, y, peak_snr)
        streaks.append(straight_streak((x - dx, y - dy), (x + dx, y + dy), per_px * length_px))
        x_a, y_a, x_b, y_b = (at - 0.5 for at in seen)
        is_cut = math.hypot(x_b - x_a, y_b - y_a) < length_px - 0.5
        trails.append(
            TrueTrail(
                x_a_px=x_a, y_a_px=y_a, x_b_px=x_b, y_b_px=y_b, peak_snr=peak_snr, is_cut=is_cut
            )
        )
    return replace(content, streaks=tuple(streaks)), tuple(trails)


def _length_px(rng: np.random.Generator) -> float:
    """Length of one streak: geostationary every other time."""
    if rng.random() < 0.5:
        return GEO_PX
    return float(np.exp(rng.uniform(*np.log(LENGTH_PX))))


def _place(
    sensor: SensorModel, dx: float, dy: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Midpoint of a streak: anywhere, now and then where an edge cuts it."""
    x = float(rng.uniform(0.0, sensor.width_px - 1.0))
    y = float(rng.uniform(0.0, sensor.height_px - 1.0))
    if rng.random() < _CUT_SHARE:
        if rng.random() < 0.5:
            x = float(rng.choice([0.0, sensor.width_px - 1.0]) + rng.uniform(-0.8, 0.8) * dx)
        else:
            y = float(rng.choice([0.0, sensor.height_px - 1.0]) + rng.uniform(-0.8, 0.8) * dy)
    return x, y


def electrons_per_px(
    sensor: SensorModel, content: FieldContent, x_px: float, y_px: float, peak_snr: float
) -> float:
    """Electrons per pixel of length that give a streak this peak SNR at a pixel (x, y).

    Peak: of a pixel centred on the ridge, with the disc's wings and the pixel's width. Noise: of
    sky, cloud glow, dark current, read-out and converter. Under cloud the result is the light
    before the cloud, so that the SNR is that of the light transmitted.
    """
    at = np.array([x_px]), np.array([y_px])
    dimming = float(transmission_at(sensor, content.cloud_transmission, *at)[0])
    flat = float(vignetting(sensor, *at)[0])
    noise_e = noise_electrons(sensor, content, x_px, y_px)
    return peak_snr * noise_e / (ridge_share(content.fwhm_px) * flat * max(dimming, 1e-3))


def ridge_share(fwhm_px: float) -> float:
    """Light of a pixel on a long streak's ridge, as a fraction of its light per pixel of length."""
    sigma_px = fwhm_px / FWHM_PER_SIGMA
    return sum(share * math.erf(0.5 / (math.sqrt(2.0) * wide * sigma_px)) for share, wide in WINGS)


def noise_electrons(
    sensor: SensorModel,
    content: FieldContent,
    x_px: float | None = None,
    y_px: float | None = None,
) -> float:
    """One sigma of the noise of a pixel without stars, electrons.

    ``x_px``, ``y_px``: the pixel; None: the middle of the frame.
    """
    x = 0.5 * (sensor.width_px - 1) if x_px is None else x_px
    y = 0.5 * (sensor.height_px - 1) if y_px is None else y_px
    place: tuple[FloatArray, FloatArray] = np.array([x]), np.array([y])
    clouds = 1.0 - float(transmission_at(sensor, content.cloud_transmission, *place)[0])
    sky_e = content.sky_electrons_px * (1.0 + content.cloud_glow * clouds)
    along_x = content.sky_gradient[0] * ((x + 0.5) / sensor.width_px - 0.5)
    along_y = content.sky_gradient[1] * ((y + 0.5) / sensor.height_px - 0.5)
    sky_e *= 1.0 + along_x + along_y
    variance = sky_e * float(vignetting(sensor, *place)[0]) + sensor.dark_e_s * content.exposure_s
    return math.sqrt(variance + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0)
