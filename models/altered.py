"""Frames with one imperfection each: a family per imperfection, its severity drawn at random.

A frame is a pure function of (split, family, number): the real sky of a split of ``models.frames``,
a quarter of the full size, one satellite's streak wholly in it, and one imperfection.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from models.fields import clip_to_box
from models.frames import Split, TrueFrame, TrueTrail, noise_electrons, sky_field
from models.telescopes import FULL, QUARTER, TELESCOPES, joined, of_8_bits, telescope
from rsoconsole.records import FloatArray, Frame
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    FieldContent,
    ImageMotion,
    SensorModel,
    Streak,
    frame_rng,
    integrated_snr,
    render,
    straight_streak,
)

EXPOSURE_S = 10.0
LENGTH_PX, LONG_PX = (30.0, 600.0), (600.0, 3000.0)
SNR, FAINT_SNR = (20.0, 340.0), (10.0, 20.0)
_SEED = 20271123
_CALIBRATE = 77
_RIM_PX = 20.0
_STEPS = 400
_WIND_TAU_S = 0.3
_UNLIKE_STARS_FWHM = 2.0
_MAX_SKY = 0.3
"""Largest share of the sensor's range that the sky fills."""

Rng = np.random.Generator


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Content of one frame before it is drawn."""

    sensor: SensorModel
    content: FieldContent
    motion: ImageMotion | None = None
    """Motion of the whole image, stars and satellite alike."""
    brightness: FloatArray | None = None
    """Relative brightness of the satellite along its streak; None: steady."""
    others: tuple[Streak, ...] = ()
    """Streaks beside the satellite's: candidates on them count neither as found nor as false."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One kind of imperfection with the range of its severity."""

    title: str
    low: float
    high: float
    """Upper bound of the severity."""
    alter: Callable[[Scene, float, Rng], Scene]
    sensor: Callable[[float], SensorModel] = lambda _: QUARTER
    """Sensor for a severity, where the imperfection is the camera's."""
    is_counted: bool = False
    """True where the severity is a whole number, e.g. a count."""
    length_px: tuple[float, float] = LENGTH_PX
    snr: tuple[float, float] = SNR
    """Range of the integrated SNR; length and SNR are drawn log-uniformly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Truth of the satellite's streak: its ends a and b, SNR, and the frame's severity."""

    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float
    snr: float
    """Integrated SNR of the satellite's streak."""
    severity: float


def _moved(scene: Scene, dx: FloatArray, dy: FloatArray) -> Scene:
    motion = ImageMotion(dx_px=dx - dx.mean(), dy_px=dy - dy.mean(), turn_rad=np.zeros(len(dx)))
    sensor, content = scene.sensor, scene.content
    reach_px = 0.5 * math.hypot(sensor.width_px, sensor.height_px)
    stands = motion.positions_with_dwell(content.fwhm_px / FWHM_PER_SIGMA, reach_px)
    return replace(scene, content=replace(content, stands=stands), motion=motion)


def blurred(scene: Scene, sigma_px: float, _: Rng) -> Scene:
    fwhm_px = math.hypot(scene.content.fwhm_px, FWHM_PER_SIGMA * sigma_px)
    return replace(scene, content=replace(scene.content, fwhm_px=fwhm_px))


def ringed(scene: Scene, radius_px: float, _: Rng) -> Scene:
    return replace(scene, content=replace(scene.content, defocus_px=radius_px))


def drifted(scene: Scene, path_px: float, rng: Rng) -> Scene:
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    along = np.linspace(-0.5, 0.5, _STEPS) * path_px
    return _moved(scene, along * math.cos(angle), along * math.sin(angle))


def windy(scene: Scene, rms_px: float, rng: Rng) -> Scene:
    kept = math.exp(-EXPOSURE_S / _STEPS / _WIND_TAU_S)
    paths = []
    for _ in range(2):
        kicks, at, path = rng.normal(0.0, 1.0, _STEPS), float(rng.normal()), []
        for kick in kicks:
            at = kept * at + math.sqrt(1.0 - kept**2) * float(kick)
            path.append(rms_px * at)
        paths.append(np.array(path))
    return _moved(scene, *paths)


