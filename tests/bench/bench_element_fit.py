"""How well the factors on the assumed errors of elements are found, in worlds where they are known.

Run: ``python -m tests.bench.bench_element_fit [WORLDS] [OBJECTS] [FACTOR]``; with FACTOR all three
are that, else drawn. The figures stand in ``rsoconsole/orbits/README.md``.
"""

import sys

import numpy as np

from rsoconsole.orbits import ErrorFactors, fit_factors
from rsoconsole.orbits.identification.element_errors import MANOEUVRED, UNDISTURBED
from rsoconsole.records import FloatArray
from tests.truth.element_rows_of_truth import low_rows, times

SEED = 100


def values_of(factors: ErrorFactors) -> FloatArray:
    return np.array([factors.along_at_epoch, factors.along_by_age, factors.across])


def world(seed: int, objects: int, factor: float | None) -> tuple[FloatArray, FloatArray]:
    """Logarithms of found over true (3,), and the stated errors of those."""
    rng = np.random.default_rng(seed)
    truth = np.exp(rng.normal(0.0, 0.5, 3)) if factor is None else np.full(3, factor)
    rows = list(low_rows(objects, rng, times(UNDISTURBED["LEO"], *truth), MANOEUVRED["LEO"]))
    (found,) = fit_factors(rows)
    values = values_of(found.factors)
    return np.log(values / truth), values_of(found.sigmas) / values


def main() -> None:
    """Print the table."""
    worlds, objects = (int(each) for each in (*sys.argv[1:3], *("36", "40")[len(sys.argv[1:3]) :]))
    factor = float(sys.argv[3]) if len(sys.argv) > 3 else None
    found = np.array([world(SEED + n, objects, factor) for n in range(worlds)])
    off, sigma = found[:, 0], found[:, 1]
    inside = [np.mean(np.abs(off / sigma) < most, axis=0) for most in (1.0, 2.0)]
    print(f"{worlds} worlds of {objects} low objects: along at epoch, along by age, across")
    for words, row in (
        ("found over true, mean", np.exp(off.mean(axis=0))),
        ("stated error, mean", sigma.mean(axis=0)),
        ("within 1 sigma", inside[0]),
        ("within 2 sigma", inside[1]),
    ):
        print(f"{words:24}" + "".join(f"{value:8.2f}" for value in row))


if __name__ == "__main__":
    main()
