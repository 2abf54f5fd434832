"""What a frame says of image and sky, wherever a night is shown: a line a fact.

A fact is a number of ``records.Detections`` with a public column (``records/column_texts.py``). By
its line here it is among the console's curves, in ``plot_quality`` of a notebook, in the report,
and beside each measurement in exported tables.
"""

from collections.abc import Iterable
from typing import NamedTuple

from rsoconsole.records import Detections


class FrameFact(NamedTuple):
    """One of them."""

    name: str
    """Of the field and its column."""
    label: str
    unit: str
    form: str
    """Of a figure."""


FRAME_FACTS = (
    FrameFact("star_fwhm_px", "FWHM", "px", ".1f"),
    FrameFact("background_adu", "background", "ADU", ".0f"),
    FrameFact("zero_point_mag", "transparency, zero point", "mag", ".2f"),
    FrameFact("star_count", "stars", "", ".0f"),
)
"""In the order in which they are shown."""


def facts_of(seen: Detections | None) -> dict[str, float | None]:
    """By name; None where the frame does not say."""
    return {each.name: getattr(seen, each.name, None) for each in FRAME_FACTS}


def span_text(fact: FrameFact, values: Iterable[float | None]) -> str:
    """The middle one of a night and the span of all; empty where no frame says it."""
    known = sorted(value for value in values if value is not None)
    if not known:
        return ""
    middle, low, high = (
        f"{each:{fact.form}}" for each in (known[len(known) // 2], known[0], known[-1])
    )
    return f"{middle} {fact.unit}".rstrip() + f" ({low} to {high})"