def striped(scene: Scene, sigma: float, rng: Rng) -> Scene:
    """Add random offsets to rows and columns.

    ``sigma``: one sigma of the rows' offsets in noises of a pixel; the columns' is half of it.
    """
    noise_e = noise_electrons(scene.sensor, scene.content)
    rows = rng.normal(0.0, sigma * noise_e, scene.sensor.height_px).astype(np.float32)
    columns = rng.normal(0.0, 0.5 * sigma * noise_e, scene.sensor.width_px).astype(np.float32)
    content = replace(scene.content, row_offsets_e=rows, column_offsets_e=columns)
    return replace(scene, content=content)


def tumbling(scene: Scene, periods: float, rng: Rng) -> Scene:
    depth, phase = float(rng.uniform(0.6, 1.0)), float(rng.uniform(0.0, 2.0 * math.pi))
    t = np.linspace(0.0, 1.0, 200)
    return replace(scene, brightness=1.0 + depth * np.cos(2.0 * math.pi * periods * t + phase))


def fading(scene: Scene, left: float, rng: Rng) -> Scene:
    light = np.linspace(1.0, left, 50)
    return replace(scene, brightness=light if rng.random() < 0.5 else light[::-1])


def glowing(scene: Scene, electrons_s: float, _: Rng) -> Scene:
    return replace(scene, sensor=replace(scene.sensor, glow_e_s=electrons_s))


def graded(scene: Scene, slope: float, rng: Rng) -> Scene:
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    gradient = (slope * math.cos(angle), slope * math.sin(angle))
    return replace(scene, content=replace(scene.content, sky_gradient=gradient))


def moonlit(scene: Scene, times: float, rng: Rng) -> Scene:
    sky = scene.content.sky_electrons_px * times
    content = replace(scene.content, sky_electrons_px=sky)
    return graded(replace(scene, content=content), float(rng.uniform(0.0, 0.4)), rng)


def crossed(scene: Scene, count: float, rng: Rng) -> Scene:
    """Add ``count`` trails from edge to edge, as bright as the satellite or brighter."""
    sensor, others = scene.sensor, []
    reach = math.hypot(sensor.width_px, sensor.height_px)
    for _ in range(round(count)):
        x, y = float(rng.uniform(0, sensor.width_px)), float(rng.uniform(0, sensor.height_px))
        angle = float(rng.uniform(0.0, math.pi))
        dx, dy = reach * math.cos(angle), reach * math.sin(angle)
        ridge = math.exp(float(rng.uniform(math.log(3.0), math.log(30.0))))
        per_px = ridge * noise_electrons(sensor, scene.content) * 2.7
        others.append(straight_streak((x - dx, y - dy), (x + dx, y + dy), per_px * 2.0 * reach))
    return replace(scene, others=tuple(others))


def clouded(scene: Scene, magnitudes: float, rng: Rng) -> Scene:
    patches = 10.0 ** (-0.4 * magnitudes * rng.uniform(0.2, 1.0, (9, 12)))
    content = replace(scene.content, cloud_transmission=patches.astype(np.float32))
    return replace(scene, content=content)


def rained_on(scene: Scene, rays: float, _: Rng) -> Scene:
    return replace(scene, content=replace(scene.content, cosmic_rays=rays))


def sharp(scene: Scene, fwhm_px: float, _: Rng) -> Scene:
    return replace(scene, content=replace(scene.content, fwhm_px=fwhm_px))


def plain(scene: Scene, _severity: float, _: Rng) -> Scene:
    return scene


