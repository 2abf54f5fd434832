"""The live screen: owns what is known, hands it to the panes, turns keys into intentions."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.screen import Screen

from rsoconsole.console import panels, words
from rsoconsole.console.dialogs import ArmDialog, ConfirmDialog, LeaveDialog, MessageDialog
from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.facts import fact_lines
from rsoconsole.console.fold import Name, banner_box, fold
from rsoconsole.console.key_line import key_line, keys_for
from rsoconsole.console.log_pane import LogPane
from rsoconsole.console.messages import (
    EngineSeen,
    NightSeen,
    OutcomeCame,
    OutlookSeen,
    StopNewsCame,
)
from rsoconsole.console.night import NightView
from rsoconsole.console.orders import Orders
from rsoconsole.console.panes import SIGHTS, FramePane, LinesPane, Sight, StopBanner
from rsoconsole.console.picture import STRETCHES, Drawing, Picture
from rsoconsole.console.plot import Ink
from rsoconsole.console.stop import StopNews
from rsoconsole.control import Outcome

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Outlook

NOTICE_S = 4.0
BANNER_S = 15.0
"""A confirmed STOP is shown so long; one that is not confirmed stays."""
DEFAULT_ASPECT = 4 / 3


class LiveScreen(Screen[None]):
    """The operator's seat over a night, live or recorded."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("a", "arm_or_disarm", "Arm or disarm"),
        Binding("h", "hold_or_resume", "Hold or resume"),
        Binding("p", "park", "Park"),
        Binding("z", "zoom", "Zoom"),
        Binding("f", "stretch", "Stretch"),
        Binding("l", "log", "The whole log, and back"),
        Binding("escape", "put_away", "Put away"),
        Binding("q", "leave", "Leave the console"),
    ]
    CSS = """
    LiveScreen { layers: base over; overflow: hidden; }
    LiveScreen > LinesPane, LiveScreen > FramePane, LiveScreen > LogPane { position: absolute; }
    LiveScreen > #alert { background: $error; color: $text; text-style: bold; text-wrap: wrap; }
    LiveScreen > #top { background: $panel; }
    LiveScreen > #keys { background: $panel; }
    """

    def __init__(
        self,
        orders: Orders,
        *,
        read_only: bool,
        owns_engine: bool,
        ask_now: Callable[[], None],
        from_thread: Callable[..., None],
        on_known: Callable[[NightView, EngineView], None],
    ) -> None:
        super().__init__()
        self.night = NightView()
        self.engine = EngineView()
        self.picture: Picture | None = None
        self.outlook: Outlook | None = None
        self.stop_news: StopNews | None = None
        self._orders = orders
        self._read_only = read_only
        self._owns_engine = owns_engine
        self._ask_now = ask_now
        self._from_thread = from_thread
        self._on_known = on_known
        self._notice: tuple[str, Ink] = ("", "")
        self._notice_until_s = 0.0
        self._stops = 0
        self._is_log_open = False
        self._sight = 0
        self._stretch = 0

    def compose(self) -> ComposeResult:
        """Every pane; where each lies depends on the terminal."""
        yield LinesPane(id="top")
        yield LinesPane(id="alert")
        yield FramePane(self._picture_words, id="frame")
        yield FramePane(self._picture_words, id="closeup")
        for name in ("confidence", "east", "north", "nis", "facts"):
            yield LinesPane(id=name)
        yield LogPane(id="log")
        yield LinesPane(id="keys")
        yield StopBanner(id="stop")

    def on_mount(self) -> None:
        """First paint."""
        self._place()
        self._show_night()
        self._show_engine()

    def on_resize(self) -> None:
        """Another terminal, other places."""
        self._place()

    # -- what is known ----------------------------------------------------------------------

    def on_night_seen(self, message: NightSeen) -> None:
        """The session has grown."""
        has_other_shape = self._aspect(message.picture) != self._aspect(self.picture)
        self.night, self.picture = message.night, message.picture
        if has_other_shape:
            self._place()
        self._show_night()
        self._show_engine()

    def on_engine_seen(self, message: EngineSeen) -> None:
        """The engine's word."""
        if message.engine.holder != self.engine.holder:
            # Whatever was said of it is done, or undone: the first line has it now.
            self._notice_until_s = 0.0
        self.engine = message.engine
        self._show_engine()

    def on_outlook_seen(self, message: OutlookSeen) -> None:
        """What the next hours bring."""
        self.outlook = message.outlook
        self._show_engine()

    def _show_night(self) -> None:
        night = self.night
        self._show_picture()
        self._pane("confidence").show(partial(panels.confidence_lines, night))
        self._pane("east").show(partial(panels.residual_lines, night, "east"))
        self._pane("north").show(partial(panels.residual_lines, night, "north"))
        self._pane("nis").show(partial(panels.nis_lines, night))
        self.query_one("#log", LogPane).show(night.log)

    def _show_picture(self) -> None:
        """The sight chosen in the large pane; in the small one the other."""
        large, stretch = SIGHTS[self._sight], STRETCHES[self._stretch]
        small: Sight = "close-up" if large == "field" else "field"
        told = (self.night.frame, stretch)
        self.query_one("#frame", FramePane).show(self.picture, large, stretch, told)
        self.query_one("#closeup", FramePane).show(self.picture, small, stretch, told)

    def _picture_words(
        self, picture: Picture | None, sight: Sight, drawing: Drawing | None
    ) -> tuple[str, str]:
        stretch = STRETCHES[self._stretch]
        if sight == "field":
            title, caption = words.frame_title(self.night, picture), words.frame_caption(picture)
        else:
            title = words.closeup_title(picture, drawing)
            caption = words.closeup_caption(picture)
        return title if stretch == "streaks" else f"{title} · {stretch}", caption

    def _show_engine(self) -> None:
        night, engine = self.night, self.engine
        self._on_known(night, engine)
        self._pane("top").show(partial(words.top_lines, night, engine))
        self._pane("facts").show(partial(fact_lines, night, engine, self.outlook))
        alert = words.alert_text(night, engine)
        if bool(alert) != self._pane("alert").display:
            self._place()
        self._pane("alert").show(lambda width, height: words.wrapped(f" {alert}", width, height))
        self._show_keys()

    def _show_keys(self) -> None:
        notice = self._notice if time.monotonic() < self._notice_until_s else ("", "")
        can_act = self.engine.is_attached and not self._read_only
        self._pane("keys").show(key_line(keys_for(self.engine, can_act=can_act), notice))

    # -- where it lies ----------------------------------------------------------------------

    def _place(self) -> None:
        width, height = self.size
        has_alert = bool(words.alert_text(self.night, self.engine))
        boxes = fold(
            width,
            height,
            has_alert=has_alert,
            is_log_open=self._is_log_open,
            aspect=self._aspect(self.picture),
        )
        names: tuple[Name, ...] = (
            *("top", "alert", "frame", "closeup", "confidence", "east"),
            *("north", "nis", "facts", "log", "keys"),
        )
        for name in names:
            widget, box = self.query_one(f"#{name}"), boxes.get(name)
            widget.display = box is not None
            if box is not None:
                widget.styles.offset = (box.x, box.y)
                widget.styles.width, widget.styles.height = box.width, box.height
        banner, box = self.query_one("#stop"), banner_box(width, height, has_alert=has_alert)
        banner.styles.height = box.height
        banner.styles.offset = (0, box.y)

    @staticmethod
    def _aspect(picture: Picture | None) -> float:
        return picture.aspect if picture is not None else DEFAULT_ASPECT

    def _pane(self, name: str) -> LinesPane:
        return self.query_one(f"#{name}", LinesPane)

    # -- intentions -------------------------------------------------------------------------

    def stop(self) -> None:
        """STOP: act first, then put away whatever is open, then say so."""
        self._orders.stop(lambda news: self._post(StopNewsCame(news)))
        self._stops += 1
        self.say("")
        while len(self.app.screen_stack) > 1 and self.app.screen is not self:
            self.app.pop_screen()
        self._show_stop(StopNews(phase="sent", text="sent to the engine"))

    def on_stop_news_came(self, message: StopNewsCame) -> None:
        """Late, stopped or failed."""
        self._show_stop(message.news)
        if message.news.phase == "stopped":
            self.set_timer(BANNER_S, partial(self._forget_stop, message.news))
        self._ask_now()

    def _forget_stop(self, news: StopNews) -> None:
        if self.stop_news is news:
            self._show_stop(None)

    def _show_stop(self, news: StopNews | None) -> None:
        self.stop_news = news
        banner = self.query_one("#stop", StopBanner)
        banner.display = news is not None
        if news is None:
            return
        banner.set_class(news.phase == "stopped", "-stopped")
        ending = "  (esc)" if news.phase in {"stopped", "failed"} else ""
        text = f"STOP {news.text}{ending}"
        banner.show(lambda width, height: words.wrapped(text, width, height))

    def action_arm_or_disarm(self) -> None:
        """Whoever has the mount gives it up."""
        if self._may_act():
            self._send("disarm" if self.engine.holder == "autonomy" else "arm")

    def action_hold_or_resume(self) -> None:
        """No slews for now; or give the mount back to autonomy."""
        if not self._may_act():
            return
        if self.engine.wants_resuming:
            self._send("resume")
        elif self.engine.holder == "autonomy":
            self._send("hold")
        else:
            self.say("nothing to hold: the engine is not armed", "warn")

    def action_park(self) -> None:
        """Ask, then disarm and park."""
        if not self._may_act():
            return

        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self._send("park")

        text = "The engine disarms and sends the mount to its park position."
        dialog = ConfirmDialog("park the mount", text, yes="Park", letter="y")
        self.app.push_screen(dialog, decided)

    def action_unpark(self) -> None:
        """Release a parked mount; nothing moves."""
        if self._may_act():
            self._send("unpark")

    def _may_act(self) -> bool:
        """Whether there is an engine for this seat to tell; says why not."""
        if self._read_only:
            self.say("this seat only looks: 'rsoconsole console' without --read-only may act")
        elif not self.engine.is_attached:
            self.say("no engine answers: 'rsoconsole engine' starts one")
        else:
            return True
        return False

    def _send(self, verb: str, **arguments: Any) -> None:
        self.say(f"{verb} …")
        stops = self._stops

        def came(outcome: Outcome) -> None:
            self._post(OutcomeCame(verb, outcome, stops))

        self._orders.send(verb, came, **arguments)

    def on_outcome_came(self, message: OutcomeCame) -> None:
        """Said where it went well, asked where it did not; STOP has the last word."""
        verb, outcome = message.verb, message.outcome
        self._ask_now()
        if message.stops != self._stops and verb != "shutdown":
            return
        if outcome.ok:
            self.say(f"{verb}: {outcome.message or 'done'}", "good")
            if verb == "arm":
                self._show_stop(None)
            elif verb == "shutdown":
                self.app.exit("stop engine")
        elif verb == "arm":
            self._ask_to_override(outcome)
        else:
            self.app.push_screen(MessageDialog(f"{verb}: not done", outcome.message))

    def _ask_to_override(self, outcome: Outcome) -> None:
        given = outcome.data.get("checks")
        checks = [check for check in given if isinstance(check, Mapping)] if given else []

        def decided(names: tuple[str, ...] | None) -> None:
            if names is not None:
                self._send("arm", override=list(names))

        self.say("not armed", "warn")
        self.app.push_screen(ArmDialog(outcome.message, checks), decided)

    def action_leave(self) -> None:
        """Ask what becomes of the engine, if there is one to speak of."""
        if self._read_only or not self.engine.is_attached:
            self.app.exit("quit")
            return

        def decided(choice: str | None) -> None:
            if choice == "leave":
                self.app.exit("quit")
            elif choice == "stop engine":
                self._send("shutdown")

        holder = words.HOLDERS.get(self.engine.holder or "", "who has the mount is not known")
        text = f"The engine is running: {self.engine.state or 'state not known'}, {holder}."
        self.app.push_screen(LeaveDialog(text, proposes_stop=self._owns_engine), decided)

    def action_zoom(self) -> None:
        """The whole field, the close-up, the close-up pixel by pixel."""
        self._sight = (self._sight + 1) % len(SIGHTS)
        self._show_picture()
        self.say(f"picture: {SIGHTS[self._sight]}")

    def action_stretch(self) -> None:
        """How light becomes grey."""
        self._stretch = (self._stretch + 1) % len(STRETCHES)
        self._show_picture()
        self.say(f"stretch: {STRETCHES[self._stretch]}")

    def action_log(self) -> None:
        """All panes to the log, and back."""
        self._is_log_open = not self._is_log_open
        self._place()
        log = self.query_one("#log", LogPane)
        log.can_focus = self._is_log_open
        if self._is_log_open:
            log.focus()
        else:
            self.set_focus(None)
            log.scroll_home(animate=False)

    def action_put_away(self) -> None:
        """The log first, then what came of a STOP, then a notice."""
        if self._is_log_open:
            self.action_log()
        elif self.stop_news is not None and self.stop_news.phase in {"stopped", "failed"}:
            self._show_stop(None)
        else:
            self.say("")

    def say(self, text: str, ink: Ink = "title") -> None:
        """A word in the last line, for a while."""
        self._notice, self._notice_until_s = (text, ink), time.monotonic() + NOTICE_S
        self._show_keys()
        if text:
            self.set_timer(NOTICE_S + 0.1, self._show_keys)

    def _post(self, message: Message) -> None:
        self._from_thread(self.post_message, message)

    def text(self) -> str:
        """Every shown pane's words, for whoever cannot see the terminal."""
        return "\n".join(pane.text for pane in self.query(LinesPane) if pane.display)
