"""Points of a few successive frames joined into tracklets, each with a probability. Pure.

Every set of points, at most one a frame, through which a straight line at constant speed passes is
a hypothesis. Its gain over chance is the logarithm of a likelihood ratio: how well the points lie
on the line, against how densely points lie anyhow, how many frames are without a point, and how far
the motion is from that of most objects. The set of hypotheses that gains most and uses no point
twice is the answer (Morefield 1977, IEEE Trans. Automatic Control 22, 302; solved as an integer
programme). A tracklet's probability follows from the gain of the answer over the best one without
the tracklet. The common motion is learnt from the points themselves: geostationary objects all
cross the stars alike.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

_GATE = 4.0
"""Gate in sigma, on either axis."""
_HYPOTHESES = 4000
_COMMON_TRIALS = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionPrior:
    """Prior assumptions about points and their motions; lengths in any one unit."""

    sigma: float
    """Sigma of a point, on each axis."""
    area: float
    largest_speed: float
    """Largest speed, length per second."""
    detection_probability: float = 0.9
    false_points: float = 2.0
    """Mean number of points in a frame that are of no object."""
    common: tuple[float, float] | None = None
    """Motion (per second) that most objects share; None: learnt from the points."""
    shares: tuple[tuple[float, float], ...] = ((0.8, 0.02), (0.15, 0.15))
    """Shares of objects in the common motion, each with its sigma over the speed; others: any."""
    objects: float = 1.5
    """Mean number of objects in a sequence of frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracklet:
    """Points of one object over several frames, with its rates."""

    points: tuple[tuple[int, int], ...]
    """Points as (frame, index of the point in it), in order of time."""
    x_rate: float
    y_rate: float
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hypothesis:
    points: tuple[tuple[int, int], ...]
    velocity: FloatArray
    log_fit: float
    """Logarithm of the gain over chance, without the motion's share."""
    velocity_sigma: float


def link_points(
    t_s: Sequence[float], points: Sequence[FloatArray], known: MotionPrior
) -> tuple[Tracklet, ...]:
    """Find tracklets through frames at times ``t_s``, the surest first.

    ``points``: (M, 2) for each frame. A point belongs to one tracklet at most. Two points make a
    tracklet only where they move as the others do.
    """
    hypotheses = _hypotheses(t_s, [np.reshape(each, (-1, 2)) for each in points], known)
    common = _common_motion(hypotheses, known)
    gains = _gains(hypotheses, common, known)
    worth = [n for n in np.argsort(-gains, kind="stable")[:_HYPOTHESES] if gains[n] > 0.0]
    candidates = [(hypotheses[n].points, float(gains[n])) for n in worth]
    chosen = best_disjoint_sets(candidates)
    best = sum(candidates[n][1] for n in chosen)
    # A lone object has no company whose motion it could share.
    lone = _lone_price(common, known) if len(chosen) == 1 and known.common is None else 0.0
    found = []
    for n in chosen:
        others = [each for place, each in enumerate(candidates) if place != n]
        rest = sum(others[m][1] for m in best_disjoint_sets(others))
        x_rate, y_rate = hypotheses[worth[n]].velocity.tolist()
        probability = float(1.0 / (1.0 + np.exp(-(best - rest - lone))))
        points_of = candidates[n][0]
        found.append(
            Tracklet(points=points_of, x_rate=x_rate, y_rate=y_rate, probability=probability)
        )
    return tuple(sorted(found, key=lambda each: -each.probability))


def _hypotheses(
    t_s: Sequence[float], points: Sequence[FloatArray], known: MotionPrior
) -> list[_Hypothesis]:
    """Every set of points near one straight line, and every subset of it of two points or more."""
    found: dict[tuple[tuple[int, int], ...], _Hypothesis] = {}
    for a in range(len(points)):
        for b in range(a + 1, len(points)):
            for i, j in np.ndindex(len(points[a]), len(points[b])):
                velocity = (points[b][j] - points[a][i]) / (t_s[b] - t_s[a])
                if np.hypot(*velocity) > known.largest_speed:
                    continue
                for chosen in _along(t_s, points, (a, i), (b, j), known):
                    if chosen not in found:
                        found[chosen] = _fitted(t_s, points, chosen, known)
    return list(found.values())


