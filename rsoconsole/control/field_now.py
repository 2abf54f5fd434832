"""The field as a whole in plain lines: pairs of tracks, and who is missing."""

from collections.abc import Iterable, Sequence

from rsoconsole.control.text import one_line
from rsoconsole.records import PairMotion, UnseenMember
from rsoconsole.words import (
    apart_words,
    called,
    closest_words,
    nearing_words,
    tracks_words,
    unseen_words,
)

MOST_LINES = 12
"""Of pairs and of missing objects in plain lines: JSON has all."""


def nearest_first(pairs: Iterable[PairMotion]) -> tuple[PairMotion, ...]:
    """Those that stand nearest to each other first."""
    return tuple(sorted(pairs, key=lambda each: each.separation_arcsec))


def field_words(
    pairs: Sequence[PairMotion], unseen: Sequence[UnseenMember], uncatalogued: Sequence[int]
) -> list[str]:
    """Each track's nearest neighbour and who is missing, in lines of at most 80 columns."""
    lines = [_pair_words(each) for each in _nearest(pairs)[:MOST_LINES]]
    if uncatalogued:
        lines.append(f"not in the catalogue: {tracks_words(uncatalogued)}")
    for each in unseen[:MOST_LINES]:
        name = called(one_line(each.name)[:24], each.norad_id)
        lines.append(f"expected, not seen: {unseen_words(name, each)}")
    return lines


def _nearest(pairs: Sequence[PairMotion]) -> list[PairMotion]:
    """Those in which one is the other's nearest, and those of a warning."""
    met: set[int] = set()
    found = []
    for each in pairs:
        if each.is_close or not {each.track_id, each.other_track_id} <= met:
            found.append(each)
        met |= {each.track_id, each.other_track_id}
    return found


def _pair_words(pair: PairMotion) -> str:
    mark = " !" if pair.is_close else ""
    return (
        f"{pair.track_id}-{pair.other_track_id}: {apart_words(pair)} {nearing_words(pair)},"
        f" {closest_words(pair)}{mark}"
    )
