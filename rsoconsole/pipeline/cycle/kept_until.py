"""What an ended track leaves to be followed again, and until when. Pure but for its memory.

The engine knows it by its clock (``engine/tasks/kept.py``) and puts it on record; a replay of a
session from before that goes by the times of its frames.
"""

from rsoconsole.config import FilterConfig
from rsoconsole.reasons import Cause, CauseKind
from rsoconsole.records import LoopState, StateChange
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
_TRACKS: tuple[LoopState, ...] = ("TRACK", "COAST")
_AT_REST: tuple[LoopState, ...] = ("IDLE", "MANUAL", "FAULT")


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
    """What the engine kept, by the changes of state and the times of the frames on record."""

    def __init__(self) -> None:
        self.following: Following | None = None
        """The track that can be followed again; None where there is none."""
        self._until_utc_ns: int | None = None
        self._is_counted = True
        """The time since the last change of state has been begun."""
        self._is_lent = False
        self._is_on_record = False
        """What is kept no more stands in this session: nothing has to be inferred."""
        self._last_utc_ns: int | None = None

    def folded(self, after: Following, t_mid_utc_ns: int) -> None:
        """A frame was folded into what is followed: a new track takes the place of the old one."""
        self._last_utc_ns = t_mid_utc_ns
        if after.state in _TRACKS:
            self.following = None

    def looked_at(self, t_mid_utc_ns: int | None, settings: FilterConfig) -> None:
        """A frame was taken while the operator had the mount: what is too old by then is gone."""
        if t_mid_utc_ns is None:
            return
        self._last_utc_ns = t_mid_utc_ns
        if self.following is None or self._is_on_record:
            return
        if self._until_utc_ns is not None and t_mid_utc_ns >= self._until_utc_ns:
            self.following = None
        elif not self._is_counted:
            self._count(settings, t_mid_utc_ns)

    def given_up(self) -> None:
        """The engine says that it can no longer be followed again."""
        self.following = None

    def made(self, kept: Following | None, settings: FilterConfig) -> None:
        """The operator's words on frames that nobody followed have made it."""
        is_new = kept is not self.following
        self.following = kept
        if is_new and kept is not None and self._last_utc_ns is not None:
            self._count(settings, self._last_utc_ns)

    def passed(self, change: StateChange, before: Following, settings: FilterConfig) -> None:
        """The state has changed from outside. ``before``: what was followed until then."""
        is_ended = before.state in _TRACKS
        self._is_on_record = self._is_on_record or change.kept_track_id is not None
        cause = change.reason
        if isinstance(cause, Cause) and cause.kind in _LEAVES_NOTHING:
            self.following = None
            return
        if is_ended:
            self.following = before
        elif change.before in _TRACKS:
            self.following = None  # there was a track then; under what is tried there is not
        self._is_lent = change.after == "MANUAL" and change.before not in _AT_REST
        if self.following is None or self._last_utc_ns is None:
            return
        if is_ended:
            self._count(settings, self._last_utc_ns)
        elif change.after == "MANUAL":
            # Nobody knows when that was: the next frame tells.
            self._is_counted = False

    def _count(self, settings: FilterConfig, now_utc_ns: int) -> None:
        assert self.following is not None
        self._until_utc_ns = kept_until_utc_ns(
            self.following, settings, now_utc_ns, is_lent=self._is_lent
        )
        self._is_counted = True
