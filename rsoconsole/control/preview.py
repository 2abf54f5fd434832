"""The answer to a preview: where a move would lead, and what stands against it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MovePreview:
    """A move that has not been made."""

    ra_icrs_deg: float
    """Where the telescope would look."""
    dec_icrs_deg: float
    ra_date_deg: float
    """The same, equinox of date."""
    dec_date_deg: float
    alt_deg: float
    az_deg: float
    way_deg: float
    """How far that is from where it looks."""
    slew_s: float
    """How long the slew takes, settling included."""
    pier_side: str | None = None
    pier_side_after: str | None = None
    margins_deg: tuple[tuple[str, float], ...] = ()
    """Limit and how far inside it the telescope would be."""
    refused: str | None = None
    """Why it may not go there; None where it may."""
