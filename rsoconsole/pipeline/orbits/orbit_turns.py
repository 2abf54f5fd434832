"""Whose orbit a frame refines: the lead's always, those of a large group in turn. Pure.

An orbit takes some milliseconds, and a member's hardly changes by one more direction. One that has
just been missed is refined at once, with all that it took, so that its orbit may speak for it while
it coasts.
"""

from collections.abc import Sequence

from rsoconsole.pipeline.cycle import Track
from rsoconsole.records import Measurement
from rsoconsole.tracking import MANY

AT_ONCE = 2
"""Tracks beside the lead whose orbits one frame refines; with no more, none waits. Of a group
larger than ``MANY`` one."""
_LATE = 6
"""Measurements, after which one of a large group waits for no other that was missed."""


def in_turn(
    tracks: Sequence[Track], known: Sequence[tuple[Measurement, ...]], newest_frame_id: int
) -> list[int]:
    """Numbers of the tracks to refine after a frame, in order; the first of all is the lead.

    ``known``: of each track the measurements that its orbit is through. Those that have grown most
    since, as a share, come first.
    """
    if len(tracks) <= 1 + AT_ONCE:
        return list(range(len(tracks)))
    waiting = [n for n in range(1, len(tracks)) if tuple(tracks[n].measurements) != known[n]]
    missed = [n for n in waiting if tracks[n].last.frame_id < newest_frame_id]
    others = [n for n in waiting if n not in missed]
    others.sort(key=lambda n: -len(tracks[n].measurements) / max(len(known[n]), 1))
    room = max(AT_ONCE - len(missed), 1)
    if len(tracks) > MANY:
        late = [n for n in others if len(tracks[n].measurements) - len(known[n]) >= _LATE]
        room = 1 if late or not missed else 0
    return sorted([0, *missed, *others[:room]])
