"""Whether a frame's own time can be believed: the camera's clock against this machine's.

A camera may stand on another machine, and its driver writes the time into the frame. How far the
two are apart is the camera's own affair; that it changes between two frames is not.
"""

import statistics
from collections import deque
from dataclasses import dataclass

REMEMBERED = 10
KNOWN_FROM = 5
"""Frames that are enough to tell what is usual."""
UNKNOWN_S = 10.0
"""Until then no frame is off that differs by less."""
LEAST_S = 0.5
SPREADS = 2.0
"""Limit of an error of time, in units of the scatter of the frames before."""
AGREED = 3
"""Frames in a row that agree on a step: then the clock was set, and no frame errs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTime:
    """What is to be made of one frame's time."""

    is_believed: bool
    off_s: float
    """From where the frames before lead one to expect it."""
    is_set: bool = False
    """The camera's clock was set by so much: what was measured before has another time."""


class FrameTimes:
    """Remembers how far the two clocks were apart in the last frames."""

    def __init__(self) -> None:
        self._usual: deque[float] = deque(maxlen=REMEMBERED)
        self._off: list[float] = []
        """Of the last frames, those that were not believed."""

    def forget(self) -> None:
        """This machine's own clock was set."""
        self._usual.clear()
        self._off.clear()

    def judge(self, t_start_utc_ns: int, opened_utc_ns: int) -> FrameTime:
        """``t_start_utc_ns`` as the frame says, ``opened_utc_ns`` as this machine's clock says."""
        apart_s = (t_start_utc_ns - opened_utc_ns) / 1e9
        if not self._usual:
            self._usual.append(apart_s)
            return FrameTime(is_believed=True, off_s=0.0)
        off_s = apart_s - statistics.median(self._usual)
        if abs(off_s) <= self._allowed_s():
            self._usual.append(apart_s)
            self._off.clear()
            return FrameTime(is_believed=True, off_s=off_s)
        if self._off and abs(apart_s - self._off[-1]) > LEAST_S:
            self._off.clear()
        self._off.append(apart_s)
        if len(self._off) < AGREED:
            return FrameTime(is_believed=False, off_s=off_s)
        agreed = list(self._off)
        self.forget()
        self._usual.extend(agreed)
        return FrameTime(is_believed=False, off_s=off_s, is_set=True)

    def _allowed_s(self) -> float:
        if len(self._usual) < KNOWN_FROM:
            return UNKNOWN_S
        return max(LEAST_S, SPREADS * (max(self._usual) - min(self._usual)))
