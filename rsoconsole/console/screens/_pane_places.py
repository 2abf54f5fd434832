"""Where a screen's panes are, its line of keys and its alert."""

from dataclasses import replace
from typing import ClassVar

from textual.events import Click
from textual.widget import Widget

from rsoconsole.console.actions.track_actions import TrackActions
from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.drawing.pane_layout import (
    MAX_ALERT_ROWS,
    Box,
    Name,
    banner_box,
    has_tuning_column,
    make_room_for_strip,
    orbit_box,
    pane_boxes,
    timeline_rows,
    tune_box,
)
from rsoconsole.console.panes.last_line import Key, clicked_action, key_line, notice_rows
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.words import words
from rsoconsole.console.words.track_lines import track_strip_line

DEFAULT_ASPECT = 4 / 3


def frame_aspect(picture: Picture | None) -> float:
    """Return the width over height of the camera's frames; a default where there is no picture."""
    return picture.aspect if picture is not None else DEFAULT_ASPECT


def _put(widget: Widget, box: Box | None) -> None:
    """Show a widget in a box; None: hide it."""
    widget.display = box is not None
    if box is not None:
        widget.styles.offset = (box.x, box.y)
        widget.styles.width, widget.styles.height = box.width, box.height


BESIDE_TUNING: tuple[Name, ...] = (
    *("confidence", "east", "north", "axis", "nis", "facts", "strip", "log"),
)
"""Panes that go on beside the tuning pane where it would cover a part of them."""


def _beside(tune: Box, box: Box) -> Box:
    """Return the part of a box right of the tuning pane, where that covers its left."""
    x = tune.x + tune.width + 1
    is_beside = box.y < tune.y + tune.height and tune.y < box.y + box.height
    if not is_beside or not box.x < x < box.x + box.width or tune.x > box.x:
        return box
    return replace(box, x=x, width=box.x + box.width - x)


class PanePlacement(TrackActions):
    """Lays out a screen's panes; alert and notice take rows from the panes beside them."""

    PANES: ClassVar[tuple[Name, ...]]
    tune: TuneActions
    _placed_alert_rows = 0
    _has_strip = False
    _drawn_keys: tuple[list[Key], str] = ([], "")

    def place_panes(self) -> None:
        """Lay out all panes for the terminal's size and for what is open."""
        width, height = self.size
        alert_rows = self._placed_alert_rows = self._alert_rows()
        over_keys = timeline_rows(height) if "timeline" in self.PANES else 0
        aspect = frame_aspect(self.picture)
        boxes = pane_boxes(
            width,
            height,
            alert_rows=alert_rows,
            is_log_open=self.is_log_open,
            timeline_rows=over_keys,
            aspect=aspect,
        )
        self._has_strip = len(self.night.tracks) > 1
        if self._has_strip and not self.is_log_open:
            make_room_for_strip(boxes)
        for name in self.PANES:
            _put(self.query_one(f"#{name}"), boxes.get(name))
        over_plots, tune_place = (
            box_of(width, height, alert_rows=alert_rows, timeline_rows=over_keys, aspect=aspect)
            for box_of in (orbit_box, tune_box)
        )
        is_orbit_over = self.is_orbit_open and not self.is_log_open
        self.pane("orbit").set_class(is_orbit_over, "-open")
        _put(self.pane("orbit"), over_plots if is_orbit_over else boxes.get("orbit"))
        self.place_page(over_plots, is_covered=self.is_log_open or self.is_orbit_open)
        is_tune_seen = self.tune.is_open or has_tuning_column(width, height)
        is_tune_seen = is_tune_seen and not self.is_log_open
        _put(self.tune.pane, tune_place if is_tune_seen else None)
        if is_tune_seen:
            for name in BESIDE_TUNING:
                if name in boxes:
                    _put(self.query_one(f"#{name}"), _beside(tune_place, boxes[name]))
        banner, box = self.query_one("#stop"), banner_box(width, height, alert_rows=alert_rows)
        banner.styles.height = box.height
        banner.styles.offset = (0, box.y)
        log = boxes.get("log")
        if self.is_log_open and banner.display and log is not None and log.height > box.height:
            rows = box.y + box.height - log.y
            _put(self.query_one("#log"), replace(log, y=log.y + rows, height=log.height - rows))
        self._place_keys()

    # -- the alert ------------------------------------------------------------------------------

    def _alert_rows(self) -> int:
        """Return the rows of the alert, or of the text in its place."""
        said = self.alert_words or self.night_intro
        return len(words.wrap_to_rows(f" {said}", self.size.width, MAX_ALERT_ROWS)) if said else 0

    def show_alert(self) -> None:
        """Draw the alert or the text in its place; if its rows change, lay out the panes again."""
        pane, alert = self.pane("alert"), self.alert_words
        said = alert or self.night_intro
        pane.set_class(not alert, "-calm")
        cut = f"… ({first_key('read', self.keymap)} shows all) …"
        pane.show(lambda width, height: words.wrap_to_rows(f" {said}", width, height, cut))
        if self._alert_rows() != self._placed_alert_rows:
            self.place_panes()
            self.call_after_refresh(self.handle_view_change)

    # -- the tracks ---------------------------------------------------------------------------

    def show_plots(self) -> None:
        """Draw the plots, and the strip of tracks where several are followed."""
        super().show_plots()
        night, chosen = self.night, self.chosen_track_id
        key = first_key("track_list", self.keymap)
        self.pane("strip").show(lambda width, _: [track_strip_line(night, chosen, key, width)])
        if self._has_strip != (len(night.tracks) > 1):
            self.place_panes()

    # -- the last line --------------------------------------------------------------------------

    def show_keys(self) -> None:
        """Draw the last line: the most useful keys at the moment, and the notice."""
        keys, notice = self.keys, self.notice
        self._drawn_keys = keys, notice[0]
        self._place_keys()
        self.pane("keys").show(key_line(keys, notice))

    def _place_keys(self) -> None:
        """Lay the keys into the last row, and the notice over it."""
        pane, (width, height) = self.pane("keys"), self.size
        rows = 1 + notice_rows(self.notice[0], width, height)
        if pane.styles.height is None or pane.styles.height.value != rows:
            pane.styles.height = rows
            pane.styles.offset = (0, height - rows)

    async def on_click(self, event: Click) -> None:
        """Run the action of the key that was clicked in the last line."""
        action = clicked_action(event, self.pane("keys"), *self._drawn_keys)
        if action:
            self.is_click = True
            try:
                await self.run_action(action)
            finally:
                self.is_click = False
