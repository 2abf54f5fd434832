"""Points that several frames agree on: at one place, or on one slow motion.

A pair of points of two frames makes a line in time; points of the other frames on it belong to it.
A line counts by the number of equally good ones that chance would make of the frames' points.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from rsoconsole.pipeline.points.frame_points import FramePoints
from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_S

PointState = Literal["two frames", "confirmed", "same pixels", "trail ends", "chance"]
"""Confirmed, or what it lacks: a third frame; a second pointing, where shape does not tell bad
pixels from points; frames in which no two trails' ends meet there; or significance."""

FRAMES, NEEDED = 5, 3
"""Number of frames that are compared, and of those that must agree."""
MAX_BY_CHANCE = 1e-3
"""Largest number of such lines expected by chance of a confirmed one."""
POINTING_PX = 5.0
"""Least change of the pointing after which a bad pixel is elsewhere on the sky."""
PLACE_SIGMA_PX = 0.15
"""One sigma of a place beyond its noise: jitter of the mount, plates."""
_GATE = 3.5
_STILL_PX = 1.0
_MAX_FWHM_MOVED = 1.5
"""Largest motion during an exposure that leaves a point, by its width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointTrack:
    """Points of several frames taken for one object."""

    state: PointState
    numbers: tuple[int | None, ...]
    """Number of its point in each frame compared; None where it has none."""
    t_s: float
    """Mean time of its points, s from the first frame's mid-exposure."""
    x_px: float
    """Place at that time, in pixels of the first frame."""
    y_px: float
    rate_px_s: tuple[float, float]
    """Motion along x and y; (0, 0) where one place agrees with all points."""
    sigma_px: float
    """One sigma of the place along each axis."""
    snr: float
    """SNR of all points together."""
    flux_adu: float
    """Mean by the points' errors."""
    flux_sigma_adu: float
    by_chance: float
    """Number of such lines expected by chance."""


def confirm_points(frames: Sequence[FramePoints], exposure_s: float) -> tuple[PointTrack, ...]:
    """Return what the last five frames agree on, the surest first, each point used once.

    Points that no other frame has are left out.
    """
    compared = list(frames[-FRAMES:])
    if len(compared) < 2:
        return ()
    pool = _Pool(compared, exposure_s)
    found = sorted(pool.lines(), key=lambda line: (-len(line.members), line.by_chance))
    used: set[tuple[int, int]] = set()
    tracks: list[PointTrack] = []
    for line in found:
        if used.isdisjoint(line.members):
            used.update(line.members)
            tracks.append(pool.track(line))
    return tuple(tracks)


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """Points, as (frame, number), on one motion."""

    members: tuple[tuple[int, int], ...]
    start_px: FloatArray
    """(2,) place at the mean time."""
    rate_px_s: FloatArray
    t_s: float
    by_chance: float


