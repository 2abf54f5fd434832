"""What the report says of low satellites that were followed by leaps: each pass, and its leaps."""

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rsoconsole.records import LeapDone, LowPass, Record

PARTS = ("slew_s", "settle_s", "shutter_s", "open_s", "readout_s", "wait_s")
"""Of a leap's time, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassFacts:
    """One pass, with what came of its leaps."""

    over: LowPass
    leaps: int
    """Ordered."""
    met: int
    at_close: int
    """Ordered as the shutter of the one before closed."""
    unmet: str
    """What came of the others, counted: ``2 another streak, 1 not solved``."""
    total_s: float | None
    """Median from order to order; None where none was over."""
    parts_s: tuple[float, ...]
    """Medians, as ``PARTS`` has them."""
    along_arcsec: float | None
    """Median distance from the prediction along the way; None where none was met."""
    across_arcsec: float | None


def pass_facts(records: Iterable[Record]) -> tuple[PassFacts, ...]:
    """Every pass of a session's records, in order of time."""
    leaps: dict[int, list[LeapDone]] = {}
    passes: list[LowPass] = []
    for record in records:
        if isinstance(record, LeapDone):
            leaps.setdefault(record.begun_frame_id, []).append(record)
        elif isinstance(record, LowPass):
            passes.append(record)
    return tuple(_facts(each, leaps.get(each.begun_frame_id, [])) for each in passes)


def _facts(over: LowPass, leaps: Sequence[LeapDone]) -> PassFacts:
    met = [each for each in leaps if each.result == "met"]
    others = [each.result for each in leaps if each.result != "met"]
    counted = (f"{others.count(kind)} {kind}" for kind in dict.fromkeys(others))
    return PassFacts(
        over=over,
        leaps=len(leaps),
        met=len(met),
        at_close=sum(each.ordered == "at close" for each in leaps),
        unmet=", ".join(counted),
        total_s=_median([each.total_s for each in leaps]),
        parts_s=tuple(_median([getattr(each, part) for each in leaps]) or 0.0 for part in PARTS)
        if leaps
        else (),
        along_arcsec=_median(
            [abs(off) for each in met if (off := each.off_along_arcsec) is not None]
        ),
        across_arcsec=_median(
            [abs(off) for each in met if (off := each.off_across_arcsec) is not None]
        ),
    )


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None
