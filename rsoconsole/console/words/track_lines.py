"""The list of tracks and the list of their neighbours, with the chosen track in full. Pure."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.drawing.track_marks import track_ink
from rsoconsole.console.words.words import (
    Item,
    cut_to_width,
    draw_rule,
    first_visible_index,
    items_in_rows,
)
from rsoconsole.control import NextAim, next_aim_parts, one_line, track_state_words
from rsoconsole.night import FollowedTrack, NightView
from rsoconsole.records import Band, PairMotion
from rsoconsole.words import (
    KEPT,
    NS_PER_S,
    angle,
    approach_words,
    column_band,
    column_head,
    column_words,
    duration_words,
    identity_words,
    magnitude_words,
    number,
    separation_rate_words,
    separation_words,
    signed_angle,
    tracks_words,
    unseen_words,
    utc_text,
)

NAME_COLUMNS = (8, 24)
ORBIT_WORDS = {
    "free": "free",
    "constrained by prior": "prior",
    "weak geometry": "weak",
    "not observable": "none",
}
MIN_AIM_ROWS = 2
"""Rows that must be left below the tracks for the next aim to be shown."""
NUMBER_COLUMNS = 3
_GAP = " · "
_RULE_CELLS = 6
"""Cells of a title's line beside its words."""
MIN_TRACK_ROWS = 5
"""Least tracks in view where the chosen track is shown in full."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Column:
    """A column of the list."""

    head: str
    width: int
    """Cells of its widest word; 0: the rest of the line."""
    rank: int
    """Rank; where there is no room, the column of the highest rank is left out first."""
    words: Callable[[NightView, FollowedTrack, int | None], str]
    is_left: bool = False
    is_shown: Callable[[NightView], bool] = lambda _night: True
    """Returns False for a night in which the column would be empty."""
    head_in: Callable[[NightView], str] | None = None
    """Returns the head where it depends on the night; None: ``head``."""


def track_list_lines(
    night: NightView,
    chosen: int | None,
    now_utc_ns: int | None,
    width: int,
    height: int,
    *,
    next_aim: NextAim | None = None,
) -> list[Line]:
    """Build the list: title, heads, the tracks by number, the chosen one in full, the next aim.

    ``chosen``: id of the chosen track; None: the lead.
    ``now_utc_ns``: the frame clock, for the tracks' ages.
    ``next_aim``: the telescope's next aim; None: not known, or not to be shown.
    """
    tracks = night.tracks
    if next_aim is not None and tracks and height >= len(tracks) + 3 + MIN_AIM_ROWS:
        aim = next_aim_lines(next_aim, width)
        rows = height - len(aim)
        listed = track_list_lines(night, chosen, now_utc_ns, width, rows)
        return [*listed, *aim]
    title = _title(night, width)
    if not tracks:
        said = [cut_to_width([(" nothing is followed", "dim")], width)]
        return [title, *said][: max(height, 1)]
    columns = fitting_columns(night, width)

    def row(track: FollowedTrack) -> Item:
        words = [column.words(night, track, now_utc_ns) for column in columns]
        return _joined(columns, words, width), _ink(track)

    at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
    heads = [column.head_in(night) if column.head_in else column.head for column in columns]
    detail = track_detail_lines(night, tracks[at], now_utc_ns, width)
    head = _joined(columns, heads, width)
    return [title, *_listed(tracks, at, head, row, detail, width, height - 1)][: max(height, 1)]


def _listed(  # noqa: PLR0917 -- one call, each argument a different thing
    tracks: Sequence[FollowedTrack],
    at: int,
    heads: str,
    row: Callable[[FollowedTrack], Item],
    detail: Sequence[Line],
    width: int,
    height: int,
) -> list[Line]:
    """Return heads, the tracks about the chosen one, number ``at``, and its detail below.

    The list has precedence: it has the main figures of the detail.
    """
    room = max(height - 1, 1)
    detail = detail[: max(room - min(len(tracks), MIN_TRACK_ROWS), 0)]
    if len(tracks) + len(detail) > room:
        detail = detail[: max(room - len(tracks), 0)]
    room -= len(detail)
    first = first_visible_index(at, len(tracks), room)
    lines = [cut_to_width([(f" {heads}", "dim")], width)]
    for n, track in enumerate(tracks[first : first + room], first):
        text, ink = row(track)
        number, rest = (
            text[:NUMBER_COLUMNS],
            text[NUMBER_COLUMNS:].ljust(width - 1 - NUMBER_COLUMNS),
        )
        line: Line = [(" ", ""), (number, track_ink(track.track_id)), (rest, ink)]
        lines.append(cut_to_width([(f"▸{number}{rest}", "here")] if n == at else line, width))
    lines += [[("", "")]] * max(height - len(lines) - len(detail), 0)
    return [*lines, *detail]


def _title(night: NightView, width: int) -> Line:
    """Return the number of tracks, and the meaning of the signs as far as there is room."""
    most = night.setting("filter.most_tracks")
    dropped = f" · dropped: {' '.join(map(str, night.dropped))}" if night.dropped else ""
    left = f"tracks: {len(night.tracks)}{dropped}"
    signs = "* lead · + kept" if any(t.state.is_kept for t in night.tracks) else "* lead"
    rights = [f"{signs} · at most {most}", signs] if most else [signs]
    fitting = (right for right in rights if len(left) + len(right) + _RULE_CELLS <= width)
    return draw_rule(left, next(fitting, ""), width)


def track_strip_line(night: NightView, chosen: int | None, key: str, width: int) -> Line:
    """Return the strip of tracks: number and name of each, the lead and the chosen one first.

    ``chosen``: id of the chosen track, which is drawn reversed; None: the lead. ``key``: opens the
    list. Tracks without room are counted.
    """
    tracks = sorted(night.tracks, key=lambda each: (not each.is_lead, each.track_id != chosen))
    names = [track_name_words(night, each.track_id) for each in tracks]
    items = [
        each.number_text + ("" if name == "-" else f" {name}")
        for each, name in zip(tracks, names, strict=True)
    ]

    def more(count: int) -> str:
        return f"{_GAP}+{len(items) - count}" if count < len(items) else ""

    room, count = width - len(f"  [{key}]"), len(items)
    while count > 1 and len(_GAP.join(items[:count]) + more(count)) > room:
        count -= 1
    line: Line = []
    for each, item in zip(tracks[:count], items, strict=False):
        ink: Ink = "here" if each.track_id == chosen else track_ink(each.track_id)
        line += [(_GAP if line else " ", "dim"), (item, ink)]
    line = cut_to_width(line, 1 + room - len(more(count)))
    return cut_to_width([*line, (more(count), "dim"), (f" [{key}]", "title")], width)


def is_chosen(track: FollowedTrack, chosen: int | None) -> bool:
    """Return True if a track has the id ``chosen``; if that is None, True for the lead."""
    return track.is_lead if chosen is None else track.track_id == chosen


def _state(track: FollowedTrack) -> str:
    """Return a track's state after the last frame; "+": the operator keeps it."""
    misses = track.state.misses
    state = "COAST" if misses else "trial" if track.is_tentative else "TRACK"
    return track_state_words(state, misses, is_kept=track.state.is_kept)


