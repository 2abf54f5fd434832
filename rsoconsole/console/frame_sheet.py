"""One frame at full resolution: look at any pixel of it, and see what other settings would say."""

import asyncio
import contextlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from textual import events
from textual.app import ComposeResult
from textual.message import Message

from rsoconsole.config import Config
from rsoconsole.console.commands import BY_NAME
from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.key_line import Key, Mode, key_at, key_line, keys_for
from rsoconsole.console.panes import LinesPane
from rsoconsole.console.plot import Line
from rsoconsole.console.sheet import Sheet
from rsoconsole.console.sheet_actions import SendMark, SheetActions
from rsoconsole.console.sheet_boxes import sheet_boxes
from rsoconsole.console.sheet_pane import SheetPane
from rsoconsole.console.sheet_panel import panel_lines
from rsoconsole.console.sheet_view import whole
from rsoconsole.console.sheet_worker import Done, Fault, Loaded, News, Opened, SheetWorker
from rsoconsole.console.words import wrapped

LOOK_S = 0.25
"""How often what is under way says for how long, and the first line is made anew."""
MOST_ALERT_ROWS = 3


class SheetNews(Message):
    """The worker has read or processed something, or could not."""

    def __init__(self, news: News) -> None:
        super().__init__()
        self.news = news


class FrameSheet(SheetActions):
    """A frame of a session, its pixels, and the detector's word on it then and now."""

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
        send_mark: SendMark | None = None,
        mark_refusal: Callable[[int], str] = lambda _frame_id: "",
    ) -> None:
        """``config``: None takes the session's own; ``status`` builds the first line and ``alert``
        what must not be missed, where a telescope is at work meanwhile."""
        super().__init__(Sheet(frame_id=frame_id), send_mark, mark_refusal)
        self.keymap = dict(keymap or {})
        self._status, self._alert = status, alert
        self._is_list_open = False
        self._drawn_keys: list[Key] = []
        self._rows_of_alert = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._worker = SheetWorker(folder, frame_id, config, self._news_from_thread)

    def compose(self) -> ComposeResult:
        """Picture and panel; where they lie depends on the terminal."""
        yield LinesPane(id="status")
        yield LinesPane(id="alert")
        yield SheetPane(self.sheet, id="picture")
        yield LinesPane(id="panel")
        yield LinesPane(id="keys")

    def on_mount(self) -> None:
        """Begin to read; first paint."""
        self._loop = asyncio.get_running_loop()
        self._place_panes()
        self.show()
        self.set_interval(LOOK_S, self._look)
        self._worker.start()

    def on_unmount(self) -> None:
        """Let go of the pixels."""
        self._worker.close()
        self.sheet.pixels = None

    def on_resize(self) -> None:
        """Another terminal, other places."""
        self._place_panes()
        self.call_after_refresh(self._fit_view)

    @property
    def mode(self) -> Mode:
        """What the keys are for."""
        return "sheet"

    # -- what the worker says ------------------------------------------------------------------

    def _news_from_thread(self, news: News) -> None:
        with contextlib.suppress(RuntimeError):  # the application has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(self.post_message, SheetNews(news))

    def on_sheet_news(self, message: SheetNews) -> None:
        """What is known now."""
        sheet, news = self.sheet, message.news
        match news:
            case Opened():
                sheet.opened = news
            case Loaded():
                sheet.pixels = news.pixels
                height, width = news.pixels.pixels.shape
                sheet.view = whole(width, height, *self.picture.room)
                if sheet.candidates:
                    likeliest = sheet.candidates[0].shown
                    sheet.view = sheet.view.at(likeliest.x_px, likeliest.y_px)
                self.process()
            case Done():
                sheet.done, sheet.failure = news, ""
                self._settle(news.wish)
            case Fault(wish=None):
                sheet.fault = news.text
            case Fault():
                sheet.failure = news.text
                self._settle(news.wish)
        self.show()

    def _settle(self, wish: object) -> None:
        if self.sheet.wish == wish:
            self.sheet.wish = None

    def process(self) -> None:
        """Ask for the frame with what is tried now."""
        sheet, wish = self.sheet, self.sheet.wished()
        sheet.began_s, sheet.wish = time.monotonic(), wish
        self._worker.ask(wish)
        self.show()

    # -- what is shown -------------------------------------------------------------------------

    def _look(self) -> None:
        """What goes by itself: the seconds, and the telescope's state."""
        if self.sheet.pixels is None or self.sheet.wish is not None:
            self._show_panel()
        if self.sheet.pixels is None and not self.sheet.fault:
            self.picture.redraw()
        self._show_status()

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
            lambda width, height: wrapped(f" {text}", width, height)
        )

    def _alert_text(self) -> str:
        above = self._alert() if self._alert is not None else ""
        fault = self.sheet.fault
        if fault and self.sheet.opened is not None and self.sheet.opened.preview is not None:
            fault += " · the picture is the session's preview"
        return " · ".join(part for part in (above, fault) if part)

    def _alert_rows(self) -> int:
        text = self._alert_text()
        return len(wrapped(f" {text}", self.size.width, MOST_ALERT_ROWS)) if text else 0

    def _show_keys(self) -> None:
        self._drawn_keys = keys_for(EngineView(), can_act=False, mode="sheet", keymap=self.keymap)
        self.query_one("#keys", LinesPane).show(key_line(self._drawn_keys))

    def _place_panes(self) -> None:
        self._rows_of_alert = self._alert_rows()
        boxes = sheet_boxes(
            *self.size,
            has_status=self._status is not None,
            alert_rows=self._rows_of_alert,
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
        """A mark first, then the list, then the screen below."""
        if self.sheet.is_marking:
            self.end_mark("")
        elif self._is_list_open:
            self.action_list()
        else:
            self.dismiss(None)

    def action_list(self) -> None:
        """The whole screen to the panel, and back."""
        self._is_list_open = not self._is_list_open
        self._place_panes()
        self.call_after_refresh(self._fit_view)

    async def on_click(self, event: events.Click) -> None:
        """A key of the last line."""
        pane = self.query_one("#keys", LinesPane)
        key = None
        if event.widget is pane:
            key = key_at(self._drawn_keys, "", pane.size.width, event.x)
        if key is not None and key.command:
            command = BY_NAME.get(key.command)
            is_apps = command is not None and command.is_everywhere
            await self.run_action(f"app.{key.command}" if is_apps else key.command)
