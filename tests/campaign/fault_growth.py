"""Whether what one engine holds, and how long its cycle takes, grows with the frames of its life.

A slope per 1,000 frames with its 95 % interval, over what comes after ``SETTLED`` frames: until
then fills what is bounded (the record's last 2,000 rows and SQLite's pages: 4 MiB). Flat is a slope
whose interval reaches 0, or ends below a bound.

The cycle is measured on a machine that does other things, too: beside each one a fixed piece of
work is timed, and only what does not go with that counts.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import theilslopes

SETTLED = 400
MIN_SAMPLES = 20
CYCLE_SHARE = 0.1
"""Of a cycle, that 1,000 frames may add: a tenth over a night."""
_ROUNDS, _TURNS = 5, 100_000
_DRAWS = 400
_SLOPE_PERCENT = (2.5, 97.5)
Floats = npt.NDArray[np.float64]
Slopes = dict[str, dict[str, float]]


@dataclass(slots=True)
class Sample:
    """The engine and its children at one frame."""

    frame: int
    mib: float
    descriptors: int
    threads: int
    cycle_s: float
    """Of one frame, measured while nothing was done to it."""
    pace_s: float
    """How long a fixed piece of work took beside it."""


@dataclass(frozen=True, slots=True)
class _Held:
    words: str
    bound: float | None
    """Per 1,000 frames; None: a share of what it was first."""


HELD = {
    # A row of the record kept for each frame, and nothing else, would be 2.4 more.
    "mib": _Held("memory of the engine and its children, MiB", 3.0),
    "descriptors": _Held("their open files", 1.0),
    "threads": _Held("their threads", 1.0),
    "cycle_s": _Held("an undisturbed cycle, s", None),
}


def pace_s() -> float:
    """A fixed piece of work, timed: what the machine leaves to one more program."""
    begun_s = time.monotonic()
    for _ in range(_ROUNDS):
        sum(range(_TURNS))
    return (time.monotonic() - begun_s) / _ROUNDS


def slopes_of(samples: Sequence[Sample]) -> Slopes:
    """Of each figure first and last value, slope, interval and bound; empty of a short night."""
    settled = [each for each in samples if each.frame >= SETTLED]
    if len(settled) < MIN_SAMPLES:
        return {}
    frames = np.array([each.frame for each in settled], float)
    pace = np.array([each.pace_s for each in settled], float)
    found: Slopes = {}
    for name, held in HELD.items():
        values = np.array([getattr(each, name) for each in settled], float)
        first = float(np.median(values[:10]))
        if held.bound is None:
            slope, low, high = _beside(values, frames, pace)
        else:
            slope, _, low, high = theilslopes(values, frames)
        found[name] = {
            "first": first,
            "last": float(np.median(values[-10:])),
            "per_1000": slope * 1e3,
            "low": low * 1e3,
            "high": high * 1e3,
            "bound": CYCLE_SHARE * first if held.bound is None else held.bound,
        }
    return found


def _beside(values: Floats, frames: Floats, pace: Floats) -> tuple[float, float, float]:
    """The slope with the frames of what does not go with the machine's pace, and its interval."""
    values, pace = _without_tails(values), _without_tails(pace)
    terms = np.column_stack([np.ones_like(frames), frames - frames.mean(), pace - pace.mean()])
    draw = np.random.default_rng(1)
    picks = draw.integers(len(values), size=(_DRAWS, len(values)))
    slopes = [np.linalg.lstsq(terms[pick], values[pick], rcond=None)[0][1] for pick in picks]
    low, high = np.percentile(slopes, _SLOPE_PERCENT)
    return float(np.linalg.lstsq(terms, values, rcond=None)[0][1]), float(low), float(high)


def _without_tails(values: Floats) -> Floats:
    """One cycle that waited for a disk says nothing of the others."""
    return np.clip(values, *np.percentile(values, (5, 95)))


def growing(slopes: Mapping[str, Mapping[str, float]]) -> list[str]:
    """What grows; nights from before there were bounds are not judged."""
    return [
        HELD[name].words
        for name, s in slopes.items()
        if "bound" in s and s["low"] > 0.0 and s["high"] > s["bound"]
    ]


def growth_lines(slopes: Mapping[str, Mapping[str, float]], night: str) -> list[str]:
    """Rows of the table."""
    grow = growing(slopes)
    lines = []
    for name, s in slopes.items():
        words = HELD[name].words
        found = "GROWS" if words in grow else "flat" if "bound" in s else "not judged"
        bound = f", bound {s['bound']:.2g}" if "bound" in s else ""
        lines.append(
            f"| {words}, {night} | {s['first']:.3g} to {s['last']:.3g}, {s['per_1000']:+.2g} per"
            f" 1,000 frames ({s['low']:+.2g} to {s['high']:+.2g} at 95 %{bound}): {found} |"
        )
    return lines