def track_name_words(night: NightView, track_id: int) -> str:
    """Return a track's catalogue name, or what its unknown object is called; "-": none yet."""
    return one_line(identity_words(night.identifications.get(track_id)))


def track_detail_lines(
    night: NightView, track: FollowedTrack, now_utc_ns: int | None, width: int
) -> list[Line]:
    """Return the lines of one track in full: its figures on the list, and further ones."""
    orbit = night.orbits.get(track.track_id)
    parts = [
        f"{track.number_text} {track_name_words(night, track.track_id)}",
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
    parts.append(magnitude_words(track.light))
    age = _age(night, track, now_utc_ns)
    parts.append(f"age {age}" if age else "")
    parts.append("no orbit yet" if orbit is None else f"orbit {orbit.label}")
    return items_in_rows([(part, "") for part in parts if part], width, gap=" · ")


def next_aim_lines(aim: NextAim, width: int) -> list[Line]:
    """Return lines on the next aim of the telescope: its policy, its time and its slew."""
    what, _place, *rest = next_aim_parts(aim)
    return items_in_rows([(part, "dim") for part in (what, *rest)], width, gap=" · ")


def fitting_columns(night: NightView, width: int) -> tuple[_Column, ...]:
    """Return a night's columns that fit into a width, the least important left out first."""
    kept = [column for column in _COLUMNS if column.is_shown(night)]
    while len(kept) > 2 and _taken(kept) + NAME_COLUMNS[0] > width:
        kept.remove(max(kept, key=lambda column: column.rank))
    return tuple(kept)


def _taken(columns: list[_Column] | tuple[_Column, ...]) -> int:
    """Return the cells beside the name: the other columns, and a blank before each."""
    return sum(column.width + 1 for column in columns)


def _joined(columns: tuple[_Column, ...], words: list[str], width: int) -> str:
    least, most = NAME_COLUMNS
    name_columns = min(max(width - _taken(columns), least), most)
    cells = []
    for column, said in zip(columns, words, strict=True):
        wide = column.width or name_columns
        cut = said if len(said) <= wide else _cut_name(said, wide)
        cells.append(f"{cut:<{wide}}" if column.is_left else f"{cut:>{wide}}")
    return " ".join(cells)


def _cut_name(said: str, wide: int) -> str:
    """Cut a name so that the number at its end, by which satellites of a series differ, stays."""
    head, gap, last = said.rpartition(" ")
    is_number = bool(gap) and last[:1].isdigit() and len(last) <= wide // 2
    end = last if is_number else ""
    return f"{(head if end else said)[: wide - 1 - len(end)]}…{end}"


def _ink(track: FollowedTrack) -> Ink:
    if track.state.misses:
        return "warn"
    return "dim" if track.is_tentative else "title" if track.is_lead else ""


def _residual(_night: NightView, track: FollowedTrack, _now: int | None) -> str:
    residual = track.residual_arcsec
    if residual is None:
        return "-"
    off = math.hypot(*residual)
    return angle(off, "cell" if 10.0 <= off < 100.0 else "line")


def _nis(_night: NightView, track: FollowedTrack, _now: int | None) -> str:
    return "-" if track.nis is None else f"{track.nis:.1f}" if track.nis < 1000.0 else ">999"


def _has_light(night: NightView) -> bool:
    return any(track.light is not None for track in night.tracks)


def _band(night: NightView) -> Band:
    """Return the band of the column of magnitudes."""
    lights = (track.light for track in night.tracks)
    return column_band(light.band for light in lights if light is not None)


def _light(night: NightView, track: FollowedTrack, _now: int | None) -> str:
    light = track.light
    if light is None:
        return "-"
    words = column_words(light.mag, light.band, _band(night))
    return f"<{words}" if light.is_saturated and light.mag is not None else words


def _age(night: NightView, track: FollowedTrack, now_utc_ns: int | None) -> str:
    now = now_utc_ns or night.last_utc_ns
    return "" if now is None else duration_words((now - track.since_utc_ns) / NS_PER_S)


def _orbit(night: NightView, track: FollowedTrack, _now: int | None) -> str:
    orbit = night.orbits.get(track.track_id)
    return "-" if orbit is None else ORBIT_WORDS.get(orbit.label, orbit.label)


_COLUMNS = (
    _Column(
        head="#", width=NUMBER_COLUMNS, rank=0, words=lambda _night, track, _now: track.number_text
    ),
    _Column(
        head="name",
        width=0,
        rank=1,
        words=lambda night, track, _now: track_name_words(night, track.track_id),
        is_left=True,
    ),
    _Column(
        head="state", width=8, rank=2, words=lambda _night, track, _now: _state(track), is_left=True
    ),
    _Column(head="resid", width=5, rank=3, words=_residual),
    _Column(head="NIS", width=4, rank=4, words=_nis),
    _Column(head="SNR", width=4, rank=5, words=lambda _n, track, _t: number(track.snr, ".0f")),
    _Column(
        head="mag",
        width=6,
        rank=6,
        words=_light,
        is_shown=_has_light,
        head_in=lambda night: column_head(_band(night)),
    ),
    _Column(head="age", width=6, rank=7, words=_age),
    _Column(head="orbit", width=5, rank=8, words=_orbit, is_left=True),
)


_HEADS = f"{'#':>3} {'by':>3} {'apart':>6} {'/min':>6} {'least':>6} {'at UT':>5}"
_MAX_UNSEEN = 4


def neighbour_lines(night: NightView, chosen: int | None, width: int, height: int) -> list[Line]:
    """Build the list of each track's nearest neighbour, the chosen pair in full, the missing.

    ``chosen``: id of the chosen track; None: the lead. The missing are catalogued objects expected
    in the field without a track.
    """
    tracks = night.tracks
    title = draw_rule(f"neighbours: {len(tracks)}", "← list", width)
    below = unmatched_object_lines(night, width)
    if len(tracks) < 2:
        said = cut_to_width([(" no two are followed", "dim")], width)
        return [title, said, *below][: max(height, 1)]

    def row(track: FollowedTrack) -> Item:
        pair = nearest_pair(night, track.track_id)
        text = f"{track.number_text:>3} {_pair_row(pair, track.track_id)}"
        return text, "warn" if pair and pair.is_close else ""

    at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
    detail = [*pair_detail_lines(night, tracks[at], width), *below]
    return [title, *_listed(tracks, at, _HEADS, row, detail, width, height - 1)][: max(height, 1)]


def nearest_pair(night: NightView, track_id: int) -> PairMotion | None:
    """Return the pair of a track with its nearest neighbour; None where none is known."""
    followed = {each.track_id for each in night.tracks}
    own = (
        each
        for each in night.pairs
        if track_id in {each.track_id, each.other_track_id}
        and followed.issuperset({each.track_id, each.other_track_id})
    )
    return min(own, key=lambda each: each.separation_arcsec, default=None)


def pair_detail_lines(night: NightView, track: FollowedTrack, width: int) -> list[Line]:
    """Return the lines on a track and its nearest neighbour, each figure with its error."""
    pair = nearest_pair(night, track.track_id)
    if pair is None:
        return [cut_to_width([(f" {track.number_text}: no neighbour measured yet", "dim")], width)]
    other = neighbour_id(pair, track.track_id)
    turned = 0.0 if pair.track_id == track.track_id else 180.0
    angle_deg = (pair.position_angle_deg + turned) % 360.0
    name = track_name_words(night, other)
    parts = [
        f"{track.number_text} to {other}" + ("" if name == "-" else f" {name}"),
        separation_words(pair),
        f"PA {angle_deg:.1f} ± {pair.sigma_position_angle_deg:.1f}°",
        separation_rate_words(pair),
        approach_words(pair) + (f", {pair.path} path" if pair.closest == "ahead" else ""),
    ]
    ink: Ink = "warn" if pair.is_close else ""
    return items_in_rows([(part, ink) for part in parts], width, gap=" · ")


def unmatched_object_lines(night: NightView, width: int) -> list[Line]:
    """Return lines on tracks without a catalogued object, and expected objects without a track."""
    parts = []
    unknown = {n for n, found in night.identifications.items() if found.verdict == "unknown"}
    nameless = [t.number_text for t in night.tracks if t.track_id in unknown]
    if nameless:
        parts.append(f"not in the catalogue: {tracks_words(nameless)}")
    unseen = () if night.expected is None else night.expected.unseen
    shown = sorted(unseen, key=lambda each: not (each.is_usable and each.is_lit))
    for n, each in enumerate(shown[:_MAX_UNSEEN]):
        name = one_line(each.name or str(each.norad_id))
        parts.append(f"{'expected, not seen: ' if n == 0 else ''}{unseen_words(name, each)}")
    if len(unseen) > _MAX_UNSEEN:
        parts.append(f"{len(unseen) - _MAX_UNSEEN} more")
    return items_in_rows([(part, "dim") for part in parts], width, gap=" · ")


def neighbour_id(pair: PairMotion, track_id: int) -> int:
    """Return the id of a pair's other track."""
    return pair.other_track_id if pair.track_id == track_id else pair.track_id


def _pair_row(pair: PairMotion | None, track_id: int) -> str:
    if pair is None:
        return "  -"
    at = {"now": "now", "beyond": "later"}.get(pair.closest) or utc_text(
        pair.closest_utc_ns, "minute", ""
    )
    rate = pair.separation_rate_arcsec_min
    change = f"{rate:+.2f}" if abs(rate) < 99.0 else f"{rate:+.0f}"
    return (
        f"{neighbour_id(pair, track_id):>3} {angle(pair.separation_arcsec, 'cell'):>6} {change:>6}"
        f" {angle(pair.closest_arcsec, 'cell'):>6} {at:>5}"
    )
