"""Pointing offset of the loop: solved centre minus commanded position, by pier side.

SYNC is never sent, since it can spoil a mount's own model; this small filter does its work instead.
A mount's errors depend on where its axes stand, so an offset belongs to a side of the pier and to
an hour angle and declination, of date; it is kept as east and north on the sky, because most of it
(collimation, polar axis, flexure) is a distance on the sky and not an angle of the polar axis.

How far an offset stays valid in the simulated mount (0.1 deg wrong in all, flip included):

- within 10 deg on one side it still fits to 1.1 arcmin, against 5.4 without an offset;
- 40 deg away it takes off only half of the error;
- on the other side it is worse than none (6.0 against 5.7).

Hence an offset is no longer used after a flip or a slew of more than 10 deg. It is remembered for
the return to the position where it was learnt: otherwise the first frame of each target in a
repeated list would be 5 arcmin off. The first frame after such a return replaces the offset, so
that an outdated one lasts one frame. Pure.
"""

from dataclasses import dataclass, replace
from math import cos, hypot, radians, sin
from typing import Literal

from rsoconsole.sky import direction_to_unit, position_angle_deg, separation_deg, unit_to_direction

GAIN = 0.5
JUMP_ARCSEC = 120.0
"""Change beyond the random error of a slew: the mount was synced or has slipped."""
CLIP_ARCSEC = 3600.0
LARGE_SLEW_DEG = 10.0
MAX_KEPT = 24

Side = Literal["east", "west"] | None
"""Side of the pier on which the telescope is; None where the mount does not report it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingOffset:
    """Pointing offset near one position of the axes: solved minus commanded."""

    east_arcsec: float = 0.0
    """Eastward offset on the sky: right ascension times cos dec."""
    north_arcsec: float = 0.0
    samples: int = 0
    """Number of frames in a row that have made it; 0 before any, and for one only remembered."""
    hour_angle_deg: float = 0.0
    """Hour angle of the last measurement, of date, west positive."""
    declination_deg: float = 0.0
    pier_side: Side = None


NO_OFFSET = PointingOffset()


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingModel:
    """Remembered pointing offsets by position of the axes, the newest first.

    Those on one side of the pier are more than ``LARGE_SLEW_DEG`` from each other.
    """

    offsets: tuple[PointingOffset, ...] = ()

    @property
    def last(self) -> PointingOffset:
        """Offset after the last solved frame; ``NO_OFFSET`` before the first."""
        return self.offsets[0] if self.offsets else NO_OFFSET

    def at(self, hour_angle_deg: float, declination_deg: float, pier_side: Side) -> PointingOffset:
        """Return the offset for a position of the axes; ``NO_OFFSET`` where none is known.

        Its ``samples`` is 0 where it was learnt before the telescope moved away and came back.
        """
        near = self._near(hour_angle_deg, declination_deg, pier_side)
        if not near:
            return NO_OFFSET
        return near[0] if near[0] is self.offsets[0] else replace(near[0], samples=0)

    def with_new_offset(self, offset: PointingOffset) -> "PointingModel":
        """Return the model with an offset just learnt, which replaces those near its position."""
        near = self._near(offset.hour_angle_deg, offset.declination_deg, offset.pier_side)
        others = tuple(each for each in self.offsets if each not in near)
        return PointingModel(offsets=(offset, *others)[:MAX_KEPT])

    def _near(
        self, hour_angle_deg: float, declination_deg: float, pier_side: Side
    ) -> list[PointingOffset]:
        """Offsets that hold there, the one learnt last before the others."""
        here = (hour_angle_deg, declination_deg)
        return [
            offset
            for offset in self.offsets
            if offset.pier_side == pier_side
            and separation_deg(offset.hour_angle_deg, offset.declination_deg, *here)
            <= LARGE_SLEW_DEG
        ]


def with_solved_frame(
    before: PointingModel,
    *,
    commanded_ra_deg: float,
    commanded_dec_deg: float,
    solved_ra_deg: float,
    solved_dec_deg: float,
    hour_angle_deg: float,
    declination_deg: float,
    pier_side: Side,
) -> PointingModel:
    """Return the model after one solved frame at a commanded position (both ICRS degrees).

    ``hour_angle_deg`` and ``declination_deg``: position of the axes, of date. The first frame after
    a flip, a large slew or a jump sets the offset; later ones are averaged into it, since part of
    every slew's error is random.
    """
    sky = (commanded_ra_deg, commanded_dec_deg, solved_ra_deg, solved_dec_deg)
    far_arcsec, angle = separation_deg(*sky) * 3600.0, radians(position_angle_deg(*sky))
    east, north = far_arcsec * sin(angle), far_arcsec * cos(angle)
    known = before.at(hour_angle_deg, declination_deg, pier_side)
    is_jump = hypot(east - known.east_arcsec, north - known.north_arcsec) > JUMP_ARCSEC
    is_first = known.samples == 0 or is_jump
    gain = 1.0 if is_first else GAIN
    after = PointingOffset(
        east_arcsec=_clipped(known.east_arcsec + gain * (east - known.east_arcsec)),
        north_arcsec=_clipped(known.north_arcsec + gain * (north - known.north_arcsec)),
        samples=1 if is_first else known.samples + 1,
        hour_angle_deg=hour_angle_deg,
        declination_deg=declination_deg,
        pier_side=pier_side,
    )
    return before.with_new_offset(after)


def pointing_command(
    offset: PointingOffset, ra_icrs_deg: float, dec_icrs_deg: float
) -> tuple[float, float]:
    """Command (RA, Dec in degrees) that makes the telescope look at an ICRS direction."""
    if offset.east_arcsec == 0.0 and offset.north_arcsec == 0.0:
        return ra_icrs_deg, dec_icrs_deg
    ra, dec = radians(ra_icrs_deg), radians(dec_icrs_deg)
    east, north = radians(offset.east_arcsec / 3600.0), radians(offset.north_arcsec / 3600.0)
    unit = direction_to_unit(ra_icrs_deg, dec_icrs_deg)
    unit = unit - east * direction_to_unit(ra_icrs_deg + 90.0, 0.0)
    unit[0] += north * sin(dec) * cos(ra)
    unit[1] += north * sin(dec) * sin(ra)
    unit[2] -= north * cos(dec)
    sent_ra_deg, sent_dec_deg = unit_to_direction(unit)
    return float(sent_ra_deg), float(sent_dec_deg)


def _clipped(arcsec: float) -> float:
    return min(max(arcsec, -CLIP_ARCSEC), CLIP_ARCSEC)
