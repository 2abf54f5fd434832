"""The screen of one frame: look at any pixel, and at the result of other settings."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from textual import events
from textual.app import ComposeResult, SystemCommand
from textual.message import Message

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.drawing.pane_layout import frame_screen_boxes
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.frame._sheet import FrameScreenState, cross_step_px, marking_instructions
from rsoconsole.console.frame._sheet_marks import lead_place_px
from rsoconsole.console.frame._sheet_pane import SheetPane
from rsoconsole.console.frame._sheet_panel import panel_lines
from rsoconsole.console.frame.sheet_actions import (
    SAID_S,
    FrameScreenActions,
    MarkCallbacks,
    view_of_streak,
)
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.panes.last_line import (
    Key,
    Mode,
    clicked_action,
    key_line,
    live_keys,
    notice_rows,
)
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.picture.sheet_pixels import whole_frame_view
from rsoconsole.console.watches.sheet_worker import (
    FrameFault,
    FrameOpened,
    FrameProcessed,
    FrameReprocessor,
    News,
    PixelsLoaded,
)
from rsoconsole.console.words.words import wrap_to_rows
from rsoconsole.session import SessionReader

LOOK_S = 0.25
"""Seconds between updates of running times and of the telescope's state."""
MAX_ALERT_ROWS = 3


class SheetNews(Message):
    """Posted when the worker has read or processed something, or has failed to."""

    def __init__(self, news: News) -> None:
        super().__init__()
        self.news = news


