"""The satellites of a field: one or several streaks, parallel or crossing, some cut by an edge."""

from dataclasses import dataclass

import numpy as np

from models.alterations import gaps
from models.extras import Canvas
from models.fields import (
    DIAGONAL_CELLS,
    FAINTEST_SNR,
    FIELD_CELLS,
    LONGEST_CELLS,
    SHORT_CELLS,
    SHORTEST_CELLS,
    SHORTEST_PAPER_CELLS,
    Conditions,
    FloatArray,
    TrueStreak,
    clip_to_box,
    cut_ends,
    is_asked_for,
)
from models.light import log_uniform, satellite_curve
from rsoconsole.records import MapMode
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    FieldContent,
    SensorModel,
    Streak,
    amplifier_glow,
    straight_streak,
    transmission_at,
)

Segment = tuple[float, float, float, float]
"""Middle (x, y in cells), length (cells) and direction (rad)."""
_APART_DEG = 25.0
"""Least difference in direction from trailed stars of a satellite that is asked for."""
_MIN_AMONG_TRAILS_CELLS = 8.0
_BENT_CELLS = 1.2
"""Largest departure from its line of a trail that is asked for."""
_SHORT_FWHMS = 3.0
_FAINT_SNR = (FAINTEST_SNR, 80.0)
"""Range of the integrated SNR of streaks whose length does not make them brighter."""
_FAINT_SHARE, _LONG_SHARE = 0.3, 0.12
"""Shares of faint and of long ones among hard fields' streaks."""
_LONGER_THAN_MOTION = 3.0
"""Length over the way of the whole image from which a satellite differs from the stars."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Satellites:
    """Draws the satellites of one field, whose remaining content is drawn already."""

    sensor: SensorModel
    canvas: Canvas
    content: FieldContent
    mode: MapMode
    block: int
    conditions: Conditions
    rng: np.random.Generator
    motion_px: FloatArray | None = None
    """Motion (2, m) of the whole image, too small to trail the stars; None: none."""
    are_stars_covered: bool = False
    """True where trailed stars have been covered with sky, and satellites beneath them too."""

    def draw(self, star_path_px: FloatArray | None) -> tuple[list[Streak], list[TrueStreak]]:
        """Streaks and their truth.

        ``star_path_px``: (2, m) motion of the stars by the mount, which moves the satellites too;
        None: none.
        """
        trails: list[Streak] = []
        truth: list[TrueStreak] = []
        for segment in self._segments():
            spread_px = self._spread_px(segment[3])
            snr = self._peak_snr(segment[2], spread_px)
            streak, seen = self._trail(segment, snr, star_path_px, spread_px)
            trails.append(streak)
            truth += seen
        return trails, truth

    def _segments(self) -> list[Segment]:
        rng = self.rng
        if self.conditions.streaks is None:
            count = int(rng.choice([1, 2, 3, 4, 5], p=[0.35, 0.25, 0.17, 0.13, 0.1]))
        else:
            low, high = self.conditions.streaks
            count = int(rng.integers(low, high + 1))
        arrangement = rng.random()
        segments = [self._segment() for _ in range(min(count, 1))]
        for _ in range(count - 1):
            if arrangement < 0.3:
                segments.append(self._beside(segments[-1]))
            elif arrangement < 0.45:
                segments.append(self._across(segments[-1]))
            else:
                segments.append(self._segment())
        return segments

    def _length(self) -> float:
        """Length, cells: much weight on the shortest and on those of a geostationary satellite."""
        rng, wanted = self.rng, self.conditions.streak_cells
        if wanted is not None:
            return log_uniform(rng, *wanted)
        shortest = SHORTEST_CELLS[self.block]
        if self.mode == "paper":
            shortest = max(shortest, SHORTEST_PAPER_CELLS)
        draw = rng.random()
        if draw < 0.3:
            return log_uniform(rng, shortest, max(8.0, 1.5 * shortest))
        if draw < 0.6:
            return log_uniform(rng, 10.0, 20.0)
        if self.conditions.is_hard and draw > 1.0 - _LONG_SHARE:
            return log_uniform(rng, LONGEST_CELLS, DIAGONAL_CELLS)
        return log_uniform(rng, shortest, LONGEST_CELLS)

    def _peak_snr(self, length: float, spread_px: float) -> float:
        rng, wanted = self.rng, self.conditions.peak_snr
        if wanted is not None:
            return log_uniform(rng, *wanted)
        if self.conditions.is_hard and self.mode == "fast" and rng.random() < _FAINT_SHARE:
            light = self.canvas.line_of_snr(
                log_uniform(rng, *_FAINT_SNR), length * self.block, spread_px
            )
            # As high as a line in a still image would be.
            return light / self.canvas.line_e_per_px(1.0)
        if length < 1.4 * SHORT_CELLS and rng.random() < 0.7:
            return log_uniform(rng, 3.5, 30.0)
        return log_uniform(rng, 0.8, 6.0 if rng.random() < 0.55 else 30.0)

    def _angle(self) -> float:
        """Direction, radians; an axis of the array one time in six."""
        if self.rng.random() < 1 / 6:
            return float(self.rng.choice([0.0, np.pi / 2]) + self.rng.normal(0, 0.01))
        return float(self.rng.uniform(0, np.pi))

    def _segment(self) -> Segment:
        length = self._length()
        if length > LONGEST_CELLS and self.conditions.streak_cells is None:
            return self._long_segment(length)
        # One in eight of the hard ones has its middle near or beyond the edge.
        rim = 6.0 if self.conditions.is_hard else -min(length / 2, 80.0)
        x, y = self.rng.uniform(-rim, FIELD_CELLS + rim, size=2)
        return float(x), float(y), length, self._angle()

    def _long_segment(self, length: float) -> Segment:
        """Segment with both ends in the field; the longest run from corner to corner."""
        angle = self._angle()
        if length > FIELD_CELLS:
            flattest = min(np.arccos(FIELD_CELLS / length), np.pi / 4)
            angle = float(self.rng.uniform(flattest, np.pi / 2 - flattest))
            angle = angle if self.rng.random() < 0.5 else np.pi - angle
        reach = 0.5 * length * np.abs([np.cos(angle), np.sin(angle)])
        room = np.maximum(FIELD_CELLS / 2 - reach, 0.0)
        x, y = FIELD_CELLS / 2 + self.rng.uniform(-room, room)
        return float(x), float(y), length, angle

    def _beside(self, of: Segment) -> Segment:
        """Segment of a neighbour in one slot: parallel, alike, not end to end."""
        x, y, length, angle = of
        away, bearing = self.rng.uniform(9, 45), self.rng.uniform(0, 2 * np.pi)
        across = np.array([-np.sin(angle), np.cos(angle)])
        step = away * np.array([np.cos(bearing), np.sin(bearing)])
        if abs(step @ across) < 7.0:
            # Streaks end to end on one line would be one streak to anybody.
            step += across * np.sign(step @ across + 1e-9) * 9.0
        turn = self.rng.normal(0, 0.02)
        return float(x + step[0]), float(y + step[1]), length, angle + float(turn)

    def _across(self, of: Segment) -> Segment:
        """Segment that crosses or touches it, its middle well off the first one's line."""
        x, y, length, angle = of
        turn = self.rng.uniform(0.4, np.pi - 0.4)
        other = max(self._length(), 12.0)
        at = self.rng.uniform(-0.5, 0.5) * length
        off = self.rng.choice([-1.0, 1.0]) * self.rng.uniform(0.2, 0.55) * other
        x += at * np.cos(angle) + off * np.cos(angle + turn)
        y += at * np.sin(angle) + off * np.sin(angle + turn)
        return float(x), float(y), other, angle + float(turn)

    def _trail(
        self,
        segment: Segment,
        peak_snr: float,
        star_path_px: FloatArray | None,
        spread_px: float,
    ) -> tuple[Streak, list[TrueStreak]]:
        x, y, length, angle = segment
        rng, block = self.rng, self.block
        dx, dy = length / 2 * np.cos(angle), length / 2 * np.sin(angle)
        curve = satellite_curve(rng) if self.conditions.is_hard and rng.random() < 0.3 else None
        # The curve sets the shape; the mean along the trail is what was asked for.
        if curve is not None:
            curve = curve / curve.mean()
        if self.are_stars_covered:
            open_sky = gaps(length, rng)
            curve = open_sky if curve is None else open_sky * _stretched(curve, len(open_sky))
        light = self.canvas.line_e_per_px(peak_snr) * length * block
        ends = [v * block - 0.5 for v in (x - dx, y - dy, x + dx, y + dy)]
        streak = straight_streak((ends[0], ends[1]), (ends[2], ends[3]), light, curve)
        path_px = self.motion_px if star_path_px is None else star_path_px
        if path_px is not None:
            streak = _shaken(streak, path_px)
        line = tuple(
            float((v + 0.5) / block)
            for v in (streak.x_px[0], streak.y_px[0], streak.x_px[-1], streak.y_px[-1])
        )
        seen = clip_to_box(line, FIELD_CELLS, FIELD_CELLS)
        if seen is None:
            return streak, []
        visible = float(np.hypot(seen[2] - seen[0], seen[3] - seen[1]))
        # Carried along by a wandering mount the light is spread over another length.
        drawn = max(float(np.hypot(line[2] - line[0], line[3] - line[1])), 1.0)
        snr = peak_snr * self._dimming(seen) * length / drawn
        integrated = self.canvas.line_snr(
            self.canvas.line_e_per_px(snr), visible * block, spread_px
        )
        snr *= self._narrowness(spread_px)
        dimmest = 1.0 if curve is None else min(1.0, float(np.median(curve)))
        is_asked = is_asked_for(snr * dimmest, integrated * dimmest, visible, self.mode, block)
        is_asked &= visible * block >= _SHORT_FWHMS * self.canvas.fwhm_px
        is_asked &= cut_ends(seen, FIELD_CELLS, FIELD_CELLS) < 2
        if star_path_px is not None:
            is_asked &= self._stands_out(streak, star_path_px)
        elif self.motion_px is not None:
            reach = float(np.hypot(*np.ptp(self.motion_px, axis=1)))
            is_asked &= visible * block >= _LONGER_THAN_MOTION * reach
        true = TrueStreak(
            x_a=seen[0],
            y_a=seen[1],
            x_b=seen[2],
            y_b=seen[3],
            peak_snr=snr,
            integrated_snr=integrated,
            is_asked=is_asked,
        )
        return streak, [true]

    def _spread_px(self, angle: float) -> float:
        """One sigma by which the image's motion widens a streak of this direction."""
        if self.motion_px is None:
            return 0.0
        across = self.motion_px[1] * np.cos(angle) - self.motion_px[0] * np.sin(angle)
        time = np.linspace(-0.5, 0.5, len(across))
        # An even drift turns it and makes it no wider.
        drift = (across @ time) / (time @ time)
        return float(np.std(across - drift * time))

    def _narrowness(self, spread_px: float) -> float:
        """Height of a widened streak over that of one in a still image."""
        variance = (self.canvas.fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0
        return float(np.sqrt(variance / (variance + spread_px**2)))

    def _dimming(self, seen: tuple[float, float, float, float]) -> float:
        """Mean transmission of the clouds along the visible part, over the noise by the glow."""
        share = np.linspace(0.0, 1.0, 9)
        x_px = (seen[0] + share * (seen[2] - seen[0])) * self.block - 0.5
        y_px = (seen[1] + share * (seen[3] - seen[1])) * self.block - 0.5
        through = transmission_at(self.sensor, self.content.cloud_transmission, x_px, y_px)
        return float(through.mean()) / self._noise_by_glow(x_px, y_px)

    def _noise_by_glow(self, x_px: FloatArray, y_px: FloatArray) -> float:
        """Noise of these places over that of a sensor without amplifier glow."""
        if self.sensor.glow_e_s <= 0.0:
            return 1.0
        glow = amplifier_glow(self.sensor)
        rows = np.clip(np.rint(y_px).astype(int), 0, glow.shape[0] - 1)
        columns = np.clip(np.rint(x_px).astype(int), 0, glow.shape[1] - 1)
        glow_e = float(glow[rows, columns].mean()) * self.content.exposure_s
        return float(np.sqrt(1.0 + glow_e / self.canvas.noise_e**2))

    def _stands_out(self, streak: Streak, star_path_px: FloatArray) -> bool:
        """True where it is straight, and differs from the stars in direction or is far longer."""
        x, y = streak.x_px / self.block, streak.y_px / self.block
        dx, dy = x[-1] - x[0], y[-1] - y[0]
        length = float(np.hypot(dx, dy))
        spread = star_path_px - star_path_px.mean(axis=1, keepdims=True)
        reach = float(np.hypot(*np.ptp(spread, axis=1))) / self.block
        if length < max(_MIN_AMONG_TRAILS_CELLS, SHORTEST_CELLS[self.block], 0.7 * reach):
            return False
        cos, sin = dx / length, dy / length
        bent = np.abs((y - y[0]) * cos - (x - x[0]) * sin).max()
        if bent > _BENT_CELLS:
            return False
        if reach < 0.15 * length:
            return True
        along, *_ = np.linalg.svd(spread, full_matrices=False)
        return bool(abs(along[0, 0] * cos + along[1, 0] * sin) < np.cos(np.radians(_APART_DEG)))


def _shaken(streak: Streak, path_px: FloatArray) -> Streak:
    time = np.linspace(0.0, 1.0, path_px.shape[1])
    return Streak(
        x_px=np.interp(time, [0.0, 1.0], streak.x_px) + path_px[0],
        y_px=np.interp(time, [0.0, 1.0], streak.y_px) + path_px[1],
        electrons=streak.electrons,
        brightness=streak.brightness,
    )


def _stretched(curve: FloatArray, steps: int) -> FloatArray:
    return np.interp(np.linspace(0.0, 1.0, steps), np.linspace(0.0, 1.0, len(curve)), curve)