def _along(
    t_s: Sequence[float],
    points: Sequence[FloatArray],
    first: tuple[int, int],
    last: tuple[int, int],
    known: MotionPrior,
) -> Iterator[tuple[tuple[int, int], ...]]:
    """Yield sets that begin with one point and end with another, through points between them."""
    (a, i), (b, j) = first, last
    span = t_s[b] - t_s[a]
    between: list[tuple[tuple[int, int], ...]] = [()]
    for k in range(a + 1, b):
        share = (t_s[k] - t_s[a]) / span
        expected = points[a][i] * (1.0 - share) + points[b][j] * share
        reach = _GATE * known.sigma * np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        near = np.flatnonzero(np.all(np.abs(points[k] - expected) <= reach, axis=-1))
        between = [
            (*each, *more) for each in between for more in ((), *(((k, int(n)),) for n in near))
        ]
    for each in between:
        yield (first, *each, last)


def _fitted(
    t_s: Sequence[float],
    points: Sequence[FloatArray],
    chosen: tuple[tuple[int, int], ...],
    known: MotionPrior,
) -> _Hypothesis:
    """Fit a straight line by least squares, with the points' gain over chance."""
    at = np.array([t_s[frame] for frame, _ in chosen])
    places = np.array([points[frame][n] for frame, n in chosen])
    rows = np.stack([np.ones_like(at), at], axis=-1)
    normal = np.linalg.inv(rows.T @ rows)
    start, velocity = normal @ rows.T @ places
    left = places - rows @ np.stack([start, velocity])
    missing = len(t_s) - len(chosen)
    background = np.log(known.false_points / known.area)
    log_fit = (
        -float(np.sum(left**2)) / (2.0 * known.sigma**2)
        - len(chosen) * (np.log(2.0 * np.pi * known.sigma**2) + background)
        + len(chosen) * np.log(known.detection_probability)
        + missing * np.log(1.0 - known.detection_probability)
        # The line's own place and motion are unknown beforehand: what the points leave of them.
        + np.log(known.objects / known.area)
        + np.log((2.0 * np.pi * known.sigma**2) ** 2 * float(np.linalg.det(normal)))
    )
    return _Hypothesis(
        points=chosen,
        velocity=velocity,
        log_fit=log_fit,
        velocity_sigma=known.sigma * float(np.sqrt(normal[1, 1])),
    )


def _common_motion(hypotheses: Sequence[_Hypothesis], known: MotionPrior) -> FloatArray | None:
    """Velocity that explains most of the points; None where nothing moves at all."""
    if known.common is not None:
        return np.array(known.common)
    plain = _gains(hypotheses, None, known)
    best, found = 0.0, None
    for n in np.argsort(-plain, kind="stable")[:_COMMON_TRIALS]:
        trial = hypotheses[n].velocity
        gains = _gains(hypotheses, trial, known)
        total = sum(gains[m] for m in _greedy([each.points for each in hypotheses], gains))
        if total > best:
            best, found = total, trial
    return found


def _gains(
    hypotheses: Sequence[_Hypothesis], common: FloatArray | None, known: MotionPrior
) -> FloatArray:
    """(H,) logarithms of the likelihood ratios against chance."""
    if not hypotheses:
        return np.empty(0)
    log_fit = np.array([each.log_fit for each in hypotheses])
    velocities = np.array([each.velocity for each in hypotheses])
    sigma_2 = np.array([each.velocity_sigma for each in hypotheses]) ** 2
    anyhow = 1.0 / (np.pi * known.largest_speed**2)
    if common is None:
        return np.asarray(log_fit + np.log(anyhow))
    speed_2 = float(common @ common)
    away_2 = np.sum((velocities - common) ** 2, axis=-1)
    density = np.full(len(log_fit), anyhow * (1.0 - sum(share for share, _ in known.shares)))
    for share, sigma in known.shares:
        spread_2 = sigma_2 + sigma**2 * speed_2
        density += share * np.exp(-away_2 / (2.0 * spread_2)) / (2.0 * np.pi * spread_2)
    return np.asarray(log_fit + np.log(density))