def seen_through(scene: Scene, number: float, _: Rng) -> Scene:
    """Expose and blur the scene as telescope ``number`` does."""
    seen, content, sensor = telescope(number), scene.content, scene.sensor
    times = seen.exposure_s / EXPOSURE_S
    most_e = _MAX_SKY * sensor.largest_value_adu12 * sensor.e_per_adu12
    content = replace(
        content,
        fwhm_px=seen.fwhm_px,
        sky_electrons_px=min(content.sky_electrons_px * times, most_e),
        star_electrons=content.star_electrons * times,
    )
    return replace(scene, content=content)


FAMILIES: Mapping[str, Family] = {
    "plain": Family(title="as it is", low=0.0, high=0.0, alter=plain),
    "blur": Family(title="blur, px sigma", low=0.0, high=4.0, alter=blurred),
    "ring": Family(title="out of focus, ring of px", low=4.0, high=10.0, alter=ringed),
    "drift": Family(title="stars drift, px", low=5.0, high=30.0, alter=drifted),
    "wind": Family(title="wind, px rms", low=1.0, high=4.0, alter=windy),
    "stripes": Family(title="row and column noise, sigma", low=0.5, high=2.0, alter=striped),
    "modulation": Family(title="modulated, periods", low=2.0, high=8.0, alter=tumbling),
    "binned": Family(
        title="binned 2 or 4", low=1.0, high=2.0, alter=plain, sensor=lambda n: joined(2**n),
        is_counted=True,
    ),
    "8-bit": Family(
        title="8 bits, electrons a step", low=6.0, high=20.0, alter=plain, sensor=of_8_bits
    ),
    "bayer": Family(
        title="Bayer grid", low=0.0, high=0.0, alter=plain,
        sensor=lambda _: replace(QUARTER, is_bayer=True),
    ),
    "glow": Family(title="amplifier glow, e/s", low=10.0, high=200.0, alter=glowing),
    "gradient": Family(title="sky gradient across the frame", low=0.2, high=1.2, alter=graded),
    "moonlight": Family(title="sky brighter by", low=3.0, high=15.0, alter=moonlit),
    "hot": Family(
        title="hot pixels, of 1000", low=0.1, high=3.0, alter=plain,
        sensor=lambda share: replace(QUARTER, hot_fraction=share / 1000.0),
    ),
    "crossings": Family(
        title="trails right through", low=1.0, high=3.0, alter=crossed, is_counted=True
    ),
    "clouds": Family(title="cloud, mag at most", low=0.3, high=2.0, alter=clouded),
    "rays": Family(title="cosmic rays", low=20.0, high=200.0, alter=rained_on),
    "undersampled": Family(title="stars of px FWHM", low=0.8, high=1.5, alter=sharp),
    "fading": Family(title="fades to", low=0.05, high=0.5, alter=fading),
    "columns": Family(
        title="bad columns", low=2.0, high=30.0, alter=plain,
        sensor=lambda n: replace(
            QUARTER, bad_columns=round(n / 3), partial_columns=round(n / 3),
            dark_columns=round(n / 3), blooming=0.9,
        ),
    ),
    "long": Family(
        title="600 to 3,000 px", low=0.0, high=0.0, alter=plain, length_px=LONG_PX,
        sensor=lambda _: FULL,
    ),
    "faint": Family(
        title="any of these, SNR 10 to 20", low=0.0, high=0.0, alter=plain, snr=FAINT_SNR
    ),
    "telescope": Family(
        title="any telescope, SNR from 15, no.", low=0.0, high=TELESCOPES - 1.0,
        alter=seen_through, sensor=lambda n: telescope(n).sensor, is_counted=True,
        length_px=(40.0, 600.0), snr=(15.0, 340.0),
    ),
    "limit": Family(
        title="as it is, SNR 9 to 25, 30 to 300 px", low=0.0, high=0.0, alter=plain,
        length_px=(30.0, 300.0), snr=(9.0, 25.0), sensor=lambda _: FULL,
    ),
}  # fmt: skip
_RESHAPING, _MORE_OF_THEM = ("blur", "ring", "drift", "wind"), 4
_ALTERING = tuple(name for name in FAMILIES if name not in {"long", "faint", "telescope", "limit"})


