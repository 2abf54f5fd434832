"""Base of the console's screens: shared state, permission to act, sending of commands.

A method that only a derived screen can implement does nothing here.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from textual.reactive import var
from textual.screen import Screen

from rsoconsole.console.commands.commands import BY_NAME
from rsoconsole.console.commands.keymap import Orders
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.night.engine_view import EngineView, OrbitPrediction
from rsoconsole.console.orbit.lines import OrbitPaneContents, orbit_pane_contents, target_words
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.panes.last_line import Key
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.picture.marks import Mark
from rsoconsole.console.picture.picture import DrawnPicture, Picture
from rsoconsole.console.watches.messages import StopNewsCame, call_between_messages
from rsoconsole.console.words import words
from rsoconsole.console.words.facts import aim_reason
from rsoconsole.console.words.leaving import kept_words
from rsoconsole.console.words.words import frame_clock_utc_ns
from rsoconsole.control import SUPERSEDED, Command, Outcome, StopNews, mount_words
from rsoconsole.night import LogLine, NightView

if TYPE_CHECKING:
    from rsoconsole.pipeline import SkyOutlook

Answer = TypeVar("Answer")
NEW_LINES = 20
"""Number of the log's last lines that are searched for the result of a command."""
NOTICE_S = 4.0
SEEN_AFTER_NS = 1_000_000_000
BANNER_S = 15.0
"""Seconds that the banner of a STOP that ended at rest is shown; any other banner stays."""


def _nothing(*_: object) -> None:
    """Do nothing: the default callback."""


