"""The operator's word on one of the tracks: a decision on the frame that it is said of. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.control import Drop, Keep
from rsoconsole.pipeline.cycle import Shown
from rsoconsole.reasons import RuledKind
from rsoconsole.records import Ruling
from rsoconsole.tracking.association import Following


def on_track(
    word: Drop | Keep, shown: Shown, following: Following, by: str, config: Config
) -> Ruling:
    """One track is dropped or kept; what was said of the frame before stands.

    Raises ValueError where the track is none that is followed.
    """
    frame_id = shown.taken.frame_id
    before = shown.decision or Ruling(frame_id=frame_id)
    number = word.track
    if isinstance(word, Drop) and word.off:
        left = tuple(each for each in before.dropped if each != number)
        return replace(before, dropped=left, by=by)
    known = {each.track.track_id: each for each in following.tracks}
    if number not in known:
        alive = " ".join(map(str, sorted(known)))
        which = f"those followed are {alive}" if alive else "nothing is followed"
        raise ValueError(f"no track {number} is followed: {which}")
    if config.search.follow != "nearest":
        raise ValueError(
            f"search.follow is {config.search.follow!r}: no track is its own there,"
            " choose a streak instead"
        )
    if isinstance(word, Drop):
        return replace(before, dropped=(*before.dropped, number), by=by)
    is_kept = known[number].is_kept
    if is_kept is not bool(word.off):
        raise ValueError(f"track {number} is {'kept already' if is_kept else 'not kept'}")
    kept = tuple(each for each in before.kept if each != number)
    released = tuple(each for each in before.released if each != number)
    if word.off:
        return replace(before, kept=kept, released=(*released, number), by=by)
    return replace(before, kept=(*kept, number), released=released, by=by)


def frame_of(word: Drop | Keep, decisions: Sequence[Ruling]) -> int | None:
    """The frame on which a word is, where it takes back another; None: where it says.

    Raises ValueError where there is nothing to take back.
    """
    if not (isinstance(word, Drop) and word.off):
        return word.frame_id
    found = [each.frame_id for each in decisions if word.track in each.dropped]
    if not found:
        raise ValueError(
            f"track {word.track} has not been dropped in the last frames:"
            " follow its streak in the picture instead"
        )
    return found[-1]


def with_tracks_of(decision: Ruling, before: Ruling | None) -> Ruling:
    """A word on a frame's streaks; what was said of tracks in that frame stands."""
    if before is None:
        return decision
    return replace(decision, dropped=before.dropped, kept=before.kept, released=before.released)


def ruled_of(word: Drop | Keep) -> RuledKind:
    """What it came to."""
    if isinstance(word, Drop):
        return "taken up again" if word.off else "dropped"
    return "released" if word.off else "kept"
