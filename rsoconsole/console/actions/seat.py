"""Base of the console's screens: their state, the right to act, sending commands.

Methods that only a derived screen can implement are empty here.
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
from rsoconsole.console.night.engine_view import EngineView, OrbitAhead
from rsoconsole.console.orbit.lines import OrbitFacts, orbit_facts, target_words
from rsoconsole.console.panes.last_line import Key
from rsoconsole.console.panes.panes import FramePane, LinesPane
from rsoconsole.console.picture.marks import Mark
from rsoconsole.console.picture.picture import DrawnPicture, Picture
from rsoconsole.console.watches.messages import StopNewsCame, call_between_messages
from rsoconsole.console.words import words
from rsoconsole.console.words.leaving import kept_words
from rsoconsole.console.words.words import present_utc_ns
from rsoconsole.control import SUPERSEDED, Command, Outcome, StopNews, mount_words
from rsoconsole.night import LogLine, NightView

if TYPE_CHECKING:
    from rsoconsole.pipeline import Outlook

Answer = TypeVar("Answer")
NEW_LINES = 20
"""Number of the log's last lines that are searched for the result of a command."""
NOTICE_S = 4.0
SEEN_AFTER_NS = 1_000_000_000
BANNER_S = 15.0
"""Seconds that a STOP that ended at rest is shown; any other stays."""


def _nothing(*_: object) -> None:
    """Do nothing: the default callback."""


