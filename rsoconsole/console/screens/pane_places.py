"""Where each pane of a night's screen lies, for its terminal and for what is open."""

from collections.abc import Iterable, Mapping
from typing import Protocol

from textual.geometry import Size
from textual.widget import Widget

from rsoconsole.console.actions import PlotActions, TuneActions
from rsoconsole.console.drawing import (
    Box,
    Name,
    banner_box,
    fold,
    has_tune_of_its_own,
    orbit_box,
    tune_box,
)
from rsoconsole.console.panes import LinesPane


class PlacedScreen(Protocol):
    """What placing asks of the screen."""

    is_log_open: bool
    is_orbit_open: bool
    plots: PlotActions
    tune: TuneActions

    @property
    def size(self) -> Size:
        """Columns and rows of the terminal."""

    @property
    def aspect(self) -> float:
        """Of the shown picture: width over height."""

    def timeline_rows(self, height: int) -> int:
        """How many rows over the keys a time line takes, in a terminal of that height."""

    def pane(self, name: str) -> LinesPane:
        """The pane of that name."""

    def widget(self, name: str) -> Widget:
        """A pane of any kind."""


def place_panes(screen: PlacedScreen, panes: Iterable[Name], alert_rows: int) -> None:
    """Lay out those panes, and what lies over them."""
    width, height = screen.size
    timeline_rows, aspect = screen.timeline_rows(height), screen.aspect
    boxes = fold(
        width,
        height,
        alert_rows=alert_rows,
        is_log_open=screen.is_log_open,
        timeline_rows=timeline_rows,
        aspect=aspect,
    )
    for name in panes:
        widget, box = screen.widget(name), boxes.get(name)
        widget.display = box is not None
        if box is not None:
            _put(widget, box)
    over_plots, tune = (
        box_of(width, height, alert_rows=alert_rows, timeline_rows=timeline_rows, aspect=aspect)
        for box_of in (orbit_box, tune_box)
    )
    _place_orbit(screen, boxes.get("orbit"), over_plots)
    screen.plots.place(over_plots)
    _place_tune(screen, boxes, tune)
    banner, box = screen.widget("stop"), banner_box(width, height, alert_rows=alert_rows)
    banner.styles.height = box.height
    banner.styles.offset = (0, box.y)


def _put(widget: Widget, box: Box) -> None:
    widget.styles.offset = (box.x, box.y)
    widget.styles.width, widget.styles.height = box.width, box.height


def _place_orbit(screen: PlacedScreen, standing: Box | None, over_plots: Box) -> None:
    """Over the plots when it is opened; else where it always stands, if it does."""
    is_open = screen.is_orbit_open and not screen.is_log_open
    box, pane = over_plots if is_open else standing, screen.pane("orbit")
    pane.display = box is not None
    pane.set_class(is_open, "-open")
    if box is not None:
        _put(pane, box)


def _place_tune(screen: PlacedScreen, boxes: Mapping[Name, Box], place: Box) -> None:
    pane, is_open = screen.tune.pane, screen.tune.is_open
    pane.display = (is_open or has_tune_of_its_own(*screen.size)) and not screen.is_log_open
    if not pane.display:
        return
    _put(pane, place)
    # What reaches beneath the pane from its left ends before it: no word is cut.
    facts = boxes.get("facts")
    if facts is None or not facts.x < place.x < facts.x + facts.width:
        return
    if facts.y < place.y + place.height and place.y < facts.y + facts.height:
        screen.widget("facts").styles.width = place.x - facts.x
