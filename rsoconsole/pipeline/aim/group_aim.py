"""Aim point when several satellites are tracked: policy ``aim.policy``. Pure.

``lead`` aims at the lead alone. ``most`` puts the largest weighted number of tracks in the usable
field. ``group`` puts all of them in it as long as they fit, else as many as fit with the lead. The
usable field is the largest circle inside the field, so that the camera's rotation does not matter;
a track counts where its streak and its 3-sigma bounds are inside, too.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, TrackState
from rsoconsole.sky import separation_deg
from rsoconsole.tracking import (
    TangentPlane,
    direction_icrs_deg,
    predict,
    sky_rate_arcsec_s,
    three_sigma_deg,
)

Policy: TypeAlias = Literal["lead", "most", "group"]
LEAD_WEIGHT = 1.5
"""Weight of the lead: of two fields with equally many tracks, the one with the lead is chosen."""
TRIAL_WEIGHT = 0.5
"""Weight of a track detected only twice, which may consist of two false streaks."""
UNSEEN_SHARE = 0.7
"""Factor on a track's weight for each frame in a row in which it is missed."""
_USABLE_SHARE = 0.95
"""Usable share of the circle that fits into the field; the rest allows for the mount's errors."""
_FARTHEST_DEG = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupMember:
    """Track at the middle of the next exposure, on the plane tangent to the sky at the lead."""

    x: float
    """Coordinate on that plane, degrees, as ``y``."""
    y: float
    reach_deg: float
    """Radius around its position that its streak and its 3-sigma bounds need, degrees."""
    weight: float


def group_direction(
    tracks: Sequence[TrackState],
    lead_deg: tuple[float, float],
    t_mid_utc_ns: int,
    policy: Policy,
    *,
    field_deg: tuple[float, float],
    exposure_s: float,
    settings: FilterConfig,
) -> tuple[tuple[float, float], int]:
    """Return the aim point (ICRS, degrees) and the number of tracks in the field around it.

    Both are for the instant ``t_mid_utc_ns``. ``tracks``: the lead first; ``lead_deg``: the lead's
    direction at that instant (ICRS).
    """
    plane = TangentPlane.at(*lead_deg)
    members = _members(tracks, plane, t_mid_utc_ns, exposure_s, settings)
    radius_deg = _USABLE_SHARE * min(field_deg) / 2.0
    if policy == "lead" or len(members) < 2:
        centre = np.zeros(2)
    else:
        centre = best_centre(members, radius_deg, policy)
    inside = sum(_holds(centre, member, radius_deg) for member in members)
    return plane.direction_of(*(3600.0 * centre)), inside


def tracks_inside(
    tracks: Sequence[TrackState],
    lead_deg: tuple[float, float],
    centre_deg: tuple[float, float],
    t_mid_utc_ns: int,
    *,
    field_deg: tuple[float, float],
    exposure_s: float,
    settings: FilterConfig,
) -> tuple[bool, ...]:
    """Return for each track whether it is in the field around ``centre_deg``.

    The instant is ``t_mid_utc_ns``. ``tracks``: the lead first; ``lead_deg``: the lead's direction
    at that instant. Directions are ICRS.
    """
    plane = TangentPlane.at(*lead_deg)
    centre = plane.project_arcsec(*centre_deg) / 3600.0
    radius_deg = _USABLE_SHARE * min(field_deg) / 2.0
    inside = []
    for track in tracks:
        # The lead is the first of them; one that is far away is none of them.
        found = _members([tracks[0], track], plane, t_mid_utc_ns, exposure_s, settings)
        at = 0 if track is tracks[0] else 1
        inside.append(at < len(found) and _holds(centre, found[at], radius_deg))
    return tuple(inside)


