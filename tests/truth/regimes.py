"""Twenty satellites of each kind of orbit, from the element files beside the project."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from rsoconsole.orbits import CatalogueEntry, parse_element_sets

TLES = Path(__file__).resolve().parents[3] / "shared" / "data" / "tles"
FILES = ("geo_all_20230622.tle", "meo_20200908.tle", "mix_20230622.tle")
EACH = 20
REGIMES = (
    "geostationary",
    "inclined geosynchronous",
    "navigation",
    "Molniya",
    "transfer orbit",
    "low orbit",
)


@dataclass(frozen=True)
class Sample:
    """One object, and the file it is of."""

    entry: CatalogueEntry
    file: Path


def kind(entry: CatalogueEntry) -> str | None:
    """Which of the regimes an orbit is of; None for what is none of them."""
    revolutions, e = entry.revolutions_a_day, entry.eccentricity
    inclination_deg = float(np.degrees(entry.record.inclo))
    if 0.9 < revolutions < 1.1 and e < 0.1:
        return "geostationary" if inclination_deg < 1.0 else "inclined geosynchronous"
    if e < 0.1 and 1.6 < revolutions < 2.3:
        return "navigation"
    if e > 0.5 and inclination_deg > 55.0:
        return "Molniya"
    if e > 0.5 and inclination_deg < 40.0:
        return "transfer orbit"
    return "low orbit" if revolutions > 11.0 else None


@cache
def samples(regime: str, each: int = EACH) -> tuple[Sample, ...]:
    """Objects of a regime, spread evenly over the files; their order is that of the files."""
    found: dict[int, Sample] = {}
    for name in FILES:
        path = TLES / name
        for entry in parse_element_sets(path.read_text(encoding="utf-8"), name).entries:
            if kind(entry) == regime and not entry.record.error:
                found.setdefault(entry.norad_id, Sample(entry, path))
    every = list(found.values())
    chosen = np.unique(np.linspace(0, len(every) - 1, each).round().astype(int))
    return tuple(every[i] for i in chosen)
