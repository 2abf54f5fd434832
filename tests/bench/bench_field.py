"""What was in my frame: how fast, and how often right, over random fields of known truth.

Run: ``python -m tests.bench.bench_field [fields] [objects]``. Objects are off their elements within
the error model (``tests/truth/fields_of_truth.py``); each field looks at a random place where some
are, half of them at a low one. A fifth of what crosses is too faint; three frames in ten have a
line of something that no catalogue has.
"""

import sys
import time
from collections import Counter

import numpy as np
from sgp4.api import SatrecArray

from rsoconsole.orbits import (
    CatalogueEntry,
    FieldCatalogue,
    match_field,
    nearest_epoch_entries,
)
from rsoconsole.orbits.elements.sky_paths import Observer
from rsoconsole.sky import site_gcrs, unit_to_direction
from rsoconsole.words import NS_PER_S
from tests.truth.fields_of_truth import (
    DAY_UTC_NS,
    SITE,
    line_of,
    off_its_elements,
    plate_at,
    replicated,
    strange_line,
)

COUNT = 30_000


class Fields:
    """Random fields of one catalogue."""

    def __init__(self, entries: tuple[CatalogueEntry, ...], seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.catalogue = FieldCatalogue(entries)
        self.t_utc_ns = DAY_UTC_NS + round(self.rng.uniform(0.0, 0.2) * 86_400) * NS_PER_S
        entries = nearest_epoch_entries(entries, self.t_utc_ns)
        self.true = tuple(off_its_elements(each, self.t_utc_ns, self.rng) for each in entries)
        self.satellites = SatrecArray([each.record for each in self.true])
        self.asked_s: list[float] = []

    def run(self, side_deg: float = 1.5) -> Counter[str]:
        """One field's answers, by class of orbit and line."""
        rng, t = self.rng, self.t_utc_ns + round(self.rng.uniform(0.0, 600.0) * NS_PER_S)
        exposure_s = float(rng.choice([0.3, 1.0, 3.0, 10.0]))
        seen = Observer(SITE, t).places_at_leads(self.satellites, np.zeros(1))
        up = seen.u[:, 0] @ (z := site_gcrs(SITE, np.array([t]))[0][0]) / np.linalg.norm(z) > 0.35
        is_low = seen.range_km[:, 0] < 3000.0
        wanted = np.flatnonzero(up & (is_low == (rng.random() < 0.5)))
        chosen = seen.u[rng.choice(wanted), 0] + rng.normal(0.0, 0.004, 3)
        ra, dec = (float(each) for each in unit_to_direction(chosen))
        plate = plate_at(ra, dec, t, exposure_s, side_deg)
        near = np.flatnonzero(
            seen.u[:, 0] @ plate.view.centre > np.cos(plate.view.radius_rad + 0.3)
        )
        lines, truth = [], []
        for n in near:
            line = line_of(plate, self.true[n], rng)
            if line is not None and rng.random() < 0.8:
                lines.append(line)
                truth.append(self.true[n].norad_id)
        for _ in range(rng.poisson(0.3)):
            lines.append(strange_line(plate, rng))
            truth.append(0)
        started = time.perf_counter()
        candidates = self.catalogue.candidates(plate.view)
        found = match_field(plate.view, candidates, lines)
        self.asked_s.append(time.perf_counter() - started)
        low = {self.true[n].norad_id for n in np.flatnonzero(is_low)}
        counted: Counter[str] = Counter()
        for matched, number, line in zip(found.lines, truth, lines, strict=True):
            ends = ("crossing", "clipped", "streak")[line.is_end_a + line.is_end_b]
            kind = "no catalogue" if number == 0 else f"{'low' if number in low else 'high'} {ends}"
            best = matched.choices[0].candidate
            name = 0 if best is None else candidates[best].entry.norad_id
            word = matched.verdict
            if matched.verdict != "ambiguous":
                word = "right" if name == number else "wrong"
                if word == "wrong" and name == 0:
                    word = "called unknown"
            else:
                among = [
                    0 if c.candidate is None else candidates[c.candidate].entry.norad_id
                    for c in matched.choices
                ]
                word = "ambiguous" if number in among else "ambiguous, not among them"
            counted[f"{kind}: {word}"] += 1
        counted["candidates"] += len(candidates)
        counted["lines"] += len(lines)
        return counted


def main() -> None:
    """Fields over, the counts."""
    fields = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    count = int(sys.argv[2]) if len(sys.argv) > 2 else COUNT
    started = time.perf_counter()
    many = Fields(replicated(count, 1), 2)
    print(f"{count} objects made in {time.perf_counter() - started:.1f} s")
    total: Counter[str] = Counter()
    for _ in range(fields):
        total += many.run()
    for word in sorted(total):
        print(f"{total[word]:6d} {word}")
    asked = np.array(many.asked_s)
    print(
        f"{fields} frames: first {asked[0]:.2f} s, median {np.median(asked):.2f} s,"
        f" slowest {asked.max():.2f} s"
    )


if __name__ == "__main__":
    main()
