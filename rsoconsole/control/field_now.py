"""The field as a whole in plain lines: pairs of tracks, and who is missing."""

from collections.abc import Iterable, Sequence

from rsoconsole.control.text import one_line
from rsoconsole.records import PairMotion, UnseenMember
from rsoconsole.words import clock, tracks_words

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
        why = "" if each.is_lit else ", in shadow"
        why += "" if each.is_usable else ", at the edge"
        name = one_line(each.name)[:24]
        place = f"x {each.x_px:.0f} y {each.y_px:.0f}{why}"
        lines.append(f"expected, not seen: {name} ({each.norad_id}) {place}")
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
    least = {"now": "they part", "beyond": "still nearing"}.get(pair.closest)
    if least is None:
        when = clock(pair.closest_utc_ns, "minute")
        low, high = pair.closest_low_arcsec, pair.closest_high_arcsec
        least = f'least {low:.0f} to {high:.0f}" {when}'
    mark = " !" if pair.is_close else ""
    return (
        f"{pair.track_id}-{pair.other_track_id}: {pair.separation_arcsec:.1f} ±"
        f' {pair.sigma_separation_arcsec:.1f}"'
        f" {pair.separation_rate_arcsec_min:+.2f} ±"
        f' {pair.sigma_separation_rate_arcsec_min:.2f}"/min, {least}{mark}'
    )
