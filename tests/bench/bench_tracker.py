"""What following costs a frame: filter, association and hypotheses, one object and several.

    .venv/bin/python -m tests.bench.bench_tracker

Processor's milliseconds of one core a frame, the median of nights of 40 frames: ``alone`` one
streak a frame, ``three`` with two neighbours, ``astray`` a track that fits nothing while others do
not agree with each other, ``begin`` the frame that begins a track (the admissible region).
"""

import statistics
import time

import numpy as np

from rsoconsole.records import Measurement
from rsoconsole.tracking import Following, FollowSettings, follow
from tests.tracking.test_rivals import FRAMES, config, every_day, seen, streak, truth

NIGHTS = 5


def frames(kind: str, seed: int) -> list[tuple[Measurement, ...]]:
    """What each frame shows."""
    random = np.random.default_rng(seed)
    told = []
    for k in range(FRAMES):
        rate = truth()[k].rate
        away = np.zeros(2)
        if kind == "astray" and k > 2:
            away = np.array([900.0, 700.0]) * (1 + k % 2)
        shown = [streak(k, "ours", random, away, rate, 0.0)]
        if kind == "three":
            shown += [
                streak(k, name, random, np.array([east, 60.0]), rate, 0.0)
                for name, east in (("a", 200.0), ("b", -150.0))
            ]
        told.append(tuple(shown))
    return told


def took_ms(kind: str, settings: FollowSettings, seed: int) -> list[float]:
    """Of each frame."""
    following, found = Following(), []
    for k, shown in enumerate(frames(kind, seed)):
        sight = seen(k, *shown)
        began_s = time.process_time()
        following, _ = follow(following, sight, settings)
        found.append((time.process_time() - began_s) * 1e3)
    return found


def main() -> None:
    """Measure and print."""
    presets = {
        preset: FollowSettings(
            filter=config().filter.model_copy(update={"preset": preset}),
            half_field_deg=every_day().half_field_deg,
            bend=every_day().bend,
        )
        for preset in ("adaptive", "tuned")
    }
    for preset, settings in presets.items():
        took_ms("three", settings, 0)
        for kind in ("alone", "three", "astray"):
            every = [took_ms(kind, settings, seed) for seed in range(NIGHTS)]
            steady = [ms for night in every for ms in night[5:]]
            begin = statistics.median(night[1] for night in every)
            print(
                f"{preset:9s} {kind:7s} {statistics.median(steady):6.2f} ms a frame,"
                f" at most {max(steady):6.2f}, begin {begin:6.2f}"
            )


if __name__ == "__main__":
    main()
