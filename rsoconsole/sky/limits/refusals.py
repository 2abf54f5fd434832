"""Refusals by a limit: which limit, the measured figure and its bound, and the reason."""

from dataclasses import dataclass
from typing import Literal

from rsoconsole.records import SlewRefusal, SlewRefusalKind
from rsoconsole.words import text

AngleLimit = Literal["altitude", "horizon", "hour angle", "pier", "Sun", "twilight"]
LimitName = Literal[
    "direction", "time", "altitude", "horizon", "hour angle", "pier", "Sun", "twilight"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Refusal of a slew, a pose or a motion by one limit."""

    limit: LimitName
    value_deg: float | None
    """Measured angle, deg; None for limits that are not angles (direction, time)."""
    bound_deg: float | None
    reason: SlewRefusal
    """Recorded reason; its figures are those in the message."""

    @property
    def text(self) -> str:
        """Message for the operator, with the figure and the excess."""
        return text(self.reason)


def beyond_bound_refusal(limit: AngleLimit, value_deg: float, bound_deg: float) -> Refusal:
    """Return the refusal of an angle that is beyond its bound now."""
    reason = SlewRefusal.beyond(limit, value_deg, bound_deg)
    return Refusal(limit=limit, value_deg=value_deg, bound_deg=bound_deg, reason=reason)


def sun_passage_refusal(from_sun_deg: float, kept_deg: float, *, is_way_out: bool) -> Refusal:
    """Return the refusal of a slew whose path comes too near to the Sun.

    ``kept_deg``: distance to keep from the Sun. ``is_way_out``: the path begins inside its cone.
    """
    kind: SlewRefusalKind = "nearer to the Sun" if is_way_out else "past the Sun"
    reason = SlewRefusal.beyond(kind, from_sun_deg, kept_deg)
    return Refusal(limit="Sun", value_deg=from_sun_deg, bound_deg=kept_deg, reason=reason)


def polar_axis_refusal(past_deg: float, bound_deg: float) -> Refusal:
    """Return the refusal of a polar axis that raises its counterweight too far."""
    reason = SlewRefusal.beyond("polar axis", past_deg, bound_deg)
    return Refusal(limit="pier", value_deg=past_deg, bound_deg=bound_deg, reason=reason)


def invalid_direction_refusal(ra_icrs_deg: float, dec_icrs_deg: float) -> Refusal:
    """Return the refusal of a direction that is not finite or out of range."""
    said = f"RA {ra_icrs_deg} Dec {dec_icrs_deg}"
    reason = SlewRefusal(kind="direction", detail=said)
    return Refusal(limit="direction", value_deg=None, bound_deg=None, reason=reason)


def instant_refusal(reason: SlewRefusal) -> Refusal:
    """Return the refusal of an invalid instant, with the reason given."""
    return Refusal(limit="time", value_deg=None, bound_deg=None, reason=reason)
