"""Where each pane of a night's screen lies, for its terminal and for what is open."""

from collections.abc import Collection, Mapping

from textual.widget import Widget

from rsoconsole.console.actions import PlotActions, Seat, TuneActions
from rsoconsole.console.drawing import (
    Box,
    Name,
    banner_box,
    fold,
    has_tune_of_its_own,
    orbit_box,
    timeline_rows,
    tune_box,
)
from rsoconsole.console.picture import Picture

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
    is_tune_over = tune.is_open and not has_tune_of_its_own(width, height)
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
    pane.display = (tune.is_open or has_tune_of_its_own(*seat.size)) and not seat.is_log_open
    if not pane.display:
        return
    _put(pane, place)
    # What reaches beneath the pane from its left ends before it: no word is cut.
    facts = boxes.get("facts")
    if facts is None or not facts.x < place.x < facts.x + facts.width:
        return
    if facts.y < place.y + place.height and place.y < facts.y + facts.height:
        seat.query_one("#facts").styles.width = place.x - facts.x
