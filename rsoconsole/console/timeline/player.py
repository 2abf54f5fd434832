"""Plays a recorded night: which of its moments is due. Pure; the clock is an argument."""

from dataclasses import dataclass

from rsoconsole.console.timeline.night_line import Timeline

SPEEDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1000.0)
"""Paces of replay, as factors on the night's own."""
GAP_CADENCES = 10.0
"""A gap between frames longer than this many times the usual one is skipped."""


def speed_words(speed: float) -> str:
    """×30 or ×0.5."""
    return f"×{speed:g}"


@dataclass(slots=True)
class Player:
    """How fast, whether at all, and the frame clock of what is shown."""

    speed: float = SPEEDS[0]
    is_playing: bool = False
    _t_utc_ns: float = 0.0

    def settle(self, timeline: Timeline) -> None:
        """About a frame a second."""
        cadence_s = timeline.cadence_s()
        self.speed = min(SPEEDS, key=lambda speed: abs(speed - cadence_s))

    def change(self, by: int) -> None:
        """One step slower or faster."""
        at = SPEEDS.index(self.speed) + by
        self.speed = SPEEDS[min(max(at, 0), len(SPEEDS) - 1)]

    def begin(self, timeline: Timeline, seq: int) -> None:
        """Play from there on."""
        self.is_playing = True
        self._t_utc_ns = float(timeline.time_of(seq) or 0)

    def after(self, timeline: Timeline, seq: int, by_s: float) -> int:
        """The moment that is due when it has played for so long since the last call.

        At the end of a night that is over it stops; one that goes on is waited for.
        """
        following = timeline.step(seq, 1)
        if following is None or following == seq:
            self.is_playing = not timeline.is_closed and following is not None
            return seq
        ahead_ns = (timeline.time_of(following) or 0) - self._t_utc_ns
        self._t_utc_ns += by_s * self.speed * 1e9
        if ahead_ns > GAP_CADENCES * timeline.cadence_s() * 1e9:
            self._t_utc_ns = float(timeline.time_of(following) or 0)
        due = timeline.at_time(round(self._t_utc_ns))
        return seq if due is None else max(due, seq)
