"""Chains of streaks below tau that together are as sure as one above it. Pure.

A streak of any probability shows its motion, but for the sense. Another frame's streak of the same
object lies in a small area, with the same length and direction. A chain's gain over chance is the
likelihood ratio of that agreement against streaks that lie about the field as those of the window
do; its odds are the gain, times the odds of its streaks, times those of an object in the field
(Blackman 1986, Multiple-Target Tracking with Radar Applications, ch. 9). The number of chance
chains with such a gain is at most that of the ways to draw one over the gain (Markov).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, Measurement
from rsoconsole.sky import IntArray, wrap_180
from rsoconsole.tracking.association.following import (
    TRACKABLE_CLASSES,
    Following,
    FollowSettings,
    FrameInput,
)
from rsoconsole.tracking.filters.agreement import (
    DIRECTION_TOLERANCE_DEG,
    SHORTEST_WITH_DIRECTION_ARCSEC,
    streak_motion,
)
from rsoconsole.tracking.initiation.chains import (
    ACROSS_ARCSEC,
    ACROSS_SHARE,
    BEGINS_AT,
    LENGTH_SHARE,
    LOST_TOLERANCE,
    WINDOW,
    Chain,
)

BoolArray = npt.NDArray[np.bool_]

WAITS_AT = 0.5
"""Probability of a pair from which the search waits for another frame."""
_MAX_CHANCE = 1e-4
"""Largest number of chance chains expected in a window for one to initiate a track."""
_OBJECTS, _DETECTED = 0.1, 0.7
"""Mean number of faint objects in the field, and probability that a frame shows one of them."""
_MIN_STREAKS = 3
"""Number of streaks of a chain, each of another frame; one less where one is above tau."""
_WIDER, _SHARE = 2.2, 0.003
"""Factor on the variances that places claim; sigma of a curved way, as a share of its length."""
_GATE = 4.0
_AT_ONE_PLACE = 3.0
"""Sigmas within which two streaks count as at one place."""
_NEAR_SHARE, _NEAR_LENGTH = 0.125, 0.3
"""Share of the field, and of length, within which streaks count as near: how dense chance is."""
_EVEN = 30.0
"""Number of streaks that an even density counts for: a few alike are no dense field."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaintChain:
    """Streaks of one motion, at least one of them below tau, with their common probability."""

    streaks: Chain
    """In order of time, the last of the present frame."""
    probability: float
    begins: bool
    """True where it initiates a track."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Streaks:
    """Streaks of a window; (n,) each, lengths in arcsec."""

    all: Sequence[Measurement]
    frame: IntArray
    t_s: FloatArray
    place: FloatArray
    """(n, 2) east and north in the plane."""
    on_sensor: FloatArray
    """(n, 2) place in the frame, along the same axes."""
    covariance: FloatArray
    """(n, 2, 2) of the place."""
    length: FloatArray
    axis_deg: FloatArray
    log_odds: FloatArray
    is_faint: BoolArray
    exposure_s: float
    area: float
    """Of the field."""

    @property
    def log_lengths(self) -> float:
        """Logarithm of the longest streak over the shortest."""
        return math.log(max(math.sqrt(self.area) / SHORTEST_WITH_DIRECTION_ARCSEC, math.e))


def faint_chain(
    before: Following, usable: Sequence[Measurement], seen: FrameInput, settings: FollowSettings
) -> FaintChain | None:
    """Find the likeliest chain that ends in a frame; None where no two of its streaks agree.

    ``usable``: the frame's streaks above tau.
    """
    streaks = _window(before, usable, seen, settings)
    if streaks is None:
        return None
    chains = [
        (list(numbers), gain)
        for numbers, gain in _chains(streaks)
        # A search at one hour angle sees what is fixed to the sensor move as the belt does.
        if not _at_one_place(streaks, streaks.on_sensor, numbers)[:, numbers].all()
    ]
    members = np.unique([n for numbers, _ in chains for n in numbers]).astype(np.int64)
    density = dict(zip(members.tolist(), _log_density(streaks, members), strict=True))
    found = (
        _weighed(streaks, numbers, gain - sum(density[n] for n in numbers))
        for numbers, gain in chains
    )
    return max(
        (each for each in found if each is not None),
        key=lambda each: (each.begins, each.probability),
        default=None,
    )


def waiting_faint(before: Following, seen: FrameInput) -> Chain:
    """Streaks below tau that may still initiate a track with later ones."""
    first = seen.frame_id - (WINDOW - 2)
    return (*(m for m in before.faint if m.frame_id >= first), *seen.faint)


def _window(
    before: Following, usable: Sequence[Measurement], seen: FrameInput, settings: FollowSettings
) -> _Streaks | None:
    faint = {m.measurement_id for m in (*before.faint, *seen.faint)}
    each = [
        (m, motion)
        for m in (*before.faint, *before.earlier, *before.candidates, *seen.faint, *usable)
        if m.object_class in TRACKABLE_CLASSES
        and (motion := streak_motion(m)) is not None
        and motion.length_arcsec > SHORTEST_WITH_DIRECTION_ARCSEC
    ]
    frames = {m.frame_id for m, _ in each}
    if seen.field is None or seen.frame_id not in frames or len(frames) < 2:
        return None
    cd = np.reshape(seen.field.wcs.cd, (2, 2))
    ra, dec = (np.array([getattr(m, name) for m, _ in each]) for name in _DIRECTION)
    cos_dec = math.cos(math.radians(float(np.median(dec))))
    east = wrap_180(ra - ra[0]) * cos_dec * 3600.0
    said = np.clip([m.confidence for m, _ in each], 1e-6, 1.0 - 1e-6)
    ee, en, nn = np.array([m.cov_sky_arcsec2 for m, _ in each]).T
    return _Streaks(
        all=[m for m, _ in each],
        frame=np.array([m.frame_id for m, _ in each]),
        t_s=np.array([(m.t_mid_utc_ns - seen.t_mid_utc_ns) / 1e9 for m, _ in each]),
        place=np.stack([east, (dec - dec[0]) * 3600.0], axis=-1),
        on_sensor=3600.0 * np.array([(m.x_px, m.y_px) for m, _ in each]) @ cd.T,
        covariance=_WIDER * np.array([[ee, en], [en, nn]]).transpose(2, 0, 1),
        length=np.array([motion.length_arcsec for _, motion in each]),
        axis_deg=np.array([motion.axis_deg for _, motion in each]),
        log_odds=np.log(said / (1.0 - said)),
        is_faint=np.array([m.measurement_id in faint for m, _ in each]),
        exposure_s=seen.exposure_s,
        area=(7200.0 * settings.half_field_deg) ** 2,
    )


_DIRECTION = ("ra_icrs_deg", "dec_icrs_deg")


def _chains(streaks: _Streaks) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield chains (numbers of streaks in order of time) with the logarithm of their gain."""
    last = streaks.frame[np.argmax(streaks.t_s)]
    here, there = np.flatnonzero(streaks.frame == last), np.flatnonzero(streaks.frame != last)
    if not len(here) or not len(there):
        return
    a, c = (each.ravel() for each in np.meshgrid(there, here, indexing="ij"))
    is_pair = streaks.t_s[c] > streaks.t_s[a]
    a, c = a[is_pair], c[is_pair]
    way = streaks.place[c] - streaks.place[a]
    moved = way * (streaks.exposure_s / (streaks.t_s[c] - streaks.t_s[a]))[:, None]
    alike = _alike(streaks, a, moved) + _alike(streaks, c, moved)
    for n in np.flatnonzero(np.isfinite(alike)).tolist():
        first, end = int(a[n]), int(c[n])
        share = streaks.exposure_s / (streaks.t_s[end] - streaks.t_s[first])
        # Any direction, any logarithm of the length: what the first streak's place leaves open.
        length = math.hypot(*moved[n])
        gain = math.log(streaks.area * share**2 / (2.0 * math.pi * length**2 * streaks.log_lengths))
        yield from _through(streaks, first, end, moved[n], gain + float(alike[n]))


