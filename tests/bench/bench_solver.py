"""How long the plate solver takes: ``python -m tests.bench.bench_solver``.

Full solution with the belt's shipped index files and a position hint, the fast path, a wrong
hint, and a restart; the star lists are Tycho-2 as a 16-megapixel frame would show it.
"""

import statistics
import sys
import time
from collections.abc import Callable

from rsoconsole.instruments import PlateSolver, SolveHint
from tests.drawn.plate_fields import SCALE, SIZE, belt_plate, belt_stars

REPEATS = 40


def main() -> None:
    """Print median, 95th percentile and worst of each in milliseconds."""
    fields = [(9.0 * k, -10.0 + (7 * k) % 20) for k in range(REPEATS)]
    lists = [belt_stars(belt_plate(*at), seed=k) for k, at in enumerate(fields)]
    scale = {"scale_low_arcsec_px": 0.95 * SCALE, "scale_high_arcsec_px": 1.05 * SCALE}
    started = time.perf_counter()
    with PlateSolver() as solver:

        def solve(k: int, ra_offset_deg: float = 0.2) -> bool:
            ra_deg, dec_deg = fields[k]
            hint = SolveHint(
                ra_icrs_deg=(ra_deg + ra_offset_deg) % 360, dec_icrs_deg=dec_deg, **scale
            )
            found = solver.solve(lists[k], frame_id=k, hint=hint, deadline_s=10, **SIZE)
            return hasattr(found, "wcs")

        def fast(k: int) -> bool:
            return solver.refit_from(before[k], lists[k], frame_id=k, **SIZE) is not None

        solve(0)
        say(f"start and first solution: {1e3 * (time.perf_counter() - started):.0f} ms")
        report("full, hinted", solve)
        before = [
            solver.solve(rows, frame_id=0, hint=SolveHint(**scale), deadline_s=10, **SIZE)
            for rows in lists
        ]
        report("fast path", fast)
        report("wrong hint", lambda k: solve(k, 30.0))


def report(name: str, call: Callable[[int], bool]) -> None:
    """Time ``call`` on every field."""
    took_ms, solved = [], 0
    for k in range(REPEATS):
        started = time.perf_counter()
        solved += call(k)
        took_ms.append(1e3 * (time.perf_counter() - started))
    took_ms.sort()
    say(
        f"{name}: solved {solved} of {REPEATS}, median {statistics.median(took_ms):.1f} ms, "
        f"p95 {took_ms[int(0.95 * REPEATS)]:.1f} ms, worst {took_ms[-1]:.1f} ms"
    )


def say(text: str) -> None:
    """One line of the report."""
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