class Seat(Screen[None]):
    """Holds the night's and engine's state and sends commands; derived screens show and ask."""

    night: var[NightView] = var(NightView, init=False, always_update=True)
    engine: var[EngineView] = var(EngineView, init=False, always_update=True)
    picture: var[Picture | None] = var(None, init=False, always_update=True)
    outlook: var["Outlook | None"] = var(None, init=False, always_update=True)
    orbit_ahead: var[OrbitAhead | None] = var(None, init=False, always_update=True)
    is_click = False
    """True while the action that runs was clicked, not typed."""
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
        """``seat_name``: the engine's name for this console; ``keymap``: keys of its own."""
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
        """Number of STOPs given here."""
        self._stopped_utc_ns: int | None = None
        """Time of the last STOP given here, UTC nanoseconds by the engine's clock."""
        self._is_stop_seen = False
        """True once the engine has reported, since the last STOP here, that nobody has control."""

    # -- words --------------------------------------------------------------------------------

    def say(self, text: str, ink: Ink = "title", seconds: float = NOTICE_S) -> None:
        """Show a notice over the last line, for a while."""
        self._notice, self._notice_until_s = (text, ink), time.monotonic() + seconds
        self.last_said = text or self.last_said
        self.show_keys()
        if text:
            self.set_timer(seconds + 0.1, self.show_keys)

    def open_unrequested_dialog(
        self, dialog: Dialog[Answer], decided: Callable[[Answer | None], None] | None = None
    ) -> None:
        """Open a dialog because of the engine's answer: it takes no key for a moment."""
        dialog.opens_unasked = True
        self.app.push_screen(dialog, decided)

    def log_lines_after(self, seq: int) -> list[LogLine]:
        """Return the lines recorded after that place of the log, of the last ``NEW_LINES``."""
        return [line for line in self.night.log[-NEW_LINES:] if line.seq > seq]

    def log_lines_since(self, before: NightView) -> list[LogLine]:
        """Return the lines since a view of this night; none of another night or without a name."""
        is_of_night = before.is_read and before.folder == self.night.folder
        return self.log_lines_after(before.seq) if self.seat_name and is_of_night else []

    def now_s(self) -> float:
        """Return monotonic time in seconds; tests replace it."""
        return time.monotonic()

    @property
    def is_following_again(self) -> bool:
        """True from the request to follow the kept track again until the engine does."""
        return False

    @property
    def notice(self) -> tuple[str, Ink]:
        """The notice of this moment and its colour; empty where it is over."""
        return self._notice if time.monotonic() < self._notice_until_s else ("", "")

    def forget_notice(self) -> None:
        """End the notice: what it said is done, or undone."""
        self._notice_until_s = 0.0

    def show_keys(self) -> None:
        """Draw the last line; the screen that has one does."""

    def show_stop(self, news: StopNews | None) -> None:
        """Keep the state of a STOP, None: nothing to show; a screen with a banner draws it."""
        self.stop_news = news

    @property
    def is_stopping(self) -> bool:
        """True where STOP was given here and the engine's last status is from before it."""
        news = self.stop_news
        if news is None or news.phase == "failed":
            return False
        # Its STOP is known at once, that nobody has the mount only with the loop's next turn.
        is_answered = news.phase in ("answered", "stopped")
        return not is_answered or (self.engine.is_attached and not self._is_stop_seen)

    # -- what is shown ------------------------------------------------------------------------

    def pane(self, name: str) -> LinesPane:
        """Return the pane of that name."""
        return self.query_one(f"#{name}", LinesPane)

    @property
    def drawing(self) -> DrawnPicture | None:
        """Drawing of the large pane's picture; None while nothing is drawn."""
        return self.query_one("#frame", FramePane).drawing

    def place_panes(self) -> None:
        """Lay out the panes for this terminal."""

    def show_picture(self) -> None:
        """Draw the shown frame in both picture panes."""

    def handle_view_change(self) -> None:
        """Follow a picture that lies elsewhere, or shows another piece of the frame."""

    @property
    def hides_signs(self) -> bool:
        """True where the signs of streaks would cover the streak being marked."""
        return False

    def unfinished_mark_signs(self) -> tuple[Mark, ...]:
        """Signs of the mark that is being made."""
        return ()

    @property
    def keys(self) -> list[Key]:
        """The keys that matter now."""
        return []

    @property
    def alert(self) -> str:
        """The alert in words; empty: none."""
        return ""

    @property
    def intro(self) -> str:
        """Text in the alert's place while there is no alert; empty by default."""
        return ""

    @property
    def orbit(self) -> OrbitFacts:
        """The orbit as the panes show it."""
        return orbit_facts(self.night, self.engine, self.orbit_ahead)

    def target_name(self) -> str:
        """Name of the target, as in the first line; empty: not known."""
        return target_words(self.orbit)[0].rstrip("?") or self.engine.target or ""

    def top(self, width: int, rows: int) -> list[Line]:
        """The first line: state and since when, who has control, the target, the frame clock."""
        return words.top_lines(
            self.night,
            self.engine,
            self.read_only,
            width,
            rows,
            found=target_words(self.orbit),
            kept=self.kept_words,
            is_stopping=self.is_stopping,
        )

    @property
    def kept_words(self) -> tuple[str, ...]:
        """Words on the kept track: the key to follow it again, and for how long; empty: none."""
        now, is_asked_for = present_utc_ns(self.night, self.engine), self.is_following_again
        return kept_words(self.engine, self.keymap, now, is_asked_for=is_asked_for)

    def open_session(self, folder: Path) -> None:
        """Show that recorded session."""

    # -- commands -----------------------------------------------------------------------------

    @property
    def can_act(self) -> bool:
        """True where commands of this console can reach an engine."""
        return self.engine.is_attached and not self.read_only

    def may_act(self) -> bool:
        """Return True if this console may send commands; a notice says why not."""
        if self.read_only:
            self.say("read only: this console only looks, but for STOP")
        elif not self.engine.is_attached:
            self.say("no engine answers: 'rsoconsole engine' starts one")
        return self.can_act

    def send(self, command: Command, then: Command | None = None) -> None:
        """Hand a command to the engine; its result is reported.

        ``then``: command sent right after it, if the engine has accepted it and no STOP came
        between.
        """
        self.say(f"{command.label()} …")
        came = partial(self.handle_outcome, command, self.stops, self.night.seq, then)
        self.orders.send(command, partial(call_between_messages, self, came))

    def handle_outcome(
        self, command: Command, stops: int, seq: int, then: Command | None, outcome: Outcome
    ) -> None:
        """Handle the engine's answer to a command; a screen whose keys act does.

        ``stops``: number of STOPs when it was sent; ``seq``: last known record at that time;
        ``then``: command that follows once it is accepted; None: none.
        """

    def action_hand_over(self, name: str) -> None:
        """Send the command of a key that does nothing else, where this console may act."""
        command = BY_NAME[name].sends
        if command is not None and self.may_act():
            self.send(command)

    def stop(self) -> None:
        """STOP: send it first, then put away whatever is open, then show it."""
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
        """Show how the last STOP stands: late, answered, then stopped or failed."""
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

    def check_failed_stop(self) -> None:
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