def _through(
    streaks: _Streaks, first: int, end: int, moved: FloatArray, gain: float
) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield a pair, and the chains through streaks of the frames between it."""
    yield (first, end), gain
    t_s = streaks.t_s
    between = np.flatnonzero((t_s > t_s[first]) & (t_s < t_s[end]))
    between = between[
        (streaks.frame[between] != streaks.frame[first])
        & (streaks.frame[between] != streaks.frame[end])
    ]
    if not len(between):
        return
    share = (t_s[between] - t_s[first]) / (t_s[end] - t_s[first])
    way = streaks.place[end] - streaks.place[first]
    off = streaks.place[between] - streaks.place[first] - share[:, None] * way
    spread = (
        streaks.covariance[between]
        + ((1.0 - share) ** 2)[:, None, None] * streaks.covariance[first]
        + (share**2)[:, None, None] * streaks.covariance[end]
        + _SHARE**2 * float(way @ way) * np.eye(2)
    )
    off2 = np.einsum("ni,ni->n", off, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    gains = (
        _alike(streaks, between, np.broadcast_to(moved, (len(between), 2)))
        + np.log(streaks.area / (2.0 * np.pi * np.sqrt(np.linalg.det(spread))))
        - 0.5 * off2
    )
    gains = np.where(off2 < _GATE**2, gains, -np.inf)
    frames = [
        [int(n) for n in np.flatnonzero((streaks.frame[between] == each) & np.isfinite(gains))]
        for each in np.unique(streaks.frame[between])
    ]
    for chosen in itertools.product(*([None, *numbers] for numbers in frames)):
        numbers = sorted((n for n in chosen if n is not None), key=lambda n: t_s[between[n]])
        if numbers:
            through = tuple(int(between[n]) for n in numbers)
            yield (first, *through, end), gain + float(gains[numbers].sum())


def _alike(streaks: _Streaks, numbers: IntArray, moved: FloatArray) -> FloatArray:
    """Logarithms of the gains by lengths and directions, against any; -inf where they disagree.

    ``moved``: (n, 2) motion in one exposure that each streak is compared with.
    """
    expected = np.maximum(np.hypot(moved[:, 0], moved[:, 1]), 1e-3)
    length = streaks.length[numbers]
    shorter = expected - length
    sigma = LENGTH_SHARE * expected + 3.0
    axis_deg = np.degrees(np.arctan2(moved[:, 0], moved[:, 1]))
    bend_deg = (streaks.axis_deg[numbers] - axis_deg + 90.0) % 180.0 - 90.0
    sigma_deg = np.degrees(np.maximum(ACROSS_ARCSEC / expected, ACROSS_SHARE))
    gain = (
        _log_student(shorter / sigma)
        + np.log(length * streaks.log_lengths / sigma)
        + _log_student(bend_deg / sigma_deg)
        + np.log(180.0 / sigma_deg)
    )
    is_alike = (np.abs(shorter) < LOST_TOLERANCE * expected + 10.0) & (
        np.abs(bend_deg) < DIRECTION_TOLERANCE_DEG
    )
    return np.where(is_alike, gain, -np.inf)


def _log_student(sigmas: FloatArray) -> FloatArray:
    """Logarithm of Student's law with four degrees of freedom."""
    return np.asarray(math.log(0.375) - 2.5 * np.log1p(sigmas**2 / 4.0))


