"""The live screen: hands what is known to the panes, and turns the console's keys into views."""

from functools import partial
from typing import Any, ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import BindingType

from rsoconsole.console import panels, words
from rsoconsole.console.ask import LineDialog
from rsoconsole.console.commands import BY_NAME, bindings, first_key
from rsoconsole.console.dialogs import LeaveDialog
from rsoconsole.console.facts import fact_lines
from rsoconsole.console.fold import (
    MOST_ALERT_ROWS,
    Name,
    banner_box,
    fold,
    has_tune_of_its_own,
    tune_box,
)
from rsoconsole.console.frame_sheet import FrameSheet
from rsoconsole.console.key_line import Key, Mode, key_at, key_line, keys_for
from rsoconsole.console.log_pane import LogPane
from rsoconsole.console.messages import EngineSeen, NightSeen, OutlookSeen
from rsoconsole.console.panes import SIGHTS, FramePane, LinesPane, Sight, StopBanner
from rsoconsole.console.picture import STRETCHES, Drawing, Picture
from rsoconsole.console.plot import Line
from rsoconsole.console.sky_view import sky_lines
from rsoconsole.console.stop import StopNews
from rsoconsole.console.streak_actions import StreakActions
from rsoconsole.console.telescope_actions import TelescopeActions
from rsoconsole.console.tune import TunePane
from rsoconsole.console.tune_actions import TuneActions

DEFAULT_ASPECT = 4 / 3


