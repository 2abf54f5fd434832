"""How long a mount is given to settle before a leap: in turns, by the width of the stars.

A mount that still swings draws its stars wider. Every second leap is given less time than is kept;
after some of each sort their stars are compared, leap beside leap, so that seeing, altitude and
wind fall on both alike, and less is kept where it costs no width. Small losses would add up unseen:
so by turns what is kept is held against the configured time, or more than that, and given back in
part where the stars are sharper there. A search up and down by comparisons (Kiefer & Wolfowitz
1952), whose flat parts are as good as each other.
"""

import math
import statistics
from dataclasses import dataclass, field

STEP = 0.8
"""Of the time that is kept: what a trial has."""
TURNS = 4
"""Leaps of each sort, before they are compared."""
AS_SHARP, SHARPER = 1.05, 0.94
"""Of the widths after a trial over those without: what is no worse, and what is better."""
SHORTEST_S, LONGEST = 0.3, 2.5
"""Kept at the least, and at the most in units of what is configured."""
_SURE_SIGMAS = 1.5
_MEDIAN = 1.25
"""Of the error of a mean is that of a median."""
_RESTS = 2
"""Comparisons for which there is no trial once neither less nor more is better."""


@dataclass(slots=True)
class SettleTrials:
    """Learns from leap to leap."""

    configured_s: float
    """What it begins with."""
    _factor: float = 1.0
    """Of the configured time, as it is kept."""
    _is_shorter: bool = True
    """Whether less is in trial; else more."""
    _next: tuple[float, bool] | None = None
    """What the next leap is given, and whether that is a trial: it is planned by it already."""
    _used: tuple[float, bool] | None = None
    """What the leap under way was given, and whether that was a trial."""
    _refused: int = 0
    """Trials in a row that were not kept."""
    _rests: int = 0
    _widths: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    """Of the stars, px, by whether the time was the one of a trial."""

    @property
    def seconds(self) -> float:
        """For the next leap."""
        return self.kept_s if self._next is None else self._next[0]

    @property
    def kept_s(self) -> float:
        """As learned until now."""
        return self.configured_s * self._factor

    @property
    def used_s(self) -> float:
        """What the leap under way was given."""
        return self.seconds if self._used is None else self._used[0]

    @property
    def _trial_s(self) -> float:
        """Less than is kept; or more: what is configured, and a step beyond where that is kept."""
        if self._is_shorter:
            return max(self.kept_s * STEP, min(SHORTEST_S, self.configured_s))
        return max(self._step_back_s, self.configured_s)

    @property
    def _step_back_s(self) -> float:
        return min(self.kept_s / STEP, LONGEST * self.configured_s)

    def begun(self) -> None:
        """A leap has had its time: the next one has its turn."""
        self._used = self._next or (self.kept_s, False)
        is_trial = not self._used[1] and self._rests == 0
        self._next = self._trial_s if is_trial else self.kept_s, is_trial

    def forget_widths(self) -> None:
        """Stars are as wide as before no more: the camera reads out in another mode."""
        self._widths = {False: [], True: []}
        self._used = None

    def seen(self, width_px: float | None) -> str | None:
        """How wide the stars of the leap under way were; None: nobody could tell.

        Words for the log where another time is kept from now on.
        """
        used, self._used = self._used, None
        if used is None or width_px is None or not math.isfinite(width_px) or width_px <= 0.0:
            return None
        if self._rests:
            self._rested(width_px)
            return None
        self._widths[used[1]].append(width_px)
        if min(map(len, self._widths.values())) < TURNS:
            return None
        return self._compared()

    def _rested(self, width_px: float) -> None:
        self._widths[False].append(width_px)
        if len(self._widths[False]) >= 2 * TURNS:
            self._rests -= 1
            self._widths = {False: [], True: []}

    def _compared(self) -> str | None:
        kept, trial = (statistics.median(self._widths[each]) for each in (False, True))
        ratio, error = trial / kept, self._error_of_ratio()
        self._widths = {False: [], True: []}
        before_s, trial_s = self.kept_s, self._trial_s
        was_shorter, self._is_shorter = self._is_shorter, not self._is_shorter
        after_s = before_s
        if was_shorter and ratio <= AS_SHARP:
            after_s = trial_s
        elif not was_shorter and ratio <= min(SHARPER, 1.0 - _SURE_SIGMAS * error):
            after_s = self._step_back_s
        if after_s == before_s:
            self._refused += 1
            # More is no better as a rule: only where less is not, either, is there nothing to gain.
            if was_shorter and self._refused >= 2:
                self._refused, self._rests = 0, _RESTS
            return None
        self._refused = 0
        self._factor = after_s / self.configured_s
        if was_shorter:
            than = f"stars are as sharp as after {before_s:.1f} s"
        else:
            than = f"stars are sharper after {trial_s:.1f} s than after {before_s:.1f} s"
        return f"the mount is given {after_s:.1f} s to settle: {than} ({trial:.1f}, {kept:.1f} px)"

    def _error_of_ratio(self) -> float:
        """One sigma of the ratio of both medians, by the scatter of the widths."""
        relative = [statistics.stdev(w) / statistics.mean(w) for w in self._widths.values()]
        return _MEDIAN * math.hypot(*relative) / math.sqrt(TURNS)
