"""A session as a card in a notebook; all text from the record is escaped."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rsoconsole.library.notebook._pictures import Picture, picture_with_overlay_html
from rsoconsole.library.notebook.night.svg import GREEN, GREY, RED, escape_markup
from rsoconsole.night import LeadSummary, StateSpan, merit
from rsoconsole.words import duration_words

STATE_COLOURS = {
    "IDLE": "#9aa0a6",
    "SEARCH": "#4a80d9",
    "ACQUIRE": "#7b61c9",
    "TRACK": GREEN,
    "COAST": "#b8860b",
    "LOST": "#c2702f",
    "MANUAL": "#5f7a8a",
    "FAULT": RED,
}
_STRIP_WIDTH, _STRIP_HEIGHT = 640.0, 18.0
_NARROWEST = 1.5
_LABEL_PX = 46.0
_TABLE = "border-collapse:collapse;margin:0;color:inherit;font-size:inherit"
_CELL = "padding:1px 10px 1px 0;text-align:left;background:none;border:none"
_DIM = "opacity:0.72"


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionCard:
    """Content of the card of a session."""

    title: str
    folder: str
    when: str
    is_live: bool
    """True where the session has not been closed: it goes on, or was cut off."""
    branch_of: str | None
    changes: str
    """Changed settings of a branch, in words; empty: none."""
    frames: int
    kept: int
    """Number of frames whose pixels are kept."""
    summary: LeadSummary
    spells: tuple[StateSpan, ...]
    misses: tuple[int, ...]
    """Instants of the frames in which the object was not measured, UTC nanoseconds."""
    picture: Picture | None


def card_rows(card: SessionCard) -> list[tuple[str, str]]:
    """Return rows (label, value) in words, for HTML and for a terminal."""
    s = card.summary
    rows = [
        ("when", card.when),
        ("frames", f"{card.frames}, {card.kept} kept in full"),
        (merit.LOCK.label, merit.LOCK.words(s)),
        (merit.MISSES.label, f"{s.misses} of {s.followed + s.misses} frames with a track"),
        (merit.RMS.label, merit.RMS.words(s)),
        (merit.NIS_MEAN.label, f"{merit.NIS_MEAN.words(s)}, band {merit.BAND.words(s)}"),
    ]
    if card.branch_of is not None:
        rows.insert(
            0, ("what if", f"{card.changes or 'as recorded'}; a branch of {card.branch_of}")
        )
    if card.is_live:
        rows.insert(1, ("not closed", "it goes on, or was cut off; refresh() reads what is new"))
    return rows


def card_html(card: SessionCard) -> str:
    """Return the card as HTML, which takes its colours from the page, dark or light."""
    rows = "".join(
        f'<tr style="background:none"><th scope="row" style="{_CELL};{_DIM};font-weight:normal">'
        f'{escape_markup(what)}</th><td style="{_CELL}">{escape_markup(how)}</td></tr>'
        for what, how in card_rows(card)
    )
    picture = ""
    if card.picture is not None:
        picture = (
            '<div style="flex:0 0 220px;max-width:220px">'
            + picture_with_overlay_html(card.picture.png, card.picture.overlay, card.picture.words)
            + f'<div style="font-size:85%;{_DIM}">frame {card.picture.frame_id:04d}</div></div>'
        )
    return (
        '<div class="rsoconsole-session" style="color:var(--jp-ui-font-color1,inherit);'
        "border:1px solid var(--jp-border-color2,#9994);border-radius:4px;padding:10px 12px;"
        'max-width:760px;font-size:13px;line-height:1.45">'
        f'<div style="font-size:16px;font-weight:600">{escape_markup(card.title)}</div>'
        f'<div style="{_DIM};font-size:12px">{escape_markup(card.folder)}</div>'
        '<div style="display:flex;flex-wrap:wrap;gap:16px;margin:8px 0">'
        f'<table style="{_TABLE};flex:1 1 300px;display:block">{rows}</table>{picture}</div>'
        f"{state_strip_svg(card.spells, card.misses)}</div>"
    )


def card_text(card: SessionCard) -> str:
    """Return the card as plain text for a terminal."""
    rows = "\n".join(f"  {what:<13}{how}" for what, how in card_rows(card))
    states = f"\n  {'states':<13}{_strip_words(card.spells)}" if card.spells else ""
    return f"{card.title}  ({card.folder})\n{rows}{states}"


def state_strip_svg(spells: Sequence[StateSpan], misses: Iterable[int] = ()) -> str:
    """Return an SVG of the loop's states along time, with a mark below for every missed frame.

    ``spells``: the states in order; ``misses``: times of the missed frames, UTC nanoseconds.
    """
    if not spells:
        return ""
    t_0, t_1 = spells[0].t_from_utc_ns, spells[-1].t_to_utc_ns
    scale = _STRIP_WIDTH / max(t_1 - t_0, 1)
    parts = []
    for spell in spells:
        x = (spell.t_from_utc_ns - t_0) * scale
        width = max((spell.t_to_utc_ns - spell.t_from_utc_ns) * scale, _NARROWEST)
        colour = STATE_COLOURS.get(spell.state, GREY)
        title = f"{spell.state}, {duration_words(spell.duration_s, 'line')}"
        parts.append(
            f'<rect x="{x:.1f}" y="0" width="{width:.1f}" height="{_STRIP_HEIGHT:.0f}" '
            f'fill="{colour}"><title>{escape_markup(title)}</title></rect>'
        )
        if width > _LABEL_PX:
            parts.append(
                f'<text x="{x + 5:.1f}" y="13" fill="#fff" font-size="11" '
                f'font-family="sans-serif">{escape_markup(spell.state)}</text>'
            )
    for t_utc_ns in misses:
        x = (t_utc_ns - t_0) * scale
        parts.append(
            f'<path d="M{x:.1f} {_STRIP_HEIGHT + 2:.0f}l-3 6h6z" fill="currentColor">'
            "<title>missed</title></path>"
        )
    words = _strip_words(spells)
    return (
        f'<svg viewBox="0 0 {_STRIP_WIDTH:.0f} {_STRIP_HEIGHT + 9:.0f}" role="img" '
        f'aria-label="{escape_markup(words)}" style="width:100%;height:auto;display:block">'
        f'{"".join(parts)}</svg><div style="font-size:12px;{_DIM}">{escape_markup(words)}</div>'
    )


def _strip_words(spells: Iterable[StateSpan]) -> str:
    total: dict[str, float] = {}
    for spell in spells:
        total[spell.state] = total.get(spell.state, 0.0) + spell.duration_s
    return " · ".join(
        f"{state} {duration_words(s, 'line')}" for state, s in total.items() if s > 0.0
    )