class FrameSheet(FrameScreenActions):
    """Screen of one frame: its pixels, the recorded detections and those with other settings."""

    AUTO_FOCUS = None
    CSS = """
    FrameSheet { overflow: hidden; }
    FrameSheet > LinesPane, FrameSheet > SheetPane { position: absolute; }
    FrameSheet > #alert { background: $error; color: $text; text-style: bold; text-wrap: wrap; }
    FrameSheet > #status { background: $panel; }
    FrameSheet > #keys { background: $panel; }
    """

    def __init__(
        self,
        folder: Path,
        frame_id: int,
        config: Config | None = None,
        *,
        status: Callable[[int, int], list[Line]] | None = None,
        alert: Callable[[], str] | None = None,
        keymap: Mapping[str, str] | None = None,
        mark_to: MarkCallbacks | None = None,
        seat: OperatorScreen | None = None,
    ) -> None:
        """Make the screen of a frame.

        ``config``: settings to process with; None: the session's own.
        ``status``: builds the first line, the telescope's state; None: there is no telescope.
        ``alert``: returns the telescope's alert.
        ``keymap``: other keys for commands, by the command's name.
        ``mark_to``: callbacks that send marks by hand; None: no marks can be made.
        ``seat``: the screen below, which shows this screen's notices too.
        """
        super().__init__(FrameScreenState(frame_id=frame_id), mark_to)
        self._folder, self._config, self._seat = folder, config, seat
        self._said: tuple[str, Ink, float] = ("", "", 0.0)
        self._notice_shown: tuple[str, Ink] = ("", "")
        self.keymap = dict(keymap or {})
        self._status, self._alert = status, alert
        self._is_list_open = False
        self._drawn_keys: list[Key] = []
        self._rows_of_alert = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._worker = FrameReprocessor(folder, frame_id, config, self._news_from_thread)

    def compose(self) -> ComposeResult:
        """Make the first line, the alert, the picture, the panel and the keys; not placed yet."""
        yield LinesPane(id="status")
        yield LinesPane(id="alert")
        yield SheetPane(self.sheet, id="picture")
        yield LinesPane(id="panel")
        yield LinesPane(id="keys")

    def on_mount(self) -> None:
        """Draw what is known, and start the thread that reads the frame."""
        self._loop = asyncio.get_running_loop()
        self._place_panes()
        self.show()
        self.set_interval(LOOK_S, self._look)
        self._worker.start()

    def on_unmount(self) -> None:
        """End the thread and release the pixels."""
        self._worker.close()
        self.sheet.pixels = None

    def on_resize(self) -> None:
        """Lay out picture and panel for another size of the terminal."""
        self._place_panes()
        self.call_after_refresh(self._fit_view)

    @property
    def mode(self) -> Mode:
        """Meaning of the keys now: those of the frame's screen, or those of a mark by hand."""
        return "sheet mark" if self.sheet.is_marking else "sheet"

    def say(self, text: str, ink: Ink = "title", seconds: float = SAID_S) -> None:
        """Show a notice in the last line for ``seconds``, here and on the screen below this one."""
        if self._seat is not None:
            self._seat.say(text, ink, seconds)
        self._said = (text, ink, time.monotonic() + seconds)
        self._show_keys()

    @property
    def notice(self) -> tuple[str, Ink]:
        """The present notice and its ink; during a mark by hand, the instructions for it."""
        said: tuple[str, Ink] = self._said[:2] if time.monotonic() < self._said[2] else ("", "")
        if self._seat is not None:
            said = self._seat.notice
        if self.sheet.is_marking and said[1] != "warn":
            return marking_instructions(self.sheet), "title"
        return said

    # -- what the worker says ------------------------------------------------------------------

    def _news_from_thread(self, news: News) -> None:
        with contextlib.suppress(RuntimeError):  # the application has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(self.post_message, SheetNews(news))

    def on_sheet_news(self, message: SheetNews) -> None:
        """Store and draw what the worker has read or processed, or the reason why it could not."""
        sheet, news = self.sheet, message.news
        match news:
            case FrameOpened():
                sheet.opened, place = news, lead_place_px(news.detail)
                if sheet.view is not None and place is not None:
                    sheet.view = sheet.view.at(*place)  # as near as the frame before was seen
            case PixelsLoaded():
                sheet.pixels = news.pixels
                height, width = news.pixels.pixels.shape
                before = sheet.view
                sheet.view = whole_frame_view(width, height, *self.picture.room)
                if before is not None and (before.width_px, before.height_px) == (width, height):
                    sheet.view = before.resized(*self.picture.room)
                elif sheet.candidates:
                    sheet.view = view_of_streak(sheet.view, sheet.candidates[0].latest_detection)
                self.process()
            case FrameProcessed():
                sheet.done, sheet.failure = news, ""
            case FrameFault(wanted=None):
                sheet.fault = news.text
            case FrameFault():
                sheet.failure = news.text
        if isinstance(news, FrameProcessed | FrameFault) and news.wanted == sheet.wanted:
            sheet.wanted = None
        self.show()

    def process(self) -> None:
        """Have the worker process the frame with the settings on trial."""
        sheet, wanted = self.sheet, self.sheet.wanted_settings()
        sheet.began_s, sheet.wanted = time.monotonic(), wanted
        self._worker.ask(wanted)
        self.show()

    # -- what is shown -------------------------------------------------------------------------

    def _look(self) -> None:
        """Update running times and the telescope's state."""
        if self.sheet.pixels is None or self.sheet.wanted is not None:
            self._show_panel()
        if self.sheet.pixels is None and not self.sheet.fault:
            self.picture.redraw()
        self._show_status()
        if self.notice != self._notice_shown:
            self._show_keys()

    def show(self) -> None:
        self.picture.redraw()
        self._show_panel()
        self._show_status()
        self._show_keys()

    def _show_panel(self) -> None:
        self.query_one("#panel", LinesPane).show(panel_lines(self.sheet))

    def _show_status(self) -> None:
        if self._status is not None:
            self.query_one("#status", LinesPane).show(self._status)
        if self._alert_rows() != self._rows_of_alert:
            self._place_panes()
            self.call_after_refresh(self._fit_view)
        text = self._alert_text()
        self.query_one("#alert", LinesPane).show(
            lambda width, height: wrap_to_rows(f" {text}", width, height)
        )

    def _alert_text(self) -> str:
        above = self._alert() if self._alert is not None else ""
        fault = self.sheet.fault
        if fault and self.sheet.opened is not None and self.sheet.opened.preview is not None:
            fault += " · the picture is the session's preview"
        return " · ".join(part for part in (above, fault) if part)

    def _alert_rows(self) -> int:
        text = self._alert_text()
        return len(wrap_to_rows(f" {text}", self.size.width, MAX_ALERT_ROWS)) if text else 0

    def _show_keys(self) -> None:
        keys = live_keys(EngineView(), can_act=False, mode=self.mode, keymap=self.keymap)
        if not self.can_mark:
            keys = [key for key in keys if key.command != "mark"]
        step = f"Step {cross_step_px(self.sheet):.3g} px"
        self._drawn_keys = [k._replace(name=step) if k.name == "Step" else k for k in keys]
        before, self._notice_shown = self._notice_shown, self.notice
        if self._rows_of(before) != self._rows_of(self._notice_shown):
            self._place_panes()
            self.call_after_refresh(self._fit_view)
        self.query_one("#keys", LinesPane).show(key_line(self._drawn_keys, self._notice_shown))

    def _rows_of(self, notice: tuple[str, Ink]) -> int:
        return notice_rows(notice[0], *self.size)

    def _place_panes(self) -> None:
        self._rows_of_alert = self._alert_rows()
        boxes = frame_screen_boxes(
            *self.size,
            has_status=self._status is not None,
            alert_rows=self._rows_of_alert,
            keys_rows=1 + self._rows_of(self._notice_shown),
            is_list_open=self._is_list_open,
        )
        for name in ("status", "alert", "picture", "panel", "keys"):
            widget, box = self.query_one(f"#{name}"), boxes.get(name)
            widget.display = box is not None
            if box is not None:
                widget.styles.offset = (box.x, box.y)
                widget.styles.width, widget.styles.height = box.width, box.height

    def _fit_view(self) -> None:
        if self.sheet.view is not None:
            self.sheet.view = self.sheet.view.resized(*self.picture.room)
        self.picture.redraw()

    # -- keys ----------------------------------------------------------------------------------

    def action_back(self) -> None:
        """Cancel an unfinished mark; else close the open list; else close this screen."""
        if self.sheet.is_marking:
            self.leave_mark()
        elif self._is_list_open:
            self.action_list()
        else:
            self.dismiss(None)

    def action_other_frame(self, by: int) -> None:
        """Show the next frame whose pixels are kept, for ``by`` below 0 the one before.

        Zoom, step and stretch stay the same; the view moves to the lead track in that frame.
        """
        own = self.sheet
        if own.is_marking:
            self.say("a mark is being made in this frame: esc leaves it off", "warn")
            return
        try:
            kept = SessionReader(self._folder).frames_with_pixels()
        except RsoconsoleError as error:
            self.say(str(error), "warn")
            return
        others = [n for n in kept if (n - own.frame_id) * by > 0]
        if not others:
            which = "oldest" if by < 0 else "newest"
            self.say(f"frame {own.frame_id} is the {which} whose pixels are kept")
            return
        other = FrameSheet(
            self._folder,
            min(others, key=lambda n: abs(n - own.frame_id)),
            self._config,
            status=self._status,
            alert=self._alert,
            keymap=self.keymap,
            mark_to=self._mark_to,
            seat=self._seat,
        )
        its = other.sheet
        its.view, its.step = own.view, own.step
        its.stretch, its.has_marks = own.stretch, own.has_marks
        self.app.switch_screen(other)

    def action_list(self) -> None:
        """Give the whole screen to the panel; pressed again, show the picture beside it."""
        self._is_list_open = not self._is_list_open
        self._place_panes()
        self.call_after_refresh(self._fit_view)

    async def on_click(self, event: events.Click) -> None:
        """Run the action of the key that was clicked in the last line."""
        pane = self.query_one("#keys", LinesPane)
        action = clicked_action(event, pane, self._drawn_keys, self._notice_shown[0])
        if action:
            await self.run_action(action)

    def system_commands(self) -> Iterable[SystemCommand]:
        """Yield this screen's commands for the palette, in addition to the console's."""
        for title, help_, action in (
            ("Frame: next candidate", "go to it", self.action_next_candidate),
            ("Frame: nearer", "by two", lambda: self.action_zoom_by(-1)),
            ("Frame: farther", "by two", lambda: self.action_zoom_by(1)),
            ("Frame: mark by hand", "the streak's two ends", self.action_mark),
            ("Frame: the one before", "whose pixels are kept", lambda: self.action_other_frame(-1)),
            ("Frame: the one after", "whose pixels are kept", lambda: self.action_other_frame(1)),
            ("Frame: stretch", "how light becomes grey", self.action_stretch),
            ("Frame: marks", "on and off", self.action_marks),
            ("Frame: smaller tau", "by a quarter; processes again", lambda: self.action_tau(-1)),
            ("Frame: larger tau", "by a quarter; processes again", lambda: self.action_tau(1)),
            ("Frame: map mode", "fast or paper; processes again", self.action_map_mode),
            ("Frame: what the network sees", "the map, and back", self.action_network_view),
            ("Frame: solve again", "from its own stars, or the recorded", self.action_plate),
            ("Frame: as recorded", "nothing tried any more", self.action_as_recorded),
            ("Frame: list", "all candidates, and back", self.action_list),
            ("Frame: back", "to the screen below", self.action_back),
        ):
            yield SystemCommand(title, help_, action)
