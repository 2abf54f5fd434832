"""The list of tracks: as many columns as there is room for, and the chosen one in full. Pure."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.words.words import clipped, first_shown, packed, rule
from rsoconsole.control import NextAim, aim_parts, one_line, state_words
from rsoconsole.night import FollowedTrack, NightView
from rsoconsole.records import PairMotion
from rsoconsole.words import (
    KEPT,
    NS_PER_S,
    angle,
    apart_words,
    clock,
    closest_words,
    identity,
    nearing_words,
    signed_angle,
    span,
    tracks_words,
    unseen_words,
)

NAME_COLUMNS = (8, 24)
"""At least, at most."""
ORBIT_WORDS = {
    "free": "free",
    "constrained by prior": "prior",
    "weak geometry": "weak",
    "not observable": "none",
}
"""An orbit's label, short."""
MIN_AIM_ROWS = 2
"""Rows that the next aim may take where every track has its own."""
_RULE_CELLS = 6
"""What a title's line has beside its words."""
MIN_DETAIL_ROWS = 5
"""Rows for tracks that stay where the chosen one is told in full."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Column:
    """One column: the widest of its words, and which of them go first where there is no room."""

    head: str
    width: int
    rank: int
    words: Callable[[NightView, FollowedTrack, int | None], str]
    is_left: bool = False


def track_list_lines(
    night: NightView,
    chosen: int | None,
    now_utc_ns: int | None,
    width: int,
    height: int,
    *,
    next_aim: NextAim | None = None,
) -> list[Line]:
    """Title, heads, the tracks by their numbers, the chosen one in full, the next aim.

    ``chosen``: a track's number, None: the lead.
    """
    tracks = night.tracks
    if next_aim is not None and tracks and height >= len(tracks) + 3 + MIN_AIM_ROWS:
        aim = aim_lines(next_aim, width)
        rows = height - len(aim)
        listed = track_list_lines(night, chosen, now_utc_ns, width, rows)
        return [*listed, *aim]
    title = _title(night, width)
    if not tracks:
        said = [clipped([(" nothing is followed", "dim")], width)]
        return [title, *said][: max(height, 1)]
    at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
    room = max(height - 2, 1)
    detail = detail_lines(night, tracks[at], now_utc_ns, width)
    detail = detail[: max(room - min(len(tracks), MIN_DETAIL_ROWS), 0)]
    if len(tracks) + len(detail) > room:
        # The list first; what is told in full of one is on the list in short.
        detail = detail[: max(room - len(tracks), 0)]
    room -= len(detail)
    columns = columns_for(width)
    first = first_shown(at, len(tracks), room)
    lines = [title, clipped([(_heads(columns, width), "dim")], width)]
    for number, track in enumerate(tracks[first : first + room], first):
        text = _row(columns, night, track, now_utc_ns, width)
        sign = "▸" if number == at else " "
        ink: Ink = "here" if number == at else _ink(track)
        lines.append(clipped([(f"{sign}{text}".ljust(width), ink)], width))
    lines += [[("", "")]] * max(height - len(lines) - len(detail), 0)
    return [*lines, *detail][: max(height, 1)]


def _title(night: NightView, width: int) -> Line:
    """How many there are, and what the signs mean as far as there is room."""
    most = night.setting("filter.most_tracks")
    dropped = f" · dropped: {' '.join(map(str, night.dropped))}" if night.dropped else ""
    left = f"tracks: {len(night.tracks)}{dropped}"
    signs = "* lead · + kept" if any(t.state.is_kept for t in night.tracks) else "* lead"
    rights = [f"{signs} · at most {most}", signs] if most else [signs]
    fitting = (right for right in rights if len(left) + len(right) + _RULE_CELLS <= width)
    return rule(left, next(fitting, ""), width)


def is_chosen(track: FollowedTrack, chosen: int | None) -> bool:
    """Whether the cursor is on it."""
    return track.is_lead if chosen is None else track.track_id == chosen


def _state(track: FollowedTrack) -> str:
    """What became of it in the last frame; "+": the operator keeps it."""
    misses = track.state.misses
    state = "COAST" if misses else "trial" if track.is_on_trial else "TRACK"
    return state_words(state, misses, is_kept=track.state.is_kept)


def name_words(night: NightView, track_id: int) -> str:
    """Its name in the catalogue, else in the ledger; a sign stands for doubt."""
    return one_line(identity(night.identifications.get(track_id)))


def detail_lines(
    night: NightView, track: FollowedTrack, now_utc_ns: int | None, width: int
) -> list[Line]:
    """Everything that the list says of one track, and what it has no room for."""
    orbit = night.orbits.get(track.track_id)
    parts = [
        f"{track.number} {name_words(night, track.track_id)}",
        {"trial": "on trial: one more measurement confirms it"}.get(_state(track), _state(track)),
        KEPT if track.state.is_kept else "",
    ]
    if track.residual_arcsec is not None:
        east, north = track.residual_arcsec
        parts.append(f"residual {signed_angle(east)} {signed_angle(north)}")
    if track.nis is not None:
        parts.append(f"NIS {track.nis:.1f}")
    if track.snr is not None:
        parts.append(f"SNR {track.snr:.0f}")
    age = _age(night, track, now_utc_ns)
    parts.append(f"age {age}" if age else "")
    parts.append("no orbit yet" if orbit is None else f"orbit {orbit.label}")
    return packed([(part, "") for part in parts if part], width, gap=" · ")


def aim_lines(aim: NextAim, width: int) -> list[Line]:
    """Where the telescope looks in the exposure after the next one, and by which policy."""
    what, _place, *rest = aim_parts(aim)
    return packed([(part, "dim") for part in (what, *rest)], width, gap=" · ")


def columns_for(width: int) -> tuple[_Column, ...]:
    """Those that there is room for; the name has what the others leave."""
    kept = list(_COLUMNS)
    while len(kept) > 2 and _taken(kept) + NAME_COLUMNS[0] > width:
        kept.remove(max(kept, key=lambda column: column.rank))
    return tuple(kept)


def _taken(columns: list[_Column] | tuple[_Column, ...]) -> int:
    """Cells beside the name: the cursor's, and one before each column."""
    return 1 + sum(column.width + 1 for column in columns) - 1