def _lone_price(common: FloatArray | None, known: MotionPrior) -> float:
    """Gain of a motion by counting as the common one."""
    if common is None:
        return 0.0
    share, sigma = known.shares[0]
    spread_2 = sigma**2 * float(common @ common) + known.sigma**2
    gained = share / (2.0 * np.pi * spread_2) * np.pi * known.largest_speed**2
    return float(np.log(max(gained, 1.0)))


def best_disjoint_sets(
    candidates: Sequence[tuple[tuple[tuple[int, int], ...], float]],
) -> list[int]:
    """Choose the sets of points that gain most together without sharing a point.

    ``candidates``: each set with its gain. Returns indices in ``candidates``.
    """
    chosen: list[int] = []
    for group in _connected([points for points, _ in candidates]):
        sets = [candidates[n][0] for n in group]
        gains = np.array([candidates[n][1] for n in group])
        quick = _greedy(sets, gains)
        if sum(gains[quick]) < _bound(sets, gains) - 1e-9:
            quick = _by_integers(sets, gains)
        chosen += [group[n] for n in quick]
    return chosen


def _connected(sets: Sequence[tuple[tuple[int, int], ...]]) -> list[list[int]]:
    """Groups of sets that share no point with one another."""
    import scipy.sparse
    from scipy.sparse.csgraph import connected_components

    if not sets:
        return []
    numbers = {point: n for n, point in enumerate(sorted({p for each in sets for p in each}))}
    rows = [n for n, each in enumerate(sets) for _ in each]
    columns = [len(sets) + numbers[point] for each in sets for point in each]
    size = len(sets) + len(numbers)
    graph = scipy.sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    count, labels = connected_components(graph, directed=False)
    return [
        group
        for label in range(count)
        if (group := [int(n) for n in np.flatnonzero(labels[: len(sets)] == label)])
    ]


def _greedy(sets: Sequence[tuple[tuple[int, int], ...]], gains: FloatArray) -> list[int]:
    taken: set[tuple[int, int]] = set()
    chosen = []
    for n in np.argsort(-gains, kind="stable"):
        if gains[n] <= 0.0:
            break
        if taken.isdisjoint(sets[n]):
            taken.update(sets[n])
            chosen.append(int(n))
    return chosen


def _bound(sets: Sequence[tuple[tuple[int, int], ...]], gains: FloatArray) -> float:
    """Upper bound of any choice's gain: every point at the best share that any set gives it."""
    best: dict[tuple[int, int], float] = {}
    for each, gain in zip(sets, gains, strict=True):
        for point in each:
            best[point] = max(best.get(point, 0.0), float(gain) / len(each))
    return sum(best.values())


def _by_integers(sets: Sequence[tuple[tuple[int, int], ...]], gains: FloatArray) -> list[int]:
    from scipy.optimize import Bounds, LinearConstraint, milp

    numbers = {point: n for n, point in enumerate(sorted({p for each in sets for p in each}))}
    uses = np.zeros((len(numbers), len(sets)))
    for n, each in enumerate(sets):
        uses[[numbers[point] for point in each], n] = 1.0
    solved = milp(
        -gains,
        constraints=LinearConstraint(uses, -np.inf, 1.0),
        integrality=np.ones(len(sets)),
        bounds=Bounds(0.0, 1.0),
    )
    return (
        _greedy(sets, gains)
        if solved.x is None
        else [int(n) for n in np.flatnonzero(solved.x > 0.5)]
    )