def _log_density(streaks: _Streaks, these: IntArray) -> FloatArray:
    """Logarithms of how dense streaks like these lie, over an even density; 0 at least.

    Infinite for a streak that another frame shows at the same place of the sky, and for one of
    several on one line: a star does that, and a piece of a longer light.
    """
    axis_deg, length = streaks.axis_deg, np.log(streaks.length)
    turn_deg = np.abs((axis_deg[these, None] - axis_deg + 90.0) % 180.0 - 90.0)
    is_other = streaks.frame[these, None] != streaks.frame
    is_parallel = turn_deg < DIRECTION_TOLERANCE_DEG
    count = is_other.sum(axis=1) + _EVEN
    is_as_long = np.abs(length[these, None] - length) < _NEAR_LENGTH
    shape = (is_other & is_parallel & is_as_long).sum(axis=1)
    even = DIRECTION_TOLERANCE_DEG / 90.0 * min(2.0 * _NEAR_LENGTH / streaks.log_lengths, 1.0)
    off = streaks.on_sensor[these, None] - streaks.on_sensor
    reach = _NEAR_SHARE * math.sqrt(streaks.area)
    near = (is_other & (np.hypot(off[..., 0], off[..., 1]) < reach)).sum(axis=1)
    density = np.zeros(len(these))
    for found, share in ((shape, even), (near, np.pi * _NEAR_SHARE**2)):
        density += np.log(np.maximum((found / share + _EVEN) / count, 1.0))
    is_fixed = is_other & _at_one_place(streaks, streaks.place, these)
    axis = np.radians(axis_deg[these])
    across = np.stack([np.cos(axis), -np.sin(axis)], axis=-1)
    beside = np.einsum("ijk,ik->ij", streaks.place[these, None] - streaks.place, across)
    sigma2 = np.einsum("ij,ijk,ik->i", across, streaks.covariance[these], across)
    is_piece = ~is_other & (beside**2 < _AT_ONE_PLACE**2 * 2.0 * sigma2[:, None])
    is_piece[np.arange(len(these)), these] = False
    return np.where(((is_fixed | is_piece) & is_parallel).any(axis=1), np.inf, density)


