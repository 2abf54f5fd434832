"""Where a move would lead and what stands against it, in lines."""

from rsoconsole.control import MovePreview
from rsoconsole.words import altaz, direction, span

UNREADABLE = "the engine's answer cannot be read: are both of one version?"


def preview_lines(preview: MovePreview | None, ending: str = "") -> list[str]:
    """The engine's preview of a move; ``ending``: what comes last where it may be made."""
    if preview is None:
        return [UNREADABLE]
    after = preview.pier_side_after
    side = f", to the {after} of the pier" if after and after != preview.pier_side else ""
    margins = "  ".join(f"{name} {value:+.0f}°" for name, value in preview.margins_deg)
    of_date = direction(preview.ra_date_deg, preview.dec_date_deg)
    rows = (
        ("ICRS", direction(preview.ra_icrs_deg, preview.dec_icrs_deg)),
        ("of date", f"{of_date}   {altaz(preview.alt_deg, preview.az_deg)}"),
        ("way", f"{preview.way_deg:.1f}°, {span(preview.slew_s)}{side}"),
        ("limits", margins),
        ("REFUSED", preview.refused),
    )
    lines = [f"{label:<8} {words}" for label, words in rows if words]
    return [*lines, ending] if ending and not preview.refused else lines
