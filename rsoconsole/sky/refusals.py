"""A limit that says no: which, the figure, the bound, and both in the operator's words."""

from dataclasses import dataclass
from typing import Literal

LimitName = Literal[
    "direction", "time", "altitude", "horizon", "hour angle", "pier", "Sun", "twilight"
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why the telescope must not go or stay there."""

    limit: LimitName
    value_deg: float | None
    """The figure; None where it is no angle (direction, time)."""
    bound_deg: float | None
    text: str
    """In the operator's words, with the figure and by how much."""


def beyond(
    limit: LimitName, value_deg: float, bound_deg: float, *, place: str = "", later_s: float = 0.0
) -> Refusal:
    """A figure beyond its bound; ``place`` says on which side of the pier or at which azimuth.

    later_s: how far ahead that will be.
    """
    value, bound, by = f"{value_deg:.1f}", f"{bound_deg:.1f}", by_how_much(value_deg, bound_deg)
    texts: dict[LimitName, str] = {
        "altitude": f"altitude {value} deg is {by} below the limit of {bound}",
        "horizon": f"altitude {value} deg is {by} below the horizon of {bound} {place}",
        "hour angle": f"hour angle {value} deg is {by} beyond the limit of {bound}",
        "pier": f"hour angle {value} deg {place} is {by} past the meridian's limit of {bound}",
        "Sun": f"{value} deg from the Sun is {by} inside its cone of {bound}",
        "twilight": f"the Sun at altitude {value} deg is {by} above the limit of {bound}",
    }
    ahead = f", {later_s:.0f} s from now" if later_s >= 1.0 else ""
    return Refusal(limit=limit, value_deg=value_deg, bound_deg=bound_deg, text=texts[limit] + ahead)


def sun_on_the_way(from_sun_deg: float, kept_deg: float, *, is_way_out: bool) -> Refusal:
    """The way of a slew passes the Sun too near."""
    value, bound = f"{from_sun_deg:.1f}", f"{kept_deg:.1f}"
    by = by_how_much(from_sun_deg, kept_deg)
    text = f"the way there passes {value} deg from the Sun, {by} inside its cone of {bound}"
    if is_way_out:
        text = f"the way there comes to {value} deg from the Sun, {by} nearer than {bound} before"
    return Refusal(limit="Sun", value_deg=from_sun_deg, bound_deg=kept_deg, text=text)


def axis_past_meridian(past_deg: float, bound_deg: float) -> Refusal:
    """The polar axis has turned its counterweight up too far."""
    by = by_how_much(past_deg, bound_deg)
    return Refusal(
        limit="pier",
        value_deg=past_deg,
        bound_deg=bound_deg,
        text=f"the polar axis stands {past_deg:.1f} deg past the meridian, {by} beyond the limit "
        f"of {bound_deg:.1f}",
    )


def no_direction(ra_icrs_deg: float, dec_icrs_deg: float) -> Refusal:
    """Not a number, or outside the circle."""
    text = f"RA {ra_icrs_deg} Dec {dec_icrs_deg} is no direction"
    return Refusal(limit="direction", value_deg=None, bound_deg=None, text=text)


def wrong_time(text: str) -> Refusal:
    """An instant that cannot be meant."""
    return Refusal(limit="time", value_deg=None, bound_deg=None, text=text)


def by_how_much(value_deg: float, bound_deg: float) -> str:
    """The distance from the bound, with as many digits as it takes to show it."""
    distance_deg = abs(value_deg - bound_deg)
    if distance_deg < 0.001:
        return "less than 0.001"
    return f"{distance_deg:.1f}" if distance_deg >= 0.1 else f"{distance_deg:.3f}"