def draw(name: str, number: int, split: Split = "test") -> tuple[Frame, Truth, tuple[Streak, ...]]:
    """One frame of a family, the truth of its satellite, and the other streaks in it.

    ``name``: the family's.
    """
    frame, truth, scene = _drawn(name, number, split)
    return frame, truth, scene.others


def draw_altered(split: Split, number: int) -> TrueFrame:
    """One altered frame; its trails are the satellite's and the other streaks'.

    The families take turns. Those that change the shape of stars come five times as often, since
    confidence has its own fit in such frames.
    """
    name = family_of(number)
    frame, truth, scene = _drawn(name, number, split)
    frame = replace(frame, frame_id=number, name=f"{split}-altered-{number}")
    trails = [_true_trail(scene, (truth.x_a_px, truth.y_a_px, truth.x_b_px, truth.y_b_px), truth)]
    for other in scene.others:
        ends = tuple(
            float(each) for each in (other.x_px[0], other.y_px[0], other.x_px[-1], other.y_px[-1])
        )
        trails.append(_true_trail(scene, ends, truth))
    return TrueFrame(
        frame=frame,
        kind="altered",
        trails=tuple(trails),
        content=scene.content,
        sensor=scene.sensor,
    )


def family_of(number: int) -> str:
    """Family of the altered frame with this number."""
    turns = (*(each for each in FAMILIES if each != "limit"), *(_RESHAPING * _MORE_OF_THEM))
    return turns[number % len(turns)]


def _true_trail(scene: Scene, ends: tuple[float, ...], truth: Truth) -> TrueTrail:
    """Part of a trail that the frame shows."""
    sensor = scene.sensor
    seen = clip_to_box(
        (ends[0] + 0.5, ends[1] + 0.5, ends[2] + 0.5, ends[3] + 0.5),
        sensor.width_px,
        sensor.height_px,
    )
    x_a, y_a, x_b, y_b = (at - 0.5 for at in seen) if seen is not None else ends
    length_px = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
    # Of a point-spread function that is not the seeing's alone this is the mean ridge's.
    mean_px = max(length_px * scene.content.fwhm_px, 1.0)
    return TrueTrail(
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        peak_snr=truth.snr / math.sqrt(mean_px),
        is_cut=math.hypot(x_b - x_a, y_b - y_a) < length_px - 0.5,
    )


def _family(name: str, number: int) -> Family:
    """Alteration of one frame of a family."""
    if name != "faint":
        return FAMILIES[name]
    return replace(FAMILIES[_ALTERING[number % len(_ALTERING)]], snr=FAMILIES[name].snr)


def _drawn(name: str, number: int, split: Split) -> tuple[Frame, Truth, Scene]:
    family = _family(name, number)
    key: tuple[int, ...] = (_SEED, list(FAMILIES).index(name), number)
    if split == "calibrate":
        key = (*key, _CALIBRATE)
    rng = frame_rng(*key)
    severity = float(rng.uniform(family.low, family.high))
    if family.is_counted:
        severity = float(rng.integers(round(family.low), round(family.high) + 1))
    sensor = family.sensor(severity)
    scene = Scene(sensor=sensor, content=sky_field(split, "satellites", sensor, rng))
    scene = family.alter(scene, severity, rng)
    sensor = scene.sensor
    length_px = math.exp(float(rng.uniform(*np.log(family.length_px))))
    seen = _place(sensor, length_px, rng)
    while family.alter is drifted and is_as_stars(scene, seen):
        seen = _place(sensor, length_px, rng)
    ends = before_motion(scene, seen)
    wanted = math.exp(float(rng.uniform(*np.log(family.snr))))
    streak, snr = lit_streak(scene, streak_path(scene, ends), length_px, wanted)
    content = replace(scene.content, streaks=(streak, *scene.others))
    frame = Frame(
        frame_id=number,
        name=f"{name}-{number}",
        pixels=render(sensor, content, frame_rng(*key, 1)),
        exposure_s=EXPOSURE_S,
        scale_arcsec_px=sensor.scale_arcsec_px,
        saturation_adu=sensor.saturation_adu,
    )
    a, b = true_ends(scene, ends)
    truth = Truth(x_a_px=a[0], y_a_px=a[1], x_b_px=b[0], y_b_px=b[1], snr=snr, severity=severity)
    return frame, truth, scene


