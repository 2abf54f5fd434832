"""Who stands next to whom in the field, when they come closest, and who is missing. Pure."""

from rsoconsole.console.drawing import Ink, Line
from rsoconsole.console.words.track_lines import is_chosen, name_words
from rsoconsole.console.words.words import clipped, first_shown, packed, rule
from rsoconsole.control import one_line
from rsoconsole.night import FollowedTrack, NightView
from rsoconsole.records import PairMotion
from rsoconsole.words import (
    angle,
    apart_words,
    clock,
    closest_words,
    nearing_words,
    tracks_words,
    unseen_words,
)

_HEADS = f"{'#':>3} {'by':>3} {'apart':>6} {'/min':>6} {'least':>6} {'at UT':>5}"
_LEAST_TRACK_ROWS = 5
_MOST_UNSEEN = 4


def neighbour_lines(night: NightView, chosen: int | None, width: int, height: int) -> list[Line]:
    """Title, heads, each track with its nearest neighbour, the chosen pair in full, the missing.

    ``chosen``: a track's number, None: the lead.
    """
    tracks = night.tracks
    title = rule(f"neighbours: {len(tracks)}", "← list", width)
    below = field_lines(night, width)
    if len(tracks) < 2:
        said = clipped([(" no two are followed", "dim")], width)
        return [title, said, *below][: max(height, 1)]
    at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
    room = max(height - 2, 1)
    detail = [*pair_detail(night, tracks[at], width), *below]
    detail = detail[: max(room - min(len(tracks), _LEAST_TRACK_ROWS), 0)]
    if len(tracks) + len(detail) > room:
        detail = detail[: max(room - len(tracks), 0)]
    room -= len(detail)
    first = first_shown(at, len(tracks), room)
    lines = [title, clipped([(f" {_HEADS}", "dim")], width)]
    for number, track in enumerate(tracks[first : first + room], first):
        pair = nearest_of(night, track.track_id)
        sign = "▸" if number == at else " "
        ink: Ink = "here" if number == at else "warn" if pair and pair.is_close else ""
        row = f"{sign}{track.number:>3} {_row(pair, track.track_id)}"
        lines.append(clipped([(row.ljust(width), ink)], width))
    lines += [[("", "")]] * max(height - len(lines) - len(detail), 0)
    return [*lines, *detail][: max(height, 1)]


def nearest_of(night: NightView, track_id: int) -> PairMotion | None:
    """The pair of a track with its nearest neighbour; None where none is known."""
    followed = {each.track_id for each in night.tracks}
    own = (
        each
        for each in night.pairs
        if track_id in {each.track_id, each.other_track_id}
        and followed.issuperset({each.track_id, each.other_track_id})
    )
    return min(own, key=lambda each: each.separation_arcsec, default=None)


def pair_detail(night: NightView, track: FollowedTrack, width: int) -> list[Line]:
    """A track and its nearest neighbour with every error."""
    pair = nearest_of(night, track.track_id)
    if pair is None:
        return [clipped([(f" {track.number}: no neighbour measured yet", "dim")], width)]
    other = other_of(pair, track.track_id)
    turned = 0.0 if pair.track_id == track.track_id else 180.0
    angle_deg = (pair.position_angle_deg + turned) % 360.0
    name = name_words(night, other)
    parts = [
        f"{track.number} to {other}" + ("" if name == "-" else f" {name}"),
        apart_words(pair),
        f"PA {angle_deg:.1f} ± {pair.sigma_position_angle_deg:.1f}°",
        nearing_words(pair),
        closest_words(pair) + (f", {pair.path} path" if pair.closest == "ahead" else ""),
    ]
    ink: Ink = "warn" if pair.is_close else ""
    return packed([(part, ink) for part in parts], width, gap=" · ")


def field_lines(night: NightView, width: int) -> list[Line]:
    """Catalogued objects that should be in the field and have no track, and tracks of none."""
    parts = []
    nameless = [t.number for t in night.tracks if is_uncatalogued(night, t.track_id)]
    if nameless:
        parts.append(f"not in the catalogue: {tracks_words(nameless)}")
    unseen = () if night.expected is None else night.expected.unseen
    shown = sorted(unseen, key=lambda each: not (each.is_usable and each.is_lit))
    for n, each in enumerate(shown[:_MOST_UNSEEN]):
        name = one_line(each.name or str(each.norad_id))
        parts.append(f"{'expected, not seen: ' if n == 0 else ''}{unseen_words(name, each)}")
    if len(unseen) > _MOST_UNSEEN:
        parts.append(f"{len(unseen) - _MOST_UNSEEN} more")
    return packed([(part, "dim") for part in parts], width, gap=" · ")


def is_uncatalogued(night: NightView, track_id: int) -> bool:
    """Whether no catalogued object explains a track."""
    found = night.identifications.get(track_id)
    return found is not None and found.verdict == "unknown"


def other_of(pair: PairMotion, track_id: int) -> int:
    """The other one of a pair."""
    return pair.other_track_id if pair.track_id == track_id else pair.track_id


def _row(pair: PairMotion | None, track_id: int) -> str:
    if pair is None:
        return "  -"
    at = {"now": "now", "beyond": "later"}.get(pair.closest) or clock(
        pair.closest_utc_ns, "minute", ""
    )
    rate = pair.separation_rate_arcsec_min
    change = f"{rate:+.2f}" if abs(rate) < 99.0 else f"{rate:+.0f}"
    return (
        f"{other_of(pair, track_id):>3} {angle(pair.separation_arcsec, 'cell'):>6} {change:>6}"
        f" {angle(pair.closest_arcsec, 'cell'):>6} {at:>5}"
    )
