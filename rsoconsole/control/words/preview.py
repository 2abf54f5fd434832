"""Where a move would lead and what stands against it, in lines."""

from rsoconsole.control import MovePreview
from rsoconsole.sky import format_dec, format_ra
from rsoconsole.words import span

UNREADABLE = "the engine's answer cannot be read: are both of one version?"


def preview_lines(preview: MovePreview | None, ending: str = "") -> list[str]:
    """The engine's preview of a move; ``ending``: what comes last where it may be made."""
    if preview is None:
        return [UNREADABLE]
    after = preview.pier_side_after
    side = f", to the {after} of the pier" if after and after != preview.pier_side else ""
    margins = "  ".join(f"{name} {value:+.0f}°" for name, value in preview.margins_deg)
    of_date = f"α {format_ra(preview.ra_date_deg, 1)} δ {format_dec(preview.dec_date_deg, 0)}"
    rows = (
        ("ICRS", f"α {format_ra(preview.ra_icrs_deg, 1)} δ {format_dec(preview.dec_icrs_deg, 0)}"),
        ("of date", f"{of_date}   alt {preview.alt_deg:.1f} az {preview.az_deg:.1f}"),
        ("way", f"{preview.way_deg:.1f}°, {span(preview.slew_s)}{side}"),
        ("limits", margins),
        ("REFUSED", preview.refused),
    )
    lines = [f"{label:<8} {words}" for label, words in rows if words]
    return [*lines, ending] if ending and not preview.refused else lines