def best_centre(members: Sequence[GroupMember], radius_deg: float, policy: Policy) -> FloatArray:
    """Best centre (2,), in degrees on the tangent plane, of a circle with ``radius_deg``.

    ``members``: the lead first.
    """
    fitting = [each for each in members if each.reach_deg < radius_deg]
    lead = members[0]
    if not fitting:
        return np.array([lead.x, lead.y])
    if policy == "group":
        centre, needed_deg = _enclosing(fitting)
        if needed_deg <= radius_deg:
            return centre
        # It does not fit: what is led by stays in the field.
        fitting = [each for each in fitting if _can_be_with(each, lead, radius_deg)]
    candidates = _candidates(fitting, radius_deg)
    if policy == "group":
        candidates = [each for each in candidates if _holds(each, lead, radius_deg)]
    candidates.append(np.array([lead.x, lead.y]))

    def worth(centre: FloatArray) -> tuple[float, float]:
        held = sum(m.weight for m in fitting if _holds(centre, m, radius_deg))
        return round(held, 6), -float(np.hypot(centre[0] - lead.x, centre[1] - lead.y))

    best = max(candidates, key=worth)
    held = [each for each in fitting if _holds(best, each, radius_deg)]
    # In the middle of what it has: none of them at the edge.
    return _enclosing(held)[0] if held else best


def _members(
    tracks: Sequence[TrackState],
    plane: TangentPlane,
    t_mid_utc_ns: int,
    exposure_s: float,
    settings: FilterConfig,
) -> list[GroupMember]:
    found = []
    for number, track in enumerate(tracks):
        ahead = predict(track, t_mid_utc_ns, settings, track.frame_id)
        at = direction_icrs_deg(ahead)
        if number and separation_deg(*plane.direction_deg, *at) > _FARTHEST_DEG:
            continue
        x, y = plane.project_arcsec(*at) / 3600.0 if number else (0.0, 0.0)
        streak_deg = exposure_s * math.hypot(*sky_rate_arcsec_s(ahead)) / 3600.0
        weight = LEAD_WEIGHT if number == 0 else 1.0 if track.innovations else TRIAL_WEIGHT
        found.append(
            GroupMember(
                x=float(x),
                y=float(y),
                reach_deg=streak_deg / 2.0 + three_sigma_deg(ahead),
                weight=weight * UNSEEN_SHARE**track.misses,
            )
        )
    return found


def _holds(centre: FloatArray, member: GroupMember, radius_deg: float) -> bool:
    away = math.hypot(member.x - centre[0], member.y - centre[1])
    return away + member.reach_deg <= radius_deg + 1e-9


def _can_be_with(member: GroupMember, lead: GroupMember, radius_deg: float) -> bool:
    away = math.hypot(member.x - lead.x, member.y - lead.y)
    return away + member.reach_deg + lead.reach_deg <= 2.0 * radius_deg + 1e-9


def _candidates(members: Sequence[GroupMember], radius_deg: float) -> list[FloatArray]:
    """Candidate centres: some best circle has two members at its edge, or one at its centre.

    A member's place may be away from the centre by the radius less its reach.
    """
    found = [np.array([each.x, each.y]) for each in members]
    for one, other in itertools.combinations(members, 2):
        found += _crossings(one, other, radius_deg)
    return found


def _crossings(one: GroupMember, other: GroupMember, radius_deg: float) -> list[FloatArray]:
    """Return the points where two circles of allowed centres cross."""
    a, b = radius_deg - one.reach_deg, radius_deg - other.reach_deg
    way = np.array([other.x - one.x, other.y - one.y])
    length = float(np.hypot(*way))
    if not abs(a - b) < length <= a + b:
        return []
    along = (a * a - b * b + length * length) / (2.0 * length)
    across = math.sqrt(max(a * a - along * along, 0.0))
    unit = way / length
    foot = np.array([one.x, one.y]) + along * unit
    normal = np.array([-unit[1], unit[0]])
    return [foot + across * normal, foot - across * normal]


def _enclosing(members: Sequence[GroupMember]) -> tuple[FloatArray, float]:
    """Centre and radius of about the smallest circle that holds all members with their reach.

    By Badoiu and Clarkson's steps towards the farthest (2003): within a hundredth.
    """
    places = np.array([(each.x, each.y) for each in members])
    reach = np.array([each.reach_deg for each in members])
    centre = places.mean(axis=0)
    for step in range(1, 200):
        needed = np.hypot(*(places - centre).T) + reach
        farthest = int(np.argmax(needed))
        way = places[farthest] - centre
        length = float(np.hypot(*way))
        if length > 0.0:
            centre = centre + way / (step + 1.0)
    return centre, float(np.max(np.hypot(*(places - centre).T) + reach))
