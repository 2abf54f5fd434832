"""Moments as people type them: a frame's number, or a UTC time."""

import re
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day

from rsoconsole.console.timeline.night_line import Timeline
from rsoconsole.console.words import NS_PER_S, clock_text

EXAMPLES = "128, 03:14, 03:14:22 or 2024-03-01T03:14"
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d?):(\d\d)(?::(\d\d))?Z?", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Typed:
    """What was meant: a frame's number, or a time of day with or without its date, UTC."""

    frame_id: int | None = None
    clock: time_of_day | None = None
    day: date | None = None


def understood(text: str) -> Typed:
    """What was typed. Raises ValueError in words for what is neither."""
    plain = text.strip()
    if plain.isdecimal():
        return Typed(frame_id=int(plain))
    found = _CLOCK.fullmatch(plain)
    if found is not None:
        day, hour, minute, second = found.groups()
        try:
            return Typed(
                clock=time_of_day(int(hour), int(minute), int(second or 0)),
                day=date.fromisoformat(day) if day else None,
            )
        except ValueError as error:
            raise ValueError(f"{plain!r} is no time: {error}") from error
    raise ValueError(f"{plain!r} is no frame and no UTC time: {EXAMPLES}")


def seq_of(typed: Typed, timeline: Timeline) -> int:
    """The moment that was meant: that frame's end, or what was newest then.

    Raises ValueError in words where the night has none.
    """
    if not timeline.frames:
        raise ValueError("the session has no frames")
    if typed.frame_id is not None:
        for index, mark in enumerate(timeline.frames):
            if mark.frame_id == typed.frame_id:
                return timeline.end_of(index)
        first, last = timeline.frames[0].frame_id, timeline.frames[-1].frame_id
        raise ValueError(f"there is no frame {typed.frame_id}: frames are {first} to {last}")
    t_utc_ns = _instant(typed, timeline)
    seq = None if t_utc_ns is None else timeline.at_time(t_utc_ns)
    if seq is None:
        first_utc_ns, last_utc_ns = timeline.first_utc_ns, timeline.last_utc_ns
        raise ValueError(
            f"the session goes from {clock_text(first_utc_ns)} to {clock_text(last_utc_ns)}"
        )
    return seq


def _instant(typed: Typed, timeline: Timeline) -> int | None:
    """That time within the session; None where it has none. A minute that has begun counts."""
    first, last = timeline.first_utc_ns, timeline.last_utc_ns
    if first is None or last is None or typed.clock is None:
        return None
    begun = datetime.fromtimestamp(first // NS_PER_S, tz=UTC).date()
    ended = datetime.fromtimestamp(last // NS_PER_S, tz=UTC).date()
    days = [begun + timedelta(days=n) for n in range((ended - begun).days + 1)]
    for day in days if typed.day is None else [typed.day]:
        instant = datetime.combine(day, typed.clock, tzinfo=UTC)
        t_utc_ns = int(instant.timestamp()) * NS_PER_S
        if first - 60 * NS_PER_S <= t_utc_ns <= last + 60 * NS_PER_S:
            return t_utc_ns
    return None
