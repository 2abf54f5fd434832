"""The loop's own pointing offset: solved centre minus commanded position, by pier side.

SYNC is never sent, since it can spoil a mount's own model; this small filter does its work
instead. Pure.
"""

from dataclasses import dataclass
from math import cos, radians

from rsoconsole.sky.angles import separation_deg, wrap_360
from rsoconsole.tracking.association import motion_between

GAIN = 0.5
CLIP_ARCSEC = 3600.0
LARGE_SLEW_DEG = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingOffset:
    """How far the telescope looks beside where it was sent."""

    east_arcsec: float = 0.0
    north_arcsec: float = 0.0
    samples: int = 0
    ra_icrs_deg: float | None = None
    """Where it was last measured."""
    dec_icrs_deg: float | None = None
    pier_side: str | None = None


def observed(
    before: PointingOffset,
    *,
    commanded_ra_deg: float,
    commanded_dec_deg: float,
    solved_ra_deg: float,
    solved_dec_deg: float,
    pier_side: str | None,
) -> PointingOffset:
    """The offset after one solved frame at a commanded position (all ICRS degrees).

    The first sample after a pier flip or a large slew is taken whole; later ones are filtered,
    since part of every slew's error is random.
    """
    seen = motion_between(commanded_ra_deg, commanded_dec_deg, solved_ra_deg, solved_dec_deg)
    before = valid_at(before, commanded_ra_deg, commanded_dec_deg, pier_side)
    gain = 1.0 if before.samples == 0 else GAIN
    east = before.east_arcsec + gain * (seen.east_arcsec - before.east_arcsec)
    north = before.north_arcsec + gain * (seen.north_arcsec - before.north_arcsec)
    return PointingOffset(
        east_arcsec=min(max(east, -CLIP_ARCSEC), CLIP_ARCSEC),
        north_arcsec=min(max(north, -CLIP_ARCSEC), CLIP_ARCSEC),
        samples=before.samples + 1,
        ra_icrs_deg=commanded_ra_deg,
        dec_icrs_deg=commanded_dec_deg,
        pier_side=pier_side,
    )


def valid_at(
    offset: PointingOffset, ra_icrs_deg: float, dec_icrs_deg: float, pier_side: str | None
) -> PointingOffset:
    """The offset if it still holds there, else an empty one: a flip or a large slew voids it."""
    if offset.ra_icrs_deg is None or offset.dec_icrs_deg is None:
        return PointingOffset()
    moved_deg = separation_deg(offset.ra_icrs_deg, offset.dec_icrs_deg, ra_icrs_deg, dec_icrs_deg)
    if offset.pier_side != pier_side or moved_deg > LARGE_SLEW_DEG:
        return PointingOffset()
    return offset


def command_for(
    offset: PointingOffset, ra_icrs_deg: float, dec_icrs_deg: float
) -> tuple[float, float]:
    """Where to send the mount so that it looks at this ICRS direction."""
    dec = min(max(dec_icrs_deg - offset.north_arcsec / 3600.0, -90.0), 90.0)
    ra = ra_icrs_deg - offset.east_arcsec / 3600.0 / max(cos(radians(dec_icrs_deg)), 0.01)
    return float(wrap_360(ra)), dec
