"""What follows an ABORT until the mount is measured to be at rest: a rule without I/O."""

from dataclasses import dataclass

from rsoconsole.instruments.motion import Motion

MOVES_AFTER_S = 4.5
"""Before that a motion that goes on may be the way that a mount needs to stop."""
BRAKES_FOR_S = 2.5
"""A mount slows down for so long: reports of then show no motion of now."""
UNKNOWN_AFTER_S = 10.0
REPEAT_S = 1.0
REPEATS_FOR_S = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StopStep:
    """What is to be done and told now."""

    sends_abort: bool = False
    news: Motion | None = None
    """Told when its kind has changed."""
    is_over: bool = False
    """At rest, or ABORT has been repeated long enough: the alarm stays."""


class StopMeasure:
    """One STOP from its first ABORT on; ABORT is repeated while the mount is measured to move, or
    while its driver has not answered and nothing is known."""

    def __init__(self, began_s: float) -> None:
        self.began_s = began_s
        self._aborted_s = began_s
        self._last: Motion | None = None
        self.is_over = False

    def step(self, now_s: float, motion: Motion, *, is_answered: bool) -> StopStep:
        """One look; ``is_answered``: the driver has taken ABORT."""
        since_s = now_s - self.began_s
        is_braking = motion.kind == "moves" and motion.host_since_s < self.began_s + BRAKES_FOR_S
        news = self._news(since_s, Motion() if is_braking else motion)
        if news is not None:
            self._last = news
        self.is_over = motion.is_at_rest or since_s >= REPEATS_FOR_S
        must_repeat = motion.kind == "moves" or (motion.kind == "unknown" and not is_answered)
        sends = must_repeat and not self.is_over and now_s - self._aborted_s >= REPEAT_S
        if sends:
            self._aborted_s = now_s
        return StopStep(sends_abort=sends, news=news, is_over=self.is_over)

    def _news(self, since_s: float, motion: Motion) -> Motion | None:
        last = None if self._last is None else self._last.kind
        if motion.kind == last:
            return None
        if motion.kind == "moves" and since_s < MOVES_AFTER_S:
            return None
        # Once it was seen to move, a moment of doubt is no news.
        if motion.kind == "unknown" and (since_s < UNKNOWN_AFTER_S or last is not None):
            return None
        return motion
