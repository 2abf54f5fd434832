"""Observations of any file as rows: an instant, a direction, its errors, of what and from where."""

from dataclasses import dataclass

from rsoconsole.records import Site


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedRow:
    """One direction: astrometric, ICRS."""

    where: str
    """File and line, for people."""
    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    sigma_ra_arcsec: float | None = None
    """On the sky. None: the file states none."""
    sigma_dec_arcsec: float | None = None
    correlation: float = 0.0
    time_sigma_s: float | None = None
    """Beside the direction's own error; None where that is in it."""
    target: str | None = None
    """What the file calls the object; None where it names none."""
    station: str | None = None
    """What the file calls the station."""
    site: Site | None = None
    """Where it stands, where the file says so."""
    is_degrees: bool = False
    """Whether the form that it was written in leaves no doubt about the unit."""
