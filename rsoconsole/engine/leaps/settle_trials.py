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


@dataclass(frozen=True, slots=True)
class _Turn:
    """What one leap is given."""

    seconds: float
    is_trial: bool
    comparison: int


@dataclass(slots=True)
class SettleTrials:
    """Learns from leap to leap."""

    configured_s: float
    """What it begins with."""
    _factor: float = 1.0
    """Of the configured time, as it is kept."""
    _is_shorter: bool = True
    """Whether less is in trial; else more."""
    _next: _Turn | None = None
    """What the next leap is given: it is planned by it already."""
    _used: _Turn | None = None
    """What the leap under way was given; None: nobody knows."""
    _comparison: int = 0
    """Number of the one under way."""
    _refused: int = 0
    """Trials in a row that were not kept."""
    _rests: int = 0
    _widths: dict[bool, list[float]] = field(default_factory=lambda: {False: [], True: []})
    """Of the stars, px, by whether the time was the one of a trial."""

    @property
    def seconds(self) -> float:
        """For the next leap."""
        return self.kept_s if self._next is None else self._next.seconds

    @property
    def kept_s(self) -> float:
        """As learned until now."""
        return self.configured_s * self._factor

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
        self._used = self._next or _Turn(self.kept_s, False, self._comparison)
        is_trial = not self._used.is_trial and self._rests == 0
        seconds = self._trial_s if is_trial else self.kept_s
        self._next = _Turn(seconds, is_trial, self._comparison)

    def lost(self) -> None:
        """The frame under way is of no leap, or never comes."""
        self._used = None

    def forget_widths(self) -> None:
        """Stars are as wide as before no more: the camera reads out in another mode."""
        self._begin_comparison()
        self._used = None

    def _begin_comparison(self) -> None:
        self._widths = {False: [], True: []}
        self._comparison += 1

    def seen(self, width_px: float | None) -> str | None:
        """How wide the stars of the leap under way were; None: so wide that none could be measured.

        Words for the log where another time is kept from now on.
        """
        used, self._used = self._used, None
        if used is None or used.comparison != self._comparison:
            return None
        is_known = width_px is not None and 0.0 < width_px < math.inf
        self._widths[used.is_trial].append(width_px if is_known and width_px else math.inf)
        if self._rests:
            self._rest()
            return None
        if min(map(len, self._widths.values())) < TURNS:
            return None
        return self._compared()

    def _rest(self) -> None:
        if sum(map(len, self._widths.values())) >= 2 * TURNS:
            self._rests -= 1
            self._begin_comparison()

    def _compared(self) -> str | None:
        kept, trial = (statistics.median(self._widths[each]) for each in (False, True))
        is_clear = math.isfinite(kept)  # else what is kept is no better than a trial may be
        ratio = trial / kept if is_clear else (0.0 if math.isfinite(trial) else 1.0)
        error = self._error_of_ratio()
        self._begin_comparison()
        before_s, trial_s = self.kept_s, self._trial_s
        was_shorter, self._is_shorter = self._is_shorter, not self._is_shorter
        after_s = before_s
        if was_shorter and ratio <= AS_SHARP and is_clear:
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
        seen = ", ".join(f"{w:.1f} px" if math.isfinite(w) else "none seen" for w in (trial, kept))
        return f"the mount is given {after_s:.1f} s to settle: {than} ({seen})"

    def _error_of_ratio(self) -> float:
        """One sigma of the ratio of both medians, by the scatter of the widths."""
        known = [[w for w in widths if math.isfinite(w)] for widths in self._widths.values()]
        relative = [statistics.stdev(w) / statistics.mean(w) for w in known if len(w) > 1]
        return _MEDIAN * math.hypot(*relative) / math.sqrt(TURNS)
