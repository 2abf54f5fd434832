"""What the records of leaps add up to. Pure."""

import statistics
from collections.abc import Sequence
from typing import Any

from rsoconsole.records import LeapDone, LowPass

_PARTS = ("total", "slew", "settle", "shutter", "open", "readout", "wait")
_ON_RECORD = (
    *("streaks", "ended", "a_km", "e", "i_deg", "across_rms_arcsec"),
    *("t_next_rise_utc_ns", "sigma_next_s", "scatter_s"),
)
"""What is said of a pass as the record has it."""


def leap_figures(leaps: Sequence[LeapDone], passes: Sequence[LowPass]) -> dict[str, Any] | None:
    """Leaps met of those done, what one took (medians, s), and each pass; None without any."""
    if not leaps and not passes:
        return None
    met = [each for each in leaps if each.result == "met"]
    took = {
        part: round(statistics.median(getattr(each, f"{part}_s") for each in leaps), 3)
        for part in _PARTS
        if leaps
    }
    beside = [each.total_s - each.slew_s - each.settle_s for each in leaps]
    return {
        "leaps": len(leaps),
        "met": len(met),
        "ordered_at_close": sum(each.ordered == "at close" for each in leaps),
        "took_s": took,
        "beside_slew_and_settle_s": round(statistics.median(beside), 3) if beside else None,
        "passes": [_of_pass(each, met) for each in passes],
    }


def _of_pass(each: LowPass, met: Sequence[LeapDone]) -> dict[str, Any]:
    return {
        "name": each.name or None,
        "planned_leaps": each.planned_leaps,
        "leaps_met": sum(leap.begun_frame_id == each.begun_frame_id for leap in met),
        **{name: getattr(each, name) for name in _ON_RECORD},
    }
