"""How often every satellite of a slot gets its right name, together and each by itself.

Run: ``python -m tests.bench.bench_identify_jointly [NIGHTS]``. Truth is where a member's elements
put it by SGP4, plus an error, seen with 1 arcsec of noise: the elements are off as assumed of
undisturbed objects of that age, each by itself; as measured on three satellites that are kept in
their slots (``bench_element_errors``), each by itself; or by such a measured error that all share,
and by a quarter of the undisturbed variance each. In a third of the nights a member is not seen,
in a third one is not in the catalogue.
"""

import sys
import time
from collections import Counter
from collections.abc import Sequence

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    Identification,
    MeasuredDirections,
    covariance_rtn,
    identify_jointly,
    parse_element_sets,
)
from rsoconsole.orbits.identification.element_errors import UNDISTURBED
from rsoconsole.records import FloatArray, Site
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.bench.bench_element_errors import MEAN_MOTION_RAD_S, measured_errors
from tests.bench.bench_identify import TLES, seen_off_elements
from tests.makers import identify

SITE = Site(latitude_deg=45.0, longitude_deg=10.0, elevation_m=200.0)
SLOTS = {
    "Astra 19.2E": ("ASTRA 1KR", "ASTRA 1L", "ASTRA 1M", "ASTRA 1N"),
    "26E": ("BADR 4", "BADR-5", "BADR 6", "BADR 7", "ARABSAT 7B", "ES'HAIL 2", "ES'HAIL 1"),
    "Hot Bird 13E": ("HOTBIRD 13E", "HOT BIRD 13B", "HOT BIRD 13C", "HOTBIRD 13F", "HOTBIRD 13G"),
}
WORLDS = (
    ("undisturbed, 0.5 d", 0.5, None, False),
    ("undisturbed, 3 d", 3.0, None, False),
    ("kept in slots, 2 to 5 d", 3.0, (2, 5), False),
    ("kept in slots, shared, 2 to 5 d", 3.0, (2, 5), True),
    ("kept in slots, 5 to 9 d", 7.0, (5, 9), False),
    ("kept in slots, shared, 5 to 9 d", 7.0, (5, 9), True),
)


def members_of(entries: Sequence[CatalogueEntry], names: Sequence[str]) -> list[CatalogueEntry]:
    """Those whose names begin so, or hold it in brackets."""
    return [each for each in entries if any(name in each.name for name in names)]


def errors_of(
    members: Sequence[CatalogueEntry],
    age_days: float,
    measured: FloatArray | None,
    *,
    is_shared: bool,
    random: np.random.Generator,
) -> list[FloatArray]:
    """(6,) of each."""
    spread = covariance_rtn(UNDISTURBED["GEO"], age_days, MEAN_MOTION_RAD_S)
    own = random.multivariate_normal(np.zeros(6), spread, len(members), method="eigh")
    if measured is None:
        return list(own)
    if is_shared:
        return list(random.choice(measured) + own / 2.0)
    return list(random.choice(measured, len(members)))


def night(
    members: Sequence[CatalogueEntry],
    age_days: float,
    measured: FloatArray | None,
    *,
    is_shared: bool,
    random: np.random.Generator,
) -> tuple[list[MeasuredDirections], list[int]]:
    """What is seen of each, in no order, and which it is."""
    epoch_ns = int(np.median([each.epoch_utc_ns for each in members]))
    start_ns = epoch_ns + round((age_days + random.uniform(-0.3, 0.3)) * NS_PER_DAY)
    count = int(random.choice([10, 20, 60]))
    t = start_ns + np.arange(count) * 30 * NS_PER_S
    errors = errors_of(members, age_days, measured, is_shared=is_shared, random=random)
    seen = [
        seen_off_elements(each, error, SITE, t, random.normal(0.0, 1.0, (count, 2)))
        for each, error in zip(members, errors, strict=True)
    ]
    order = random.permutation(len(members))
    if random.random() < 1.0 / 3.0:
        order = order[1:]
    return [seen[n] for n in order], [members[n].norad_id for n in order]


def answer(found: Identification, norad_id: int, *, is_known: bool) -> str:
    """In a word."""
    names = [m.norad_id for m in found.matches if m.probability > 0.05]
    if found.verdict == "identified":
        return "right" if is_known and names[:1] == [norad_id] else "wrong"
    if found.verdict == "unknown":
        return "unknown, wrong" if is_known else "right"
    if not is_known:
        return "ambiguous"
    return "ambiguous" if norad_id in names else "ambiguous, it not among them"


def main(nights: int = 100) -> None:
    """Print the answers by slot and kind of error."""
    entries = parse_element_sets(
        (TLES / "geo_all_20230622.tle").read_text(encoding="ascii")
    ).entries
    history, random = measured_errors(), np.random.default_rng(11)
    both: list[Counter[str]] = [Counter(), Counter()]
    twice, spent_s = [0, 0], [0.0, 0.0]
    for words, age, ages, is_shared in WORLDS:
        chosen = None
        if ages is not None:
            chosen = history[(history[:, 0] >= ages[0]) & (history[:, 0] < ages[1]), 1:]
        for slot, names in SLOTS.items():
            members = members_of(entries, names)
            counts: list[Counter[str]] = [Counter(), Counter()]
            for _ in range(nights):
                seen, true = night(members, age, chosen, is_shared=is_shared, random=random)
                known = list(entries)
                if random.random() < 1.0 / 3.0:
                    known = [each for each in entries if each.norad_id != true[0]]
                numbers = {each.norad_id for each in known}
                began = time.perf_counter()
                alone = [identify(each, SITE, known) for each in seen]
                middle = time.perf_counter()
                joint = identify_jointly(seen, SITE, known)
                spent_s[0] += middle - began
                spent_s[1] += time.perf_counter() - middle
                for n, found in enumerate((alone, joint)):
                    counts[n].update(
                        answer(one, number, is_known=number in numbers)
                        for one, number in zip(found, true, strict=True)
                    )
                    sure = [f.matches[0].norad_id for f in found if f.verdict == "identified"]
                    twice[n] += len(sure) != len(set(sure))
            for n, how in enumerate(("alone   ", "together")):
                both[n].update(counts[n])
                print(f"{words:32s} {slot:13s} ({len(members)}) {how} {_shares(counts[n])}")
    for n, how in enumerate(("alone", "together")):
        print(
            f"{how}: {_shares(both[n])}; {twice[n]} nights with one name twice; {spent_s[n]:.0f} s"
        )


def _shares(counts: Counter[str]) -> str:
    total = sum(counts.values())
    return ", ".join(f"{key} {100.0 * n / total:.1f} %" for key, n in sorted(counts.items()))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