def _widths(columns: tuple[_Column, ...], width: int) -> list[int]:
    least, most = NAME_COLUMNS
    name = min(max(width - _taken(columns), least), most)
    return [column.width or name for column in columns]


def _heads(columns: tuple[_Column, ...], width: int) -> str:
    return " " + _joined(columns, [column.head for column in columns], width)


def _row(
    columns: tuple[_Column, ...],
    night: NightView,
    track: FollowedTrack,
    now_utc_ns: int | None,
    width: int,
) -> str:
    return _joined(columns, [column.words(night, track, now_utc_ns) for column in columns], width)


def _joined(columns: tuple[_Column, ...], words: list[str], width: int) -> str:
    cells = []
    for column, said, wide in zip(columns, words, _widths(columns, width), strict=True):
        cut = said if len(said) <= wide else f"{said[: wide - 1]}…"
        cells.append(f"{cut:<{wide}}" if column.is_left else f"{cut:>{wide}}")
    return " ".join(cells)


def _ink(track: FollowedTrack) -> Ink:
    if track.state.misses:
        return "warn"
    return "dim" if track.is_on_trial else "title" if track.is_lead else ""


def _residual(_night: NightView, track: FollowedTrack, _now: int | None) -> str:
    residual = track.residual_arcsec
    if residual is None:
        return "-"
    off = math.hypot(*residual)
    return angle(off, "cell" if 10.0 <= off < 100.0 else "line")


def _nis(_night: NightView, track: FollowedTrack, _now: int | None) -> str:
    return "-" if track.nis is None else f"{track.nis:.1f}" if track.nis < 1000.0 else ">999"


def _snr(_night: NightView, track: FollowedTrack, _now: int | None) -> str:
    return "-" if track.snr is None else f"{track.snr:.0f}"


def _age(night: NightView, track: FollowedTrack, now_utc_ns: int | None) -> str:
    now = now_utc_ns or night.last_utc_ns
    return "" if now is None else span((now - track.since_utc_ns) / NS_PER_S)


def _orbit(night: NightView, track: FollowedTrack, _now: int | None) -> str:
    orbit = night.orbits.get(track.track_id)
    return "-" if orbit is None else ORBIT_WORDS.get(orbit.label, orbit.label)


_COLUMNS = (
    _Column(head="#", width=3, rank=0, words=lambda _night, track, _now: track.number),
    _Column(
        head="name",
        width=0,
        rank=1,
        words=lambda night, track, _now: name_words(night, track.track_id),
        is_left=True,
    ),
    _Column(
        head="state",
        width=8,
        rank=2,
        words=lambda _night, track, _now: _state(track),
        is_left=True,
    ),
    _Column(head="resid", width=5, rank=3, words=_residual),
    _Column(head="NIS", width=4, rank=4, words=_nis),
    _Column(head="SNR", width=4, rank=5, words=_snr),
    _Column(head="age", width=6, rank=6, words=_age),
    _Column(head="orbit", width=5, rank=7, words=_orbit, is_left=True),
)


_HEADS = f"{'#':>3} {'by':>3} {'apart':>6} {'/min':>6} {'least':>6} {'at UT':>5}"
_MIN_TRACK_ROWS = 5
_MAX_UNSEEN = 4


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
    detail = detail[: max(room - min(len(tracks), _MIN_TRACK_ROWS), 0)]
    if len(tracks) + len(detail) > room:
        detail = detail[: max(room - len(tracks), 0)]
    room -= len(detail)
    first = first_shown(at, len(tracks), room)
    lines = [title, clipped([(f" {_HEADS}", "dim")], width)]
    for number, track in enumerate(tracks[first : first + room], first):
        pair = nearest_of(night, track.track_id)
        sign = "▸" if number == at else " "
        ink: Ink = "here" if number == at else "warn" if pair and pair.is_close else ""
        row = f"{sign}{track.number:>3} {_pair_row(pair, track.track_id)}"
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
    for n, each in enumerate(shown[:_MAX_UNSEEN]):
        name = one_line(each.name or str(each.norad_id))
        parts.append(f"{'expected, not seen: ' if n == 0 else ''}{unseen_words(name, each)}")
    if len(unseen) > _MAX_UNSEEN:
        parts.append(f"{len(unseen) - _MAX_UNSEEN} more")
    return packed([(part, "dim") for part in parts], width, gap=" · ")


def is_uncatalogued(night: NightView, track_id: int) -> bool:
    """Whether no catalogued object explains a track."""
    found = night.identifications.get(track_id)
    return found is not None and found.verdict == "unknown"


def other_of(pair: PairMotion, track_id: int) -> int:
    """The other one of a pair."""
    return pair.other_track_id if pair.track_id == track_id else pair.track_id


def _pair_row(pair: PairMotion | None, track_id: int) -> str:
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
