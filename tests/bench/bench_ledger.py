"""How often a satellite that no catalogue has is recognised nights later, and others are for it.

Run: ``python -m tests.bench.bench_ledger``. Real histories: the three satellites of
``geo_3sats_history_2019_2025.tle``, moved by SGP4 with the element set nearest in time to each
night, so that their real manoeuvres lie in between. Others: all objects of
``geo_all_20230622.tle`` that stand 15 degrees high, each followed on a later night, against what
was kept of forty of them.
"""

import sys
from collections import Counter
from collections.abc import Sequence

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    EarlierTrack,
    MeasuredDirections,
    correlate_tracks,
    determine_orbit,
    mid_track_direction_and_rates,
    parse_element_sets,
)
from rsoconsole.orbits.identification.uncorrelated import track_log_density
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.bench.bench_identify import SITE, TLES, seen_off_elements, visible

GAPS_DAYS = (1, 2, 3, 7, 14, 30)
FORTY = 40


def seen_by_sgp4(
    entry: CatalogueEntry, start_ns: int, minutes: float, random: np.random.Generator
) -> MeasuredDirections:
    """A direction every 30 s with 1 arcsec of noise."""
    count = max(3, round(minutes * 2.0))
    t = start_ns + np.arange(count) * 30 * NS_PER_S
    return seen_off_elements(entry, np.zeros(6), SITE, t, random.normal(0.0, 1.0, (count, 2)))


def kept_of(number: int, seen: MeasuredDirections) -> EarlierTrack:
    """What the ledger keeps of a track."""
    t, ra, dec, rate, _ = mid_track_direction_and_rates(seen)
    orbit = determine_orbit(seen)
    has_orbit = orbit is not None and orbit.label in ("free", "constrained by prior")
    return EarlierTrack(
        number=number,
        site=SITE,
        t_utc_ns=t,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        rate_arcsec_s=rate,
        orbit=orbit if has_orbit else None,
        is_held=orbit is not None and orbit.prior == "slot",
    )


def histories(minutes: float, pairs: int, random: np.random.Generator) -> None:
    """The three satellites, a night and one so many days later."""
    text = (TLES / "geo_3sats_history_2019_2025.tle").read_text(encoding="ascii")
    entries = parse_element_sets(text).entries
    numbers = sorted({each.norad_id for each in entries})
    own = {
        n: sorted((e for e in entries if e.norad_id == n), key=lambda e: e.epoch_utc_ns)
        for n in numbers
    }
    for gap in GAPS_DAYS:
        counts: Counter[str] = Counter()
        for _ in range(pairs):
            at = int(random.choice([e.epoch_utc_ns for e in own[numbers[0]][3:-3]]))
            later = at + round((gap + random.uniform(-0.2, 0.2)) * NS_PER_DAY)
            before = [
                kept_of(n, seen_by_sgp4(_nearest(own[n], at), at, minutes, random)) for n in numbers
            ]
            tracks = [
                seen_by_sgp4(_nearest(own[n], later), later, minutes, random) for n in numbers
            ]
            for n, track in zip(numbers, tracks, strict=True):
                (found,) = correlate_tracks([track], SITE, before)
                known = [c for c, _ in found.candidates]
                if found.number == n:
                    counts["right"] += 1
                elif found.number is not None:
                    counts["wrong"] += 1
                else:
                    counts["unsure" if n in known else "none"] += 1
        total = sum(counts.values())
        print(f"{minutes:4.0f} min, {gap:3d} d: {dict(counts)} of {total}")


def others(minutes: float, gap_days: float, random: np.random.Generator) -> None:
    """All of the element file against forty of them."""
    entries = parse_element_sets(
        (TLES / "geo_all_20230622.tle").read_text(encoding="ascii")
    ).entries
    at = int(np.median([each.epoch_utc_ns for each in entries]))
    later = at + round(gap_days * NS_PER_DAY)
    up = {e.norad_id: e for e in visible(entries, at)}
    again = [e for e in visible(entries, later) if e.norad_id in up]
    chosen = random.choice(np.array(again, object), FORTY, replace=False)
    before = [kept_of(e.norad_id, seen_by_sgp4(e, at, minutes, random)) for e in chosen]
    numbers = {each.number for each in before}
    tally: Counter[str] = Counter()
    pairs = inside = 0
    for each in again:
        track = seen_by_sgp4(each, later, minutes, random)
        (found,) = correlate_tracks([track], SITE, before)
        if each.norad_id in numbers:
            tally["kept: right" if found.number == each.norad_id else "kept: not right"] += 1
            tally["kept: wrong"] += found.number not in (None, each.norad_id)
        else:
            tally["others"] += 1
            tally["others: taken for one"] += found.number is not None
            tally["others: perhaps one"] += found.number is None and bool(found.candidates)
            pairs += len(before)
            inside += sum(track_log_density(one, track, SITE) is not None for one in before)
    weak = sum(each.orbit is None for each in before)
    print(
        f"{minutes:4.0f} min, {gap_days:g} d: {dict(tally)}; of {pairs} pairs {inside} within the"
        f" gate; {weak} of {FORTY} kept without an orbit"
    )


def _nearest(entries: Sequence[CatalogueEntry], t_utc_ns: int) -> CatalogueEntry:
    return min(entries, key=lambda each: abs(each.epoch_utc_ns - t_utc_ns))


def main(pairs: int = 30) -> None:
    """Print both."""
    random = np.random.default_rng(3)
    for minutes in (5.0, 20.0, 60.0):
        histories(minutes, pairs, random)
    for minutes in (5.0, 20.0):
        for gap in (1.0, 3.0, 14.0):
            others(minutes, gap, random)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