class OperatorScreen(Screen[None]):
    """Base screen: holds the state of night and engine and sends the operator's commands."""

    night: var[NightView] = var(NightView, init=False, always_update=True)
    engine: var[EngineView] = var(EngineView, init=False, always_update=True)
    picture: var[Picture | None] = var(None, init=False, always_update=True)
    outlook: var["SkyOutlook | None"] = var(None, init=False, always_update=True)
    orbit_ahead: var[OrbitPrediction | None] = var(None, init=False, always_update=True)
    is_click = False
    is_log_open = False
    is_orbit_open = False

    def __init__(
        self,
        orders: Orders,
        *,
        read_only: bool = False,
        ask_now: Callable[[], None] = _nothing,
        on_known: Callable[[NightView, EngineView], None] = _nothing,
        seat_name: str = "",
        keymap: Mapping[str, str] | None = None,
    ) -> None:
        """Make a screen that knows no night and no engine yet.

        ``orders``: sends the commands.
        ``read_only``: True where no command but STOP may be sent.
        ``ask_now``: has the engine's status requested at once.
        ``on_known``: to be called with night and engine whenever one of them has changed.
        ``seat_name``: the engine's name for this console.
        ``keymap``: other keys for commands, by the command's name.
        """
        super().__init__()
        self.keymap = dict(keymap or {})
        self.seat_name = seat_name
        self.stop_news: StopNews | None = None
        self.orders = orders
        self.read_only = read_only
        self.ask_now = ask_now
        self.on_known = on_known
        self._notice: tuple[str, Ink] = ("", "")
        self.last_said = ""
        self._notice_until_s = 0.0
        self.stops = 0
        self._stopped_utc_ns: int | None = None
        """Time of the last STOP given at this console, UTC nanoseconds by the engine's clock."""
        self._is_stop_seen = False
        """True once the engine has reported that nobody has control, since the last STOP here."""

    # -- words --------------------------------------------------------------------------------

    def say(self, text: str, ink: Ink = "title", seconds: float = NOTICE_S) -> None:
        """Show a notice in the last line for ``seconds``; an empty ``text`` clears it."""
        self._notice, self._notice_until_s = (text, ink), time.monotonic() + seconds
        self.last_said = text or self.last_said
        self.show_keys()
        if text:
            self.set_timer(seconds + 0.1, self.show_keys)

    def open_unrequested_dialog(
        self, dialog: Dialog[Answer], decided: Callable[[Answer | None], None] | None = None
    ) -> None:
        """Open a dialog that no key asked for; it ignores keys for a moment.

        ``decided``: called with the dialog's result.
        """
        dialog.opens_unasked = True
        self.app.push_screen(dialog, decided)

    def log_lines_after(self, seq: int) -> list[LogLine]:
        """Return those of the log's last ``NEW_LINES`` lines that were recorded after ``seq``."""
        return [line for line in self.night.log[-NEW_LINES:] if line.seq > seq]

    def log_lines_since(self, before: NightView) -> list[LogLine]:
        """Return the log's lines since an earlier view of the night.

        Empty where ``before`` is of another night or not fully read, or this console has no name.
        """
        is_of_night = before.is_read and before.folder == self.night.folder
        return self.log_lines_after(before.seq) if self.seat_name and is_of_night else []

    def now_s(self) -> float:
        """Return monotonic time, seconds; tests replace this method."""
        return time.monotonic()

    @property
    def is_following_again(self) -> bool:
        """True from the request to follow the kept track again until the engine follows it."""
        return False

    @property
    def notice(self) -> tuple[str, Ink]:
        """The present notice and its ink; an empty text once its time is over."""
        return self._notice if time.monotonic() < self._notice_until_s else ("", "")

    def forget_notice(self) -> None:
        """End the notice at once: what it announced is done or undone."""
        self._notice_until_s = 0.0

    def show_keys(self) -> None:
        """Draw the last line; does nothing here, screens with a last line override it."""

    def show_stop(self, news: StopNews | None) -> None:
        """Set the state of the last STOP; None: none to show. A screen with a banner draws it."""
        self.stop_news = news

    @property
    def is_stopping(self) -> bool:
        """True from a STOP given here until the engine has reported its effect, or STOP failed."""
        news = self.stop_news
        if news is None or news.phase == "failed":
            return False
        # Its STOP is known at once, that nobody has the mount only with the loop's next turn.
        is_answered = news.phase in ("answered", "stopped")
        return not is_answered or (self.engine.is_attached and not self._is_stop_seen)

    # -- what is shown ------------------------------------------------------------------------

    def pane(self, name: str) -> LinesPane:
        """Return the pane of lines with this id."""
        return self.query_one(f"#{name}", LinesPane)

    def picture_panes(self) -> tuple[FramePane, FramePane]:
        """Return the main picture pane and the one beside it, which is not always visible."""
        frame, closeup = (self.query_one(name, FramePane) for name in ("#frame", "#closeup"))
        return (closeup, frame) if closeup.display else (frame, closeup)

    @property
    def drawing(self) -> DrawnPicture | None:
        """The picture of the main pane as it is drawn; None while nothing is drawn."""
        return self.picture_panes()[0].drawing

    def look_closely(self) -> None:
        """Show the close-up in the main pane; does nothing here."""

    @property
    def is_marking(self) -> bool:
        """True while a mark is made by hand; False here."""
        return False

    def place_panes(self) -> None:
        """Lay out the panes for the terminal's size; does nothing here."""

    def show_picture(self) -> None:
        """Draw the shown frame in both picture panes; does nothing here."""

    def show_bounds_on_trial(self, sigmas_arcsec: Mapping[int, tuple[float, float]]) -> None:
        """Show bounds by the settings on trial in the plots; does nothing here."""

    @property
    def aims_by_orbit(self) -> bool:
        """True where an orbit predicts the next aim."""
        return aim_reason(self.night, self.engine).startswith("orbit")

    def handle_view_change(self) -> None:
        """React to a picture that has moved or shows another part of its frame; does nothing
        here.
        """

    @property
    def hides_signs(self) -> bool:
        """True where the streaks' signs are hidden, since they would cover a mark's ends."""
        return False

    def unfinished_mark_signs(self) -> tuple[Mark, ...]:
        """Return the signs of the unfinished mark; an empty tuple here."""
        return ()

    @property
    def keys(self) -> list[Key]:
        """The keys that the last line shows; an empty list here."""
        return []

    @property
    def alert_words(self) -> str:
        """The alert in words; empty: there is none."""
        return ""

    @property
    def night_intro(self) -> str:
        """The text in the alert's place while there is no alert; empty here."""
        return ""

    @property
    def orbit(self) -> OrbitPaneContents:
        """What the orbit pane shows."""
        return orbit_pane_contents(self.night, self.engine, self.orbit_ahead)

    def target_name(self) -> str:
        """Return the target's name, as in the first line; empty: not known."""
        return target_words(self.orbit)[0].rstrip("?") or self.engine.target or ""

    def top_lines(self, width: int, rows: int) -> list[Line]:
        """Build the first lines: state, its duration, who has control, target, frame clock."""
        return words.top_lines(
            self.night,
            self.engine,
            self.read_only,
            width,
            rows,
            found=target_words(self.orbit),
            kept=self.kept_track_words,
            is_stopping=self.is_stopping,
        )

    @property
    def kept_track_words(self) -> tuple[str, ...]:
        """Words on the kept track and its key, in several lengths, longest first; or empty."""
        now, is_asked_for = frame_clock_utc_ns(self.night, self.engine), self.is_following_again
        return kept_words(self.engine, self.keymap, now, is_asked_for=is_asked_for)

    def open_session(self, folder: Path) -> None:
        """Show a recorded session; does nothing here."""

    # -- commands -----------------------------------------------------------------------------

    @property
    def can_act(self) -> bool:
        """True where this console can reach an engine and is not read-only."""
        return self.engine.is_attached and not self.read_only

    def check_can_act(self) -> bool:
        """Return whether this console may send commands; if not, show a notice that says why."""
        if self.read_only:
            self.say("read only: this console only looks, but for STOP")
        elif not self.engine.is_attached:
            self.say("no engine answers: 'rsoconsole engine' starts one")
        return self.can_act

    def send(self, command: Command, then: Command | None = None) -> None:
        """Send a command to the engine; ``handle_outcome`` gets the answer.

        ``then``: command to send after it, once the engine has accepted it and if no STOP came
        between.
        """
        self.say(f"{command.label()} …")
        came = partial(self.handle_outcome, command, self.stops, self.night.seq, then)
        self.orders.send(command, partial(call_between_messages, self, came))

    def handle_outcome(
        self, command: Command, stops: int, seq: int, then: Command | None, outcome: Outcome
    ) -> None:
        """Handle the engine's answer to a command; empty here, screens whose keys act override it.

        ``stops``: number of STOPs given when the command was sent.
        ``seq``: last record of the log that was known when the command was sent.
        ``then``: command to send once this one is accepted; None: none.
        """

    def action_hand_over(self, name: str) -> None:
        """Send the engine command of the key command named ``name``, if this console may act."""
        command = BY_NAME[name].sends
        if command is not None and self.check_can_act():
            self.send(command)

    def stop(self) -> None:
        """Send STOP first, then close whatever lies over this screen, then show the banner."""
        number = self.stops + 1
        came = self.on_stop_news_came
        self.orders.stop(lambda news: call_between_messages(self, came, StopNewsCame(news, number)))
        self.stops = number
        self._stopped_utc_ns = self.engine.now_utc_ns
        self._is_stop_seen = False
        self.say("")
        while len(self.app.screen_stack) > 1 and self.app.screen is not self:
            self.app.pop_screen()
        self.show_stop(StopNews(phase="sent", text="sent to the engine"))

    def on_stop_news_came(self, message: StopNewsCame) -> None:
        """Show the state of the last STOP: late, answered, then stopped or failed."""
        if message.number not in (None, self.stops):
            return
        if message.news.is_superseded:
            self.show_stop(None)
            self.say(SUPERSEDED, "warn")
            self.ask_now()
            return
        self.show_stop(message.news)
        if message.news.phase == "stopped":
            self.set_timer(BANNER_S, partial(self._forget_stop, message.news))
        self.ask_now()

    def end_failed_stop_alarm(self) -> None:
        """End the alarm of a failed STOP once the mount is measured to be at rest."""
        news, engine = self.stop_news, self.engine
        self._is_stop_seen |= engine.holder == "nobody"
        said, given = engine.mount_t_utc_ns, self._stopped_utc_ns
        if news is None or news.phase != "failed" or not engine.is_attached:
            return
        last = engine.last_stop
        is_open = last is not None and not (last.is_at_rest or last.is_over)
        has_answered = said is not None and given is not None and said > given + SEEN_AFTER_NS
        is_at_rest = engine.mount_motion in ("stands", "tracks")
        if has_answered and is_at_rest and not is_open:
            where = " · ".join(mount_words(engine))
            over = StopNews(phase="stopped", text=f"was late; by now the mount is at rest: {where}")
            self.show_stop(over)
            self.set_timer(BANNER_S, partial(self._forget_stop, over))

    def _forget_stop(self, news: StopNews) -> None:
        if self.stop_news is news:
            self.show_stop(None)
