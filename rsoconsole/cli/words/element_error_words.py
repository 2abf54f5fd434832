"""Errors of element sets and their source, in lines of at most 80 columns for people."""

import itertools
import math
import textwrap
from collections.abc import Collection, Iterator, Sequence
from typing import Any

from rsoconsole.cli.words import output
from rsoconsole.config import CatalogueConfig
from rsoconsole.night import rms
from rsoconsole.orbits import ElementErrorRow, FittedFactors
from rsoconsole.words import angle, count_words, join_words

AGES_DAYS = (0.0, 1.0, 3.0, 7.0, 14.0, 30.0, 60.0, math.inf)
KINDS = {
    "GEO": "geosynchronous orbits",
    "MEO": "medium orbits",
    "LEO": "low orbits",
    "HEO": "eccentric orbits",
}
_WIDTH = 78


def error_source_lines(errors: Sequence[dict[str, Any]], regimes: Collection[str]) -> Iterator[str]:
    """Yield lines on whether each regime's errors of elements are assumed or measured."""
    asked = [each for each in errors if each["regime"] in regimes]
    words = [_measured(each) for each in asked if each["source"] == "measured"]
    assumed = [KINDS[each["regime"]] for each in asked if each["source"] == "assumed"]
    if assumed:
        words.append(f"errors of {join_words(assumed)} as the literature has them, not measured")
    yield from textwrap.wrap("; ".join(words), _WIDTH, initial_indent="  ", subsequent_indent="  ")


def _measured(each: dict[str, Any]) -> str:
    words = (
        f"{count_words(each['tracks'], 'own track')} of {count_words(each['objects'], 'object')}"
    )
    return f"errors of {KINDS[each['regime']]} by {words}, to {each['oldest_days']:.0f} days"


def regime_report(
    fitted: FittedFactors, rows: Sequence[ElementErrorRow], catalogue: CatalogueConfig
) -> dict[str, Any]:
    """Report on one regime: its fitted factors, the factors in use, and errors by element age.

    ``rows``: all rows of the ledger of element errors.
    """
    own = [each for each in rows if each.regime == fitted.regime]
    in_use = [each for each in catalogue.error_factors if each.regime == fitted.regime]
    return {
        **output.with_unit_keys(fitted),
        "youngest_days": min(abs(each.age_days) for each in own),
        "in_use": in_use[0].model_dump(mode="json") if in_use else None,
        "ages": [
            _age_report(low, high, bin_rows)
            for low, high in itertools.pairwise(AGES_DAYS)
            if (bin_rows := [r for r in own if low <= abs(r.age_days) < high])
        ],
    }


def _age_report(low: float, high: float, rows: Sequence[ElementErrorRow]) -> dict[str, Any]:
    return {
        "from_days": low,
        "to_days": high if math.isfinite(high) else None,
        "tracks": len(rows),
        "objects": len({each.norad_id for each in rows}),
        "along_rms_s": rms([each.along_s for each in rows]),
        "along_rms_km": rms([each.along_km for each in rows]),
        "across_rms_arcsec": rms([each.across_arcsec for each in rows]),
        "across_rms_km": rms([each.across_km for each in rows]),
    }


def element_ledger_lines(report: dict[str, Any]) -> Iterator[str]:
    """Lines on the ledger of element errors: the nights read, then each regime."""
    for night in report["nights"]:
        yield (f"{night['night']}: {len(night['rows'])} of {night['tracks']} tracks surely named")
    for each in report["regimes"]:
        yield from _regime_lines(each)


def _regime_lines(each: dict[str, Any]) -> Iterator[str]:
    yield ""
    yield (
        f"{KINDS[each['regime']]}: {count_words(each['rows'], 'track')} of"
        f" {count_words(each['objects'], 'object')},"
        f" weighed as {each['counted']:.0f}; to {each['t_last_utc'][:10]}"
    )
    yield f"  {'age, days':>9} {'tracks':>7} {'objects':>8} {'along, rms':>20} {'across, rms':>20}"
    for one in each["ages"]:
        high = one["to_days"]
        age = f"{one['from_days']:.0f}+" if high is None else f"{one['from_days']:.0f}-{high:.0f}"
        along = f"{_short(one['along_rms_km'])} km {_short(one['along_rms_s'])} s"
        across = f"{_short(one['across_rms_km'])} km {angle(one['across_rms_arcsec'], 'cell')}"
        yield f"  {age:>9} {one['tracks']:>7} {one['objects']:>8} {along:>20} {across:>20}"
    used = each["in_use"]
    yield f"  times the assumed errors{'':14} measured{'':6} in use"
    for name, words in _FACTORS.items():
        value, sigma = each["factors"][name], each["sigmas"][name]
        now = 1.0 if used is None else used[name]
        yield f"    {words:34} {value:5.2f} ± {sigma:<5.2f} {now:7.2f}"


_FACTORS = {
    "along_at_epoch": "along the track, at the epoch",
    "along_by_age": "along the track, what grows by age",
    "across": "across the track",
}


def _short(value: float) -> str:
    return f"{value:.2f}" if value < 10.0 else f"{value:.0f}"
