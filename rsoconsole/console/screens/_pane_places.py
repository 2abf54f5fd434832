"""Where the panes of a screen lie, its line of keys and its alert."""

from collections.abc import Collection, Mapping

from textual.events import Click
from textual.widget import Widget

from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.actions.track_actions import PlotActions
from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.drawing.pane_layout import (
    MAX_ALERT_ROWS,
    Box,
    Name,
    banner_box,
    fold,
    has_tuning_column,
    orbit_box,
    timeline_rows,
    tune_box,
)
from rsoconsole.console.panes.last_line import Key, action_at, key_line, notice_rows
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.words import words

DEFAULT_ASPECT = 4 / 3


def aspect_of(picture: Picture | None) -> float:
    """Of the camera's frames: width over height."""
    return picture.aspect if picture is not None else DEFAULT_ASPECT


def place_panes(
    seat: Seat, plots: PlotActions, tune: TuneActions, panes: Collection[Name], alert_rows: int
) -> None:
    """Lay out those panes, and what lies over them."""
    width, height = seat.size
    over_keys = timeline_rows(height) if "timeline" in panes else 0
    aspect = aspect_of(seat.picture)
    boxes = fold(
        width,
        height,
        alert_rows=alert_rows,
        is_log_open=seat.is_log_open,
        timeline_rows=over_keys,
        aspect=aspect,
    )
    for name in panes:
        widget, box = seat.query_one(f"#{name}"), boxes.get(name)
        widget.display = box is not None
        if box is not None:
            _put(widget, box)
    over_plots, tune_place = (
        box_of(width, height, alert_rows=alert_rows, timeline_rows=over_keys, aspect=aspect)
        for box_of in (orbit_box, tune_box)
    )
    _place_orbit(seat, boxes.get("orbit"), over_plots)
    is_tune_over = tune.is_open and not has_tuning_column(width, height)
    is_covered = seat.is_log_open or seat.is_orbit_open or is_tune_over
    plots.place(over_plots, is_covered=is_covered)
    _place_tune(seat, tune, boxes, tune_place)
    banner, box = seat.query_one("#stop"), banner_box(width, height, alert_rows=alert_rows)
    banner.styles.height = box.height
    banner.styles.offset = (0, box.y)


def _put(widget: Widget, box: Box) -> None:
    widget.styles.offset = (box.x, box.y)
    widget.styles.width, widget.styles.height = box.width, box.height


def _place_orbit(seat: Seat, standing: Box | None, over_plots: Box) -> None:
    """Over the plots when it is opened; else where it always stands, if it does."""
    is_open = seat.is_orbit_open and not seat.is_log_open
    box, pane = over_plots if is_open else standing, seat.pane("orbit")
    pane.display = box is not None
    pane.set_class(is_open, "-open")
    if box is not None:
        _put(pane, box)


def _place_tune(seat: Seat, tune: TuneActions, boxes: Mapping[Name, Box], place: Box) -> None:
    pane = tune.pane
    pane.display = (tune.is_open or has_tuning_column(*seat.size)) and not seat.is_log_open
    if not pane.display:
        return
    _put(pane, place)
    # What reaches beneath the pane from its left ends before it: no word is cut.
    facts = boxes.get("facts")
    if facts is None or not facts.x < place.x < facts.x + facts.width:
        return
    if facts.y < place.y + place.height and place.y < facts.y + facts.height:
        seat.query_one("#facts").styles.width = place.x - facts.x


class AlertLine:
    """Draws it in a pane; the panes below are laid out for its rows."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._placed_rows = 0
        """For which the panes have been laid out."""

    def place(self) -> int:
        """How many rows the alert, or what stands in its place, takes."""
        self._placed_rows = self._rows()
        return self._placed_rows

    def _rows(self) -> int:
        said = self._seat.alert or self._seat.intro
        width = self._seat.size.width
        return len(words.wrapped(f" {said}", width, MAX_ALERT_ROWS)) if said else 0

    def show(self) -> bool:
        """Say it; whether it takes another number of rows than the panes are laid out for."""
        seat, pane = self._seat, self._seat.pane("alert")
        alert = seat.alert
        said = alert or seat.intro
        pane.set_class(not alert, "-calm")
        cut = f"… ({first_key('read', seat.keymap)} shows all) …"
        pane.show(lambda width, height: words.wrapped(f" {said}", width, height, cut))
        return self._rows() != self._placed_rows


class KeyLine:
    """Draws it in a pane, which grows by the rows that a notice takes."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._drawn: tuple[list[Key], str] = ([], "")
        """The keys and the notice that it shows."""

    def show(self) -> None:
        """The keys that matter now, and a word about what was just done."""
        keys, notice = self._seat.keys, self._seat.notice
        self._drawn = keys, notice[0]
        self.place()
        self._seat.pane("keys").show(key_line(keys, notice))

    def place(self) -> None:
        """In the last row, and over it what is said."""
        pane, (width, height) = self._seat.pane("keys"), self._seat.size
        rows = 1 + notice_rows(self._seat.notice[0], width, height)
        if pane.styles.height is None or pane.styles.height.value != rows:
            pane.styles.height = rows
            pane.styles.offset = (0, height - rows)

    def action_at(self, event: Click) -> str:
        """What the key that was clicked does, as Textual writes an action; empty: none was."""
        return action_at(event, self._seat.pane("keys"), *self._drawn)
