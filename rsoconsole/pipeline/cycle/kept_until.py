"""What an ended track leaves to be followed again, and until when. Pure but for its memory.

The engine knows it by its clock (``engine/tasks/kept.py``) and puts it on record.
"""

from rsoconsole.config import FilterConfig
from rsoconsole.reasons import CauseKind
from rsoconsole.records import FOLLOWING, StateChange
from rsoconsole.tracking.association import Following

NS = 1_000_000_000
KEPT_S = 900.0
"""After disarming, STOP, a new search or a fault: beyond it the checklist is to be gone through,
and a track that nobody measured is hardly found where it must be."""
_LEAVES_NOTHING: frozenset[CauseKind] = frozenset(
    (
        "limit met",
        "too many limits",
        "clock set",
        "night ended",
        "engine ended",
        "resumed",
    )
)
"""Nobody may follow again what ended so; and what is resumed is kept no more."""


def kept_until_utc_ns(
    kept: Following, settings: FilterConfig, now_utc_ns: int, *, is_lent: bool
) -> int:
    """Until when a track that is kept from now on can be followed again.

    ``is_lent``: the operator has taken the mount from autonomy and moves it by hand: a track is
    kept as long as it would be coasted then.
    """
    seen_ns = now_utc_ns if kept.taken is None else kept.taken.t_mid_utc_ns
    until_ns = seen_ns + round(settings.max_coast_s * NS)
    return until_ns if is_lent else min(until_ns, now_utc_ns + round(KEPT_S * NS))


class KeptOnRecord:
    """What the engine kept, by the changes of state on record."""

    def __init__(self) -> None:
        self.following: Following | None = None
        """The track that can be followed again; None where there is none."""

    def folded(self, after: Following) -> None:
        """A frame was folded into what is followed: a new track takes the place of the old one."""
        if after.state in FOLLOWING:
            self.following = None

    def given_up(self) -> None:
        """The engine says that it can no longer be followed again."""
        self.following = None

    def made(self, kept: Following | None) -> None:
        """The operator's words on frames that nobody followed have made it."""
        self.following = kept

    def passed(self, change: StateChange, before: Following) -> None:
        """The state has changed from outside. ``before``: what was followed until then."""
        if change.reason.kind in _LEAVES_NOTHING:
            self.following = None
        elif before.state in FOLLOWING:
            self.following = before
        elif change.before in FOLLOWING:
            self.following = None  # there was a track then; under what is tried there is not