def _at_one_place(
    streaks: _Streaks, places: FloatArray, these: IntArray | tuple[int, ...]
) -> BoolArray:
    """(m, n) true where these streaks and all others lie at one of the places (n, 2)."""
    rows = list(these)
    x, y = np.moveaxis(places[rows, None] - places, -1, 0)
    spread = streaks.covariance[rows, None] + streaks.covariance
    xx, xy, yy = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    off2 = (yy * x**2 - 2.0 * xy * x * y + xx * y**2) / (xx * yy - xy**2)
    return np.asarray(off2 < _AT_ONE_PLACE**2)


def _weighed(streaks: _Streaks, those: list[int], gain: float) -> FaintChain | None:
    """Return a chain with its probability; None where no streak of it is below tau."""
    if not math.isfinite(gain) or not streaks.is_faint[those].any():
        return None
    # Frames without any such streak count too.
    ways = math.comb(int(np.ptp(streaks.frame)), len(those) - 1)
    missed = int(np.ptp(streaks.frame[those])) + 1 - len(those)
    log_odds = math.log(_OBJECTS) + gain + missed * math.log(1.0 - _DETECTED)
    log_odds += float(streaks.log_odds[those].sum()) + len(those) * math.log(_DETECTED)
    log_chance = math.log(max(ways, 1)) - gain
    for n in those:
        as_sure = (streaks.frame == streaks.frame[n]) & (streaks.log_odds >= streaks.log_odds[n])
        log_chance += math.log(as_sure.sum())
    probability = 1.0 / (1.0 + math.exp(-min(max(log_odds, -50.0), 50.0)))
    least = _MIN_STREAKS if streaks.is_faint[those].all() else _MIN_STREAKS - 1
    return FaintChain(
        streaks=tuple(streaks.all[n] for n in those),
        probability=probability,
        begins=len(those) >= least
        and probability >= BEGINS_AT
        and log_chance <= math.log(_MAX_CHANCE),
    )