class LiveScreen(TelescopeActions, StreakActions, TuneActions):
    """The operator's seat over a night, live or recorded."""

    BINDINGS: ClassVar[list[BindingType]] = [*bindings(is_everywhere=False)]
    AUTO_FOCUS = None
    CSS = """
    LiveScreen { layers: base over; overflow: hidden; }
    LiveScreen > LinesPane, LiveScreen > FramePane, LiveScreen > LogPane { position: absolute; }
    LiveScreen > #alert { background: $error; color: $text; text-style: bold; text-wrap: wrap; }
    LiveScreen > #tune { layer: over; }
    LiveScreen > #top { background: $panel; }
    LiveScreen > #keys { background: $panel; }
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._is_log_open = False
        self._drawn: tuple[list[Key], str] = ([], "")
        """The keys and the notice that the last line shows."""
        self._rows_of_alert = 0
        """For which the panes have been laid out."""
        self._sight = 0
        self._stretch = 0

    def compose(self) -> ComposeResult:
        """Every pane; where each lies depends on the terminal."""
        yield LinesPane(id="top")
        yield LinesPane(id="alert")
        yield FramePane(self._picture_words, id="frame")
        yield FramePane(self._picture_words, id="closeup")
        for name in ("confidence", "east", "north", "nis", "facts", "sky"):
            yield LinesPane(id=name)
        yield LogPane(id="log")
        yield LinesPane(id="keys")
        yield TunePane(id="tune")
        yield StopBanner(id="stop")

    def on_mount(self) -> None:
        """First paint."""
        self.place_panes()
        self._show_night()
        self._show_engine()

    def on_resize(self) -> None:
        """Another terminal, other places."""
        self.place_panes()
        self.call_after_refresh(self.mark_in_other_view)

    def on_key(self, event: events.Key) -> None:
        """While a mark is made, arrows and enter are the mark's."""
        if self.mark_key(event.key):
            event.stop()
            event.prevent_default()

    # -- what is known ----------------------------------------------------------------------

    def on_night_seen(self, message: NightSeen) -> None:
        """The session has grown."""
        has_other_shape = self._aspect(message.picture) != self._aspect(self.picture)
        if message.night.folder != self.night.folder:
            self.forget_mark()
        self.night = message.night
        self.take_picture(message.picture)
        if has_other_shape:
            self.place_panes()
        self._show_night()
        self._show_engine()
        self.reckon_now_and_then()

    def on_engine_seen(self, message: EngineSeen) -> None:
        """The engine's word."""
        if message.engine.holder != self.engine.holder:
            # Whatever was said of it is done, or undone: the first line has it now.
            self.forget_notice()
        self.engine = message.engine
        self._show_engine()

    def on_outlook_seen(self, message: OutlookSeen) -> None:
        """What the next hours bring."""
        self.outlook = message.outlook
        self._pane("sky").show(partial(sky_lines, self.night.config, self.outlook))
        self._show_engine()

    def _show_night(self) -> None:
        night = self.night
        self.show_picture()
        self._pane("confidence").show(partial(panels.confidence_lines, night))
        self._pane("east").show(partial(panels.residual_lines, night, "east"))
        self._pane("north").show(partial(panels.residual_lines, night, "north"))
        self._pane("nis").show(partial(panels.nis_lines, night))
        self.query_one("#log", LogPane).show(night.log)
        self.show_tuning()

    def show_picture(self) -> None:
        """The sight chosen in the large pane; in the small one the other."""
        large, stretch = SIGHTS[self._sight], STRETCHES[self._stretch]
        small: Sight = "close-up" if large == "field" else "field"
        told, marks = (self.night.frame, stretch), self.mark_marks()
        self.query_one("#frame", FramePane).show(self.picture, large, stretch, told, marks)
        self.query_one("#closeup", FramePane).show(self.picture, small, stretch, told, marks)

    def _picture_words(
        self, picture: Picture | None, sight: Sight, drawing: Drawing | None
    ) -> tuple[list[str], list[str]]:
        stretch = STRETCHES[self._stretch]
        if sight == "field":
            title, caption = words.frame_title(self.night, picture), words.frame_caption(picture)
        else:
            title = words.closeup_title(picture, drawing)
            caption = words.closeup_caption(picture)
        return title if stretch == "streaks" else [*title, stretch], caption

    def _show_engine(self) -> None:
        night, engine = self.night, self.engine
        self.on_known(night, engine)
        self._pane("top").show(partial(words.top_lines, night, engine, self.read_only))
        self._pane("facts").show(partial(fact_lines, night, engine, self.outlook))
        alert = self._alert
        if self._alert_rows() != self._rows_of_alert:
            self.place_panes()
            self.call_after_refresh(self.mark_in_other_view)
        self._pane("alert").show(lambda width, height: words.wrapped(f" {alert}", width, height))
        self.show_keys()

    @property
    def _alert(self) -> str:
        """What must not be missed."""
        give, keep = (first_key(name, self.keymap) for name in ("give_seat", "keep_seat"))
        asker = self.asker
        asked = f"{asker} asks for the seat: {give} gives it, {keep} keeps it" if asker else ""
        said = words.alert_text(self.night, self.engine)
        return " · ".join(part for part in (asked, said) if part)

    def _alert_elsewhere(self) -> str:
        """The same for a screen over this one, which covers what came of a STOP."""
        news = self.stop_news
        return " · ".join(
            part for part in (f"STOP {news.text}" if news else "", self._alert) if part
        )

    def _alert_rows(self) -> int:
        alert = self._alert
        return len(words.wrapped(f" {alert}", self.size.width, MOST_ALERT_ROWS)) if alert else 0

    def show_keys(self) -> None:
        """The keys that matter now, and a word about what was just done."""
        self._drawn = self._keys, self.notice[0]
        self._pane("keys").show(key_line(self._keys, self.notice))

    @property
    def _keys(self) -> list[Key]:
        return keys_for(self.engine, can_act=self.can_act, mode=self.mode, keymap=self.keymap)

    async def on_click(self, event: events.Click) -> None:
        """A key of the last line, by the mouse."""
        pane = self._pane("keys")
        if event.widget is not pane:
            return
        key = key_at(*self._drawn, pane.size.width, event.x)
        if key is not None and key.command:
            is_apps = BY_NAME[key.command].is_everywhere
            await self.run_action(f"app.{key.command}" if is_apps else key.command)

    @property
    def mode(self) -> Mode:
        """What the keys are for."""
        if self.marking is not None:
            return "mark"
        if self._is_log_open:
            return "log"
        return "tune" if isinstance(self.focused, TunePane) else "live"

    # -- where it lies ----------------------------------------------------------------------

    def place_panes(self) -> None:
        """Where each pane lies, for this terminal."""
        width, height = self.size
        alert_rows = self._rows_of_alert = self._alert_rows()
        boxes = fold(
            width,
            height,
            alert_rows=alert_rows,
            is_log_open=self._is_log_open,
            aspect=self._aspect(self.picture),
        )
        names: tuple[Name, ...] = (
            *("top", "alert", "frame", "closeup", "confidence", "east"),
            *("north", "nis", "facts", "sky", "log", "keys"),
        )
        for name in names:
            widget, box = self.query_one(f"#{name}"), boxes.get(name)
            widget.display = box is not None
            if box is not None:
                widget.styles.offset = (box.x, box.y)
                widget.styles.width, widget.styles.height = box.width, box.height
        tune = self.query_one("#tune", TunePane)
        has_own = has_tune_of_its_own(width, height)
        tune.display = (self.is_tune_open or has_own) and not self._is_log_open
        if tune.display:
            place = tune_box(
                width, height, alert_rows=alert_rows, aspect=self._aspect(self.picture)
            )
            tune.styles.offset = (place.x, place.y)
            tune.styles.width, tune.styles.height = place.width, place.height
        banner, box = self.query_one("#stop"), banner_box(width, height, alert_rows=alert_rows)
        banner.styles.height = box.height
        banner.styles.offset = (0, box.y)

    @staticmethod
    def _aspect(picture: Picture | None) -> float:
        return picture.aspect if picture is not None else DEFAULT_ASPECT

    def _pane(self, name: str) -> LinesPane:
        return self.query_one(f"#{name}", LinesPane)

    # -- the console's own keys -----------------------------------------------------------------

    def show_stop(self, news: StopNews | None) -> None:
        """What came of a STOP, over everything else."""
        super().show_stop(news)
        banner = self.query_one("#stop", StopBanner)
        banner.display = news is not None
        if news is None:
            return
        banner.set_class(news.phase == "stopped", "-stopped")
        ending = "  (esc)" if news.phase in {"stopped", "failed"} else ""
        text = f"STOP {news.text}{ending}"
        banner.show(lambda width, height: words.wrapped(text, width, height))

    def action_leave(self) -> None:
        """Ask what becomes of the engine, if there is one to speak of."""
        if self.read_only or not self.engine.is_attached:
            self.app.exit("quit")
            return

        def decided(choice: str | None) -> None:
            if choice == "leave":
                self.app.exit("quit")
            elif choice == "stop engine":
                self.send("shutdown")

        holder = words.HOLDERS.get(self.engine.holder or "", "who has the mount is not known")
        text = f"The engine is running: {self.engine.state or 'state not known'}, {holder}."
        self.app.push_screen(LeaveDialog(text, proposes_stop=self.owns_engine), decided)

    def action_zoom(self) -> None:
        """The whole field, the close-up, the close-up pixel by pixel."""
        self._sight = (self._sight + 1) % len(SIGHTS)
        self.show_picture()
        self.mark_in_other_view()
        self.say(f"picture: {SIGHTS[self._sight]}")

    def action_stretch(self) -> None:
        """How light becomes grey."""
        self._stretch = (self._stretch + 1) % len(STRETCHES)
        self.show_picture()
        self.say(f"stretch: {STRETCHES[self._stretch]}")

    def action_open_frame(self) -> None:
        """The frame that is shown, at full resolution."""
        if self.picture is None or self.night.folder is None:
            self.say("no frame has been shown yet", "warn")
            return

        def status(width: int, rows: int) -> list[Line]:
            return words.top_lines(self.night, self.engine, self.read_only, width, rows)

        self.app.push_screen(
            FrameSheet(
                self.night.folder,
                self.picture.frame_id,
                self.night.config,
                status=status,
                alert=self._alert_elsewhere,
                keymap=self.keymap,
            )
        )

    def action_log(self) -> None:
        """All panes to the log, and back."""
        self._is_log_open = not self._is_log_open
        self.place_panes()
        log = self.query_one("#log", LogPane)
        log.can_focus = self._is_log_open
        if self._is_log_open:
            log.focus()
        else:
            self.set_focus(None)
            log.scroll_home(animate=False)
        self.show_keys()

    def action_put_away(self) -> None:
        """The mark first, then the log, then what came of a STOP, then a notice."""
        if self.marking is not None:
            self.end_mark()
        elif self._is_log_open:
            self.action_log()
        elif self.stop_news is not None and self.stop_news.phase in {"stopped", "failed"}:
            self.show_stop(None)
        else:
            self.say("")

    def action_mark(self) -> None:
        """In the picture, which the log may lie over."""
        if self._is_log_open and self.marking is None:
            self.action_log()
        super().action_mark()

    def action_filter_log(self) -> None:
        """Only lines with some words."""

        def decided(wanted: str | None) -> None:
            if wanted is None:
                return
            self.query_one("#log", LogPane).filter(wanted)
            self.say(f"log: lines with {wanted!r}" if wanted else "log: every line")

        present = self.query_one("#log", LogPane).wanted
        self.app.push_screen(LineDialog("filter the log", "nothing: every line", present), decided)

    def action_note(self) -> None:
        """A remark into the session."""
        if not self.may_act():
            return

        def decided(text: str | None) -> None:
            if text:
                self.send("note", text=text)

        self.app.push_screen(LineDialog("note", "what you want to remember"), decided)

    def text(self) -> str:
        """Every shown pane's words, for whoever cannot see the terminal."""
        return "\n".join(pane.text for pane in self.query(LinesPane) if pane.display)
