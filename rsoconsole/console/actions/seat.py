"""What every action of the seat needs: what is known, who may act, how a command is sent."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

from textual.message import Message
from textual.reactive import var
from textual.screen import Screen

from rsoconsole.console.actions.seat_uses import Answer
from rsoconsole.console.commands import BY_NAME, Orders
from rsoconsole.console.drawing import Ink
from rsoconsole.console.night import EngineView, OrbitAhead
from rsoconsole.console.picture import Picture
from rsoconsole.console.watches import OutcomeCame, StopNewsCame
from rsoconsole.control import (
    Command,
    Outcome,
    StopNews,
)
from rsoconsole.control.words import mount_words
from rsoconsole.night import NightView

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Outlook

NOTICE_S = 4.0
SEEN_AFTER_NS = 1_000_000_000
BANNER_S = 15.0
"""A STOP after which the mount is measured to be at rest is shown so long; any other stays."""


class Seat(Screen[None]):
    """Holds what is known and sends commands; the screens above it show and ask."""

    night: var[NightView] = var(NightView, init=False, always_update=True)
    engine: var[EngineView] = var(EngineView, init=False, always_update=True)
    picture: var[Picture | None] = var(None, init=False, always_update=True)
    outlook: var["Outlook | None"] = var(None, init=False, always_update=True)
    orbit_ahead: var[OrbitAhead | None] = var(None, init=False, always_update=True)
    is_click = False
    """The action that runs was clicked, not typed."""

    def __init__(
        self,
        orders: Orders,
        *,
        read_only: bool,
        owns_engine: bool,
        ask_now: Callable[[], None],
        from_thread: Callable[..., None],
        on_known: Callable[[NightView, EngineView], None],
        seat_name: str = "",
        keymap: Mapping[str, str] | None = None,
    ) -> None:
        """``seat_name``: by which the engine knows this console; ``keymap``: keys of its own."""
        super().__init__()
        self.keymap = dict(keymap or {})
        self.seat_name = seat_name
        self.stop_news: StopNews | None = None
        self.orders = orders
        self.read_only = read_only
        self.owns_engine = owns_engine
        self.ask_now = ask_now
        self.on_known = on_known
        self._from_thread = from_thread
        self._notice: tuple[str, Ink] = ("", "")
        self.last_said = ""
        self._notice_until_s = 0.0
        self.stops = 0
        """How often STOP was given here."""
        self._stopped_utc_ns: int | None = None
        """By the engine's clock, when STOP was given here last."""
        self._is_stop_seen = False
        """Whether the engine has said since STOP was given here that nobody has the mount."""

    # -- words --------------------------------------------------------------------------------

    def say(self, text: str, ink: Ink = "title", seconds: float = NOTICE_S) -> None:
        """A word over the last line, for a while."""
        self._notice, self._notice_until_s = (text, ink), time.monotonic() + seconds
        self.last_said = text or self.last_said
        self.show_keys()
        if text:
            self.set_timer(seconds + 0.1, self.show_keys)

    def ask(
        self, dialog: Screen[Answer], decided: Callable[[Answer | None], None] | None = None
    ) -> None:
        """Open a dialog over this screen; ``decided`` is called with its answer."""
        self.app.push_screen(dialog, decided)

    def now_s(self) -> float:
        """Seconds of a clock that nobody sets."""
        return time.monotonic()

    @property
    def is_following_again(self) -> bool:
        """Whether what is kept has been asked for, and the engine has yet to take it up."""
        return False

    @property
    def notice(self) -> tuple[str, Ink]:
        """What is to be said at this moment."""
        return self._notice if time.monotonic() < self._notice_until_s else ("", "")

    def forget_notice(self) -> None:
        """Whatever was said of it is done, or undone."""
        self._notice_until_s = 0.0

    def show_keys(self) -> None:
        """The last line; the screen that has one draws it."""

    def show_stop(self, news: StopNews | None) -> None:
        """What came of a STOP; the screen that has a banner draws it."""
        self.stop_news = news

    @property
    def is_stopping(self) -> bool:
        """Whether STOP was given here and the engine's word is still from before it."""
        news = self.stop_news
        if news is None or news.phase == "failed":
            return False
        # Its STOP is known at once, that nobody has the mount only with the loop's next turn.
        is_answered = news.phase in ("answered", "stopped")
        return not is_answered or (self.engine.is_attached and not self._is_stop_seen)

    # -- commands -----------------------------------------------------------------------------

    @property
    def can_act(self) -> bool:
        """Whether there is an engine for this seat to tell."""
        return self.engine.is_attached and not self.read_only

    def may_act(self) -> bool:
        """The same; says why not."""
        if self.read_only:
            self.say("read only: this console only looks, but for STOP")
        elif not self.engine.is_attached:
            self.say("no engine answers: 'rsoconsole engine' starts one")
        return self.can_act

    def send(self, command: Command, then: Command | None = None) -> None:
        """Hand a command to the engine; what comes of it is said.

        ``then``: sent right behind it where the engine has taken it, and no STOP came between.
        """
        self.say(f"{command.label()} …")
        stops, seq = self.stops, self.night.seq

        def came(outcome: Outcome) -> None:
            self.post_from_thread(OutcomeCame(command, outcome, stops, seq, then))

        self.orders.send(command, came)

    def take_keys(self, *parts: object) -> None:
        """Have the keys of these parts act: Textual looks for ``action_NAME`` at the screen alone.

        An action of the screen itself goes first; no two parts may have the same.
        """
        for name in (f"action_{command}" for command in BY_NAME):
            owners = [part for part in parts if hasattr(part, name)]
            if len(owners) + (name in vars(self)) > 1:
                raise TypeError(f"{name} is in more than one part of {type(self).__name__}")
            if owners and not hasattr(type(self), name):
                setattr(self, name, getattr(owners[0], name))

    def action_hand_over(self, name: str) -> None:
        """What a key does that only has a command to send: where this seat may act."""
        command = BY_NAME[name].sends
        if command is not None and self.may_act():
            self.send(command)

    def stop(self) -> None:
        """STOP: act first, then put away whatever is open, then say so."""
        number = self.stops + 1
        self.orders.stop(lambda news: self.post_from_thread(StopNewsCame(news, number)))
        self.stops = number
        self._stopped_utc_ns = self.engine.now_utc_ns
        self._is_stop_seen = False
        self.say("")
        while len(self.app.screen_stack) > 1 and self.app.screen is not self:
            self.app.pop_screen()
        self.show_stop(StopNews(phase="sent", text="sent to the engine"))

    def on_stop_news_came(self, message: StopNewsCame) -> None:
        """Late, answered and being measured, then stopped or failed; of the last STOP alone."""
        if message.number not in (None, self.stops):
            return
        if message.news.is_superseded:
            self.show_stop(None)
            self.say("another order came before STOP was measured to its end", "warn")
            self.ask_now()
            return
        self.show_stop(message.news)
        if message.news.phase == "stopped":
            self.set_timer(BANNER_S, partial(self._forget_stop, message.news))
        self.ask_now()

    def see_stop(self) -> None:
        """A STOP that failed is an alarm until the mount is measured to be at rest."""
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
            over = StopNews(phase="stopped", text=f"was late; the mount is at rest: {where}")
            self.show_stop(over)
            self.set_timer(BANNER_S, partial(self._forget_stop, over))

    def _forget_stop(self, news: StopNews) -> None:
        if self.stop_news is news:
            self.show_stop(None)

    def post_from_thread(self, message: Message) -> None:
        """Have a message handled by the application (any thread)."""
        self._from_thread(self.post_message, message)