def _place(sensor: SensorModel, length_px: float, rng: Rng) -> FloatArray:
    """Ends of a streak, (2, 2), inside the frame."""
    while True:
        angle = float(rng.uniform(0.0, 2.0 * math.pi))
        half = 0.5 * length_px * np.array([math.cos(angle), math.sin(angle)])
        room = np.array([sensor.width_px, sensor.height_px]) / 2.0 - np.abs(half) - _RIM_PX
        if np.all(room > 0.0):
            middle = np.array([sensor.width_px, sensor.height_px]) / 2.0 + rng.uniform(-room, room)
            return np.stack([middle - half, middle + half])


def is_as_stars(scene: Scene, ends: FloatArray) -> bool:
    """True where a streak differs from the stars' trails by less than two widths of a star."""
    if scene.motion is None:
        return False
    dx, dy = scene.motion.dx_px, scene.motion.dy_px
    trail, along = np.array([dx[-1] - dx[0], dy[-1] - dy[0]]), ends[1] - ends[0]
    apart = min(float(np.hypot(*(along - sense * trail))) for sense in (-1.0, 1.0))
    return apart < _UNLIKE_STARS_FWHM * scene.content.fwhm_px


def before_motion(scene: Scene, ends: FloatArray) -> FloatArray:
    """Ends less the image's motion, so that with it the streak is as long as was asked."""
    return ends - _shifts(scene)


def streak_path(scene: Scene, ends: FloatArray) -> Streak:
    """Streak with one electron."""
    x, y = (np.linspace(ends[0, axis], ends[1, axis], _STEPS) for axis in (0, 1))
    if scene.motion is not None:
        x, y = x + scene.motion.dx_px, y + scene.motion.dy_px
    return Streak(x_px=x, y_px=y, electrons=1.0, brightness=scene.brightness)


def lit_streak(scene: Scene, path: Streak, length_px: float, wanted: float) -> tuple[Streak, float]:
    """Streak with the light for the wanted integrated SNR, and the SNR that a few steps reach."""
    sensor, content = scene.sensor, scene.content
    noise_e = noise_electrons(sensor, content)
    light = wanted * noise_e * math.sqrt(length_px * content.fwhm_px) * 1.5
    snr = 0.0
    for _ in range(5):
        snr = integrated_snr(sensor, content, replace(path, electrons=light))
        if abs(snr / wanted - 1.0) < 0.01:
            break
        light *= wanted / max(snr, 1e-3)
    return replace(path, electrons=light), snr


def true_ends(scene: Scene, ends: FloatArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of the straight line that the satellite's path in the image is on average.

    Of a drift that is the path itself; wind shakes it to either side.
    """
    (x_a, y_a), (x_b, y_b) = (ends + _shifts(scene)).tolist()
    return (x_a, y_a), (x_b, y_b)


def _shifts(scene: Scene) -> FloatArray:
    """Mean shifts of both ends, (2, 2), by the image's motion."""
    shifts = np.zeros((2, 2))
    if scene.motion is not None:
        t = np.linspace(-1.0, 1.0, _STEPS)
        for axis, path in enumerate((scene.motion.dx_px, scene.motion.dy_px)):
            slope, middle = np.polyfit(t, path, 1)
            shifts[:, axis] = middle - slope, middle + slope
    return shifts
