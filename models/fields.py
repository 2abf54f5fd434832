"""Random fields with their truth: what the detector's network learns from and is judged on.

Every field is drawn by ``rsoconsole.simulator.render``; here is only the choice of what to draw.
Truth is in cells of the map (0 = left edge of the first cell), as ``vision.maps`` defines them.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.records import MapMode
from rsoconsole.simulator.render import FieldContent, Streak, render, straight_streak
from rsoconsole.simulator.sensor import SensorModel
from rsoconsole.vision.maps import ByteArray, binning_of, make_map

FIELD_CELLS = 192
Kind = Literal["ordinary", "empty", "trailed stars", "aircraft"]
KINDS: tuple[Kind, ...] = ("ordinary", "empty", "trailed stars", "aircraft")
FloatArray = npt.NDArray[np.float64]

SHORTEST_CELLS = 6.0
"""A shorter visible part is neither asked for nor held against the network."""
_FWHM_PER_SIGMA = 2.3548


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueStreak:
    """One satellite's trail as far as it lies in the field."""

    x_a: float
    y_a: float
    x_b: float
    y_b: float
    peak_snr: float
    """Brightest pixel over the noise of one pixel, at full brightness under a clear sky."""
    is_asked: bool
    """False: too faint or too little of it in the field; finding it is no fault either."""

    @property
    def length(self) -> float:
        """Cells from end to end."""
        return float(np.hypot(self.x_b - self.x_a, self.y_b - self.y_a))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Field:
    """One training or test field."""

    values: ByteArray
    kind: Kind
    mode: MapMode
    block: int
    streaks: tuple[TrueStreak, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What the fields of one batch have in common, or None for a draw per field."""

    kind: Kind | None = None
    mode: MapMode | None = None
    peak_snr: tuple[float, float] | None = None
    streak_cells: tuple[float, float] = (8.0, 60.0)
    streaks: tuple[int, int] | None = None
    is_hard: bool = True
    """False: the frames of an ordinary night; no clouds, few cosmic rays, no dense field."""


def draw_sensor(block: int, rng: np.random.Generator, *, is_hard: bool = True) -> SensorModel:
    """A copy of a sensor whose frame is 192 cells of ``block`` pixels a side."""
    side = FIELD_CELLS * block
    if not is_hard:
        return SensorModel(width_px=side, height_px=side, seed=int(rng.integers(1 << 30)))
    gain = float(rng.choice([20000.0 / 4096.0, 20000.0 / 4096.0, 1.2]))
    # A smaller field is a cut of the frame: as many hot pixels a cell as at a block of 8.
    return SensorModel(
        width_px=side,
        height_px=side,
        e_per_adu12=gain,
        full_well_e=4096.0 * gain,
        read_noise_e=float(rng.uniform(1.0, 5.0)),
        vignetting_corner=float(rng.uniform(0.0, 0.3)),
        prnu=float(rng.uniform(0.001, 0.01)),
        hot_fraction=float(np.exp(rng.uniform(np.log(1e-5), np.log(4e-4)))) * (8 / block) ** 0.7,
        seed=int(rng.integers(1 << 30)),
    )


def draw_field(
    sensor: SensorModel, block: int, conditions: Conditions, rng: np.random.Generator
) -> Field:
    """One random field on this sensor and its map."""
    kind = conditions.kind or KINDS[int(rng.choice(4, p=[0.76, 0.10, 0.07, 0.07]))]
    mode: MapMode = conditions.mode or ("paper" if rng.random() < 0.2 else "fast")
    sky_e = float(np.exp(rng.uniform(np.log(25), np.log(700)))) if conditions.is_hard else 132.0
    fwhm = float(rng.uniform(1.6, 4.2 if block > 2 else 3.2)) if conditions.is_hard else 2.2
    noise_e = float(np.sqrt(sky_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0))
    scene = _Scene(sensor, block, fwhm, noise_e, rng)
    stars = scene.stars(kind, is_hard=conditions.is_hard)
    trails: list[Streak] = []
    truth: list[TrueStreak] = []
    if kind in ("ordinary", "aircraft"):
        trails, truth = scene.satellites(kind, mode, conditions)
    if kind == "aircraft":
        trails += scene.aircraft()
    if kind == "trailed stars":
        trails, stars = scene.trailed(stars), (np.zeros(0),) * 3
    rays = float(np.exp(rng.uniform(np.log(3), np.log(400)))) if conditions.is_hard else 12.0
    # Tracks keep their length in pixels: the same number would fill a small field.
    rays *= (block / 8) ** 1.3
    content = FieldContent(
        fwhm_px=fwhm,
        sky_electrons_px=sky_e,
        sky_gradient=(float(rng.normal(0, 0.15)), float(rng.normal(0, 0.15))),
        star_x_px=stars[0],
        star_y_px=stars[1],
        star_electrons=stars[2],
        streaks=tuple(trails),
        cloud_transmission=scene.clouds() if conditions.is_hard and rng.random() < 0.25 else None,
        cosmic_rays=rays,
    )
    values = make_map(render(sensor, content, rng), mode, block).values
    return Field(values=values, kind=kind, mode=mode, block=block, streaks=tuple(truth))


def clip_to_box(
    segment: tuple[float, float, float, float], width: float, height: float
) -> tuple[float, float, float, float] | None:
    """The part of (x_a, y_a, x_b, y_b) inside [0, width] x [0, height], or None.

    Source: Liang and Barsky 1984.
    """
    x_a, y_a, x_b, y_b = segment
    enters, leaves = 0.0, 1.0
    for start, step, limit in ((x_a, x_b - x_a, width), (y_a, y_b - y_a, height)):
        if abs(step) < 1e-9:
            if not 0.0 <= start <= limit:
                return None
            continue
        first, second = sorted(((0.0 - start) / step, (limit - start) / step))
        enters, leaves = max(enters, first), min(leaves, second)
    if leaves <= enters:
        return None
    dx, dy = x_b - x_a, y_b - y_a
    return x_a + enters * dx, y_a + enters * dy, x_a + leaves * dx, y_a + leaves * dy


def is_asked_for(peak_snr: float, visible_cells: float, mode: MapMode, block: int) -> bool:
    """Whether a detector that sees only the map can fairly be asked for this streak."""
    if visible_cells < SHORTEST_CELLS:
        return False
    if mode == "paper":
        return peak_snr >= 3.0
    # Binning 2 x 2 raises a line's signal to noise by 1.75 at such seeing.
    bin_snr = peak_snr * (1.75 if binning_of(block) == 2 else 1.0)
    return bin_snr >= 2.2 and bin_snr * float(np.sqrt(visible_cells)) >= 10.0


class _Scene:
    """Draws the parts of one field."""

    def __init__(
        self,
        sensor: SensorModel,
        block: int,
        fwhm_px: float,
        noise_e: float,
        rng: np.random.Generator,
    ) -> None:
        self.sensor, self.block, self.rng = sensor, block, rng
        self.fwhm_px, self.noise_e = fwhm_px, noise_e
        self.side_px = float(FIELD_CELLS * block)

    def stars(self, kind: Kind, *, is_hard: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y and electrons of stars: a power law in flux, a log-uniform density."""
        rng = self.rng
        low, high = (0.008, 0.5) if is_hard else (0.05, 0.25)
        per_cell = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        count = int(rng.poisson(per_cell * FIELD_CELLS**2))
        if kind == "trailed stars":
            count = min(count + 60, int(rng.integers(60, 300)))
        faintest = 0.8 * self.noise_e * 2 * np.pi * (self.fwhm_px / _FWHM_PER_SIGMA) ** 2
        slope = rng.uniform(0.7, 1.1)
        electrons = faintest * (1.0 - rng.random(count)) ** (-1.0 / slope)
        place = rng.uniform(-8.0, self.side_px + 8.0, size=(2, count))
        return place[0], place[1], np.minimum(electrons, 3e6)

    def line_e_per_px(self, peak_snr: float) -> float:
        """Electrons per pixel of length that make the brightest pixel ``peak_snr`` high."""
        sigma = np.sqrt((self.fwhm_px / _FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0)
        return float(peak_snr * self.noise_e * np.sqrt(2 * np.pi) * sigma)

    def angle(self) -> float:
        """Radians; an axis of the array one time in six."""
        if self.rng.random() < 1 / 6:
            return float(self.rng.choice([0.0, np.pi / 2]) + self.rng.normal(0, 0.01))
        return float(self.rng.uniform(0, np.pi))

    def satellites(
        self, kind: Kind, mode: MapMode, conditions: Conditions
    ) -> tuple[list[Streak], list[TrueStreak]]:
        """Single streaks and, one time in four, a cluster of parallel ones."""
        rng = self.rng
        low, high = conditions.streaks or ((0, 3) if kind == "aircraft" else (1, 5))
        count = int(rng.integers(low, high + 1))
        is_cluster = count > 1 and rng.random() < 0.3
        first = self._segment(conditions)
        segments = [first]
        for _ in range(count - 1):
            segments.append(self._beside(segments[-1]) if is_cluster else self._segment(conditions))
        trails: list[Streak] = []
        truth: list[TrueStreak] = []
        for segment in segments[:count]:
            low_snr, high_snr = conditions.peak_snr or ((1.0, 6.0), (1.0, 30.0))[rng.random() < 0.4]
            snr = float(np.exp(rng.uniform(np.log(low_snr), np.log(high_snr))))
            streak, seen = self._trail(segment, snr, mode, conditions)
            trails.append(streak)
            truth += seen
        return trails, truth

    def _segment(self, conditions: Conditions) -> tuple[float, float, float, float]:
        """Middle (cells), length (cells) and direction (rad)."""
        rng = self.rng
        low, high = conditions.streak_cells
        if self.block == 2:
            # Cosmic rays are up to this long there, and as bright.
            low = max(low, 12.0)
        length = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        rim = 8.0 if conditions.is_hard else -length / 2
        x, y = rng.uniform(-rim, FIELD_CELLS + rim, size=2)
        return float(x), float(y), length, self.angle()

    def _beside(self, of: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        x, y, length, angle = of
        away, bearing = self.rng.uniform(11, 45), self.rng.uniform(0, 2 * np.pi)
        across = np.array([-np.sin(angle), np.cos(angle)])
        step = away * np.array([np.cos(bearing), np.sin(bearing)])
        if abs(step @ across) < 9.0:
            # Streaks end to end on one line would be one streak to anybody.
            step += across * np.sign(step @ across + 1e-9) * 10.0
        turn = self.rng.normal(0, 0.02)
        return float(x + step[0]), float(y + step[1]), length, angle + float(turn)

    def _trail(
        self,
        segment: tuple[float, float, float, float],
        peak_snr: float,
        mode: MapMode,
        conditions: Conditions,
    ) -> tuple[Streak, list[TrueStreak]]:
        x, y, length, angle = segment
        dx, dy = length / 2 * np.cos(angle), length / 2 * np.sin(angle)
        ends = [v * self.block - 0.5 for v in (x - dx, y - dy, x + dx, y + dy)]
        brightness = (
            self._light_curve() if conditions.is_hard and self.rng.random() < 0.25 else None
        )
        electrons = self.line_e_per_px(peak_snr) * length * self.block
        streak = straight_streak((ends[0], ends[1]), (ends[2], ends[3]), electrons, brightness)
        seen = clip_to_box((x - dx, y - dy, x + dx, y + dy), FIELD_CELLS, FIELD_CELLS)
        if seen is None:
            return streak, []
        visible = float(np.hypot(seen[2] - seen[0], seen[3] - seen[1]))
        dimmest = 1.0 if brightness is None else float(np.mean(brightness)) * 0.8
        asked = is_asked_for(peak_snr * dimmest, visible, mode, self.block)
        true = TrueStreak(
            x_a=seen[0],
            y_a=seen[1],
            x_b=seen[2],
            y_b=seen[3],
            peak_snr=peak_snr,
            is_asked=asked,
        )
        return streak, [true]

    def _light_curve(self) -> FloatArray:
        rng = self.rng
        time = np.linspace(0, 1, 48)
        if rng.random() < 0.5:
            wave = np.sin(2 * np.pi * (rng.uniform(0.5, 3.0) * time + rng.random()))
            return 1.0 - rng.uniform(0.1, 0.45) * (1.0 + wave)
        return np.linspace(*rng.permutation([1.0, rng.uniform(0.25, 0.8)]), 48)

    def aircraft(self) -> list[Streak]:
        """One to three trails side by side across the whole field, wide, some blinking."""
        rng, trails = self.rng, []
        angle = self.angle()
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        centre = rng.uniform(0.1, 0.9, size=2) * self.side_px
        width_px = rng.uniform(1.5, 5.0) * self.block / 2
        snr = float(np.exp(rng.uniform(np.log(2), np.log(40))))
        for lamp in range(int(rng.integers(1, 4))):
            blinking: FloatArray | None = None
            if rng.random() < 0.6:
                blinking = np.full(401, rng.uniform(0.0, 0.5))
                blinking[:: int(rng.integers(4, 40))] = rng.uniform(3, 12)
            for offset in np.arange(-width_px, width_px + 0.1, max(self.fwhm_px, 1.0)):
                middle = centre + across * (lamp * rng.uniform(3, 8) * self.block + offset)
                a, b = middle - along * 1.5 * self.side_px, middle + along * 1.5 * self.side_px
                light = self.line_e_per_px(snr) * 3.0 * self.side_px
                trails.append(straight_streak(tuple(a), tuple(b), light, blinking))
        return trails

    def trailed(self, stars: tuple[FloatArray, FloatArray, FloatArray]) -> list[Streak]:
        """Every star drawn out alike, as when the mount does not follow the sky."""
        rng = self.rng
        length = float(np.exp(rng.uniform(np.log(5), np.log(40)))) * self.block
        angle = self.angle()
        dx, dy = length * np.cos(angle), length * np.sin(angle)
        boost = length / self.fwhm_px * rng.uniform(0.5, 1.5)
        return [
            straight_streak((x, y), (x + dx, y + dy), e * boost)
            for x, y, e in zip(*stars, strict=True)
        ]

    def clouds(self) -> npt.NDArray[np.float32]:
        """A soft random transmission map, 0.25 to 1."""
        coarse = self.rng.uniform(0.25, 1.1, size=(7, 7)).astype(np.float32)
        return np.minimum(coarse, np.float32(1.0))