class _Pool:
    """Points of the frames compared."""

    def __init__(self, frames: list[FramePoints], exposure_s: float) -> None:
        from scipy.spatial import cKDTree

        self._frames = frames
        first_ns = frames[0].t_mid_utc_ns
        self._t_s = [(each.t_mid_utc_ns - first_ns) / NS_PER_S for each in frames]
        self._places = [np.column_stack([each.x_px, each.y_px]) for each in frames]
        self._trees = [cKDTree(each) for each in self._places]
        self._sigma = [np.hypot(each.points.sigma_px, PLACE_SIGMA_PX) for each in frames]
        self._snr = [np.sort(each.points.snr) for each in frames]
        fwhm = float(np.median([each.points.fwhm_px for each in frames]))
        self._max_rate = _MAX_FWHM_MOVED * fwhm / exposure_s
        self._area = float(frames[0].size_px[0] * frames[0].size_px[1])

    def lines(self) -> list[_Line]:
        """All lines through two points or more that no better one has whole."""
        found: dict[tuple[tuple[int, int], ...], _Line] = {}
        for a, b in combinations(range(len(self._frames)), 2):
            if not len(self._places[a]) or not len(self._places[b]):
                continue
            apart_s = abs(self._t_s[b] - self._t_s[a])
            reach = self._max_rate * apart_s + 2.0 * _GATE * PLACE_SIGMA_PX
            for n, near in enumerate(self._trees[b].query_ball_point(self._places[a], reach)):
                for m in near:
                    line = self._through((a, n), (b, int(m)))
                    if line is not None:
                        found.setdefault(line.members, line)
        return list(found.values())

    def _through(self, one: tuple[int, int], other: tuple[int, int]) -> _Line | None:
        """The line through two points, with the nearest points of other frames on it."""
        members = [one, other]
        fit = self._fit(members)
        for k, t_s in enumerate(self._t_s):
            if k in (one[0], other[0]) or not len(self._places[k]):
                continue
            place = fit[0] + fit[1] * (t_s - fit[2])
            away, m = self._trees[k].query(place)
            # Both ends of the line are uncertain, the more the farther it is drawn out.
            far = abs(t_s - fit[2]) / max(abs(self._time(one) - self._time(other)), 1e-9)
            pair = math.hypot(self._sigma_of(one), self._sigma_of(other))
            sigma = math.hypot(self._sigma_of((k, int(m))), pair * max(far, 0.5))
            if away < _GATE * sigma:
                members.append((k, int(m)))
        members.sort()
        return self._best(members)

    def _best(self, members: list[tuple[int, int]]) -> _Line | None:
        """Fit of one place where that agrees, else of a motion, without points that do not."""
        for is_still in (True, False):
            kept = list(members)
            while len(kept) >= 2:
                fit = self._fit(kept, is_still=is_still)
                off = [self._off(each, fit) for each in kept]
                worst = int(np.argmax(off))
                if off[worst] < _GATE:
                    break
                if is_still:
                    kept = []
                    break
                del kept[worst]
            if len(kept) >= 2 and float(np.hypot(*fit[1])) <= self._max_rate:
                chance = self._by_chance(kept, is_still=is_still)
                return _Line(tuple(kept), fit[0], fit[1], fit[2], chance)
        return None

    def _fit(
        self, members: list[tuple[int, int]], *, is_still: bool = False
    ) -> tuple[FloatArray, FloatArray, float]:
        """Place at the mean time, rate and mean time, by least squares."""
        t = np.array([self._time(each) for each in members])
        weight = np.array([self._sigma_of(each) ** -2 for each in members])
        places = np.array([self._places[k][n] for k, n in members])
        mean_t = float(weight @ t / weight.sum())
        mean = weight @ places / weight.sum()
        spread = float(weight @ (t - mean_t) ** 2)
        if is_still or spread <= 0.0:
            return mean, np.zeros(2), mean_t
        return mean, (weight * (t - mean_t)) @ places / spread, mean_t

    def _off(self, member: tuple[int, int], fit: tuple[FloatArray, FloatArray, float]) -> float:
        """Distance of a point from a fit, in sigma of the point."""
        k, n = member
        place = fit[0] + fit[1] * (self._t_s[k] - fit[2])
        return float(np.hypot(*(self._places[k][n] - place))) / self._sigma_of(member)

    def _by_chance(self, members: list[tuple[int, int]], *, is_still: bool) -> float:
        """Number of lines with as many points, as bright, that chance makes of the frames' points.

        One point is anywhere; the second anywhere within reach of the largest motion, unless all
        are at one place; each other one within the gate. Any choice of frames might have made it.
        """
        expected = float(math.comb(len(self._frames), len(members)))
        for number, (k, n) in enumerate(members):
            snr = self._frames[k].points.snr[n]
            alike = len(self._snr[k]) - int(np.searchsorted(self._snr[k], snr))
            gate = _GATE * math.sqrt(2.0) * self._sigma_of((k, n))
            reach = gate
            if number == 1 and not is_still:
                apart_s = abs(self._time(members[1]) - self._time(members[0]))
                reach = max(self._max_rate * apart_s, gate)
            expected *= alike * (1.0 if number == 0 else math.pi * reach**2 / self._area)
        return expected

    def track(self, line: _Line) -> PointTrack:
        """The line's record."""
        numbers: list[int | None] = [None] * len(self._frames)
        for k, n in line.members:
            numbers[k] = n
        snr, flux, error, sigma = (
            np.array([getattr(self._frames[k].points, name)[n] for k, n in line.members])
            for name in ("snr", "flux_adu", "flux_sigma_adu", "sigma_px")
        )
        weight = error**-2.0
        return PointTrack(
            state=self._state(line),
            numbers=tuple(numbers),
            t_s=line.t_s,
            x_px=float(line.start_px[0]),
            y_px=float(line.start_px[1]),
            rate_px_s=(float(line.rate_px_s[0]), float(line.rate_px_s[1])),
            sigma_px=float((sigma**-2.0).sum() ** -0.5),
            snr=float(np.hypot.reduce(snr)),
            flux_adu=float(weight @ flux / weight.sum()),
            flux_sigma_adu=float(weight.sum() ** -0.5),
            by_chance=line.by_chance,
        )

    def _state(self, line: _Line) -> PointState:
        if len(line.members) < NEEDED:
            return "two frames"
        clear = [(k, n) for k, n in line.members if not self._frames[k].points.is_trail_end[n]]
        if len(clear) < NEEDED:
            return "trail ends"
        if line.by_chance > MAX_BY_CHANCE:
            return "chance"
        if self._may_be_bad_pixels(clear):
            return "same pixels"
        return "confirmed"

    def _may_be_bad_pixels(self, members: list[tuple[int, int]]) -> bool:
        """Whether the sensor may be all that is seen: the same pixels by one pointing."""
        if all(self._frames[k].points.is_shape_known for k, _ in members):
            return False
        shifts = np.array([self._frames[k].shift_px for k, _ in members])
        lists = [self._frames[k].points for k, _ in members]
        own = np.array([(p.x_px[n], p.y_px[n]) for p, (_, n) in zip(lists, members, strict=True)])
        is_one_pointing = float(np.ptp(shifts, axis=0).max()) < POINTING_PX
        return is_one_pointing and float(np.ptp(own, axis=0).max()) < _STILL_PX

    def _time(self, member: tuple[int, int]) -> float:
        return self._t_s[member[0]]

    def _sigma_of(self, member: tuple[int, int]) -> float:
        return float(self._sigma[member[0]][member[1]])
