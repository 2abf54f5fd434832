"""What every action of the seat needs: what is known, who may act, how a command is sent."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from textual.message import Message
from textual.screen import Screen

from rsoconsole.console.actions.seat_uses import Answer
from rsoconsole.console.commands import BY_NAME, Orders
from rsoconsole.console.dialogs import ArmDialog, ConfirmDialog, Dialog, MessageDialog, Result
from rsoconsole.console.drawing import Ink
from rsoconsole.console.night import EngineView, LogLine, NightView, OrbitAhead
from rsoconsole.console.picture import Picture
from rsoconsole.console.watches import OutcomeCame, StopNewsCame
from rsoconsole.console.words import words
from rsoconsole.control import (
    ON_RECORD,
    AnswerSeat,
    Arm,
    AskSeat,
    BeginMark,
    Command,
    MarkByHand,
    Outcome,
    Sender,
    Shutdown,
    StopNews,
    command_words,
    mount_words,
)

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Outlook

NOTICE_S = 4.0
SEEN_AFTER_NS = 1_000_000_000
REFUSAL_S = 10.0
MARK_SAID_S = 30.0
"""What came of a mark is said so long: it was made in a frame that lies over this screen."""
NEW_LINES = 20
"""Among so many of the log's last lines a refusal is looked for."""
BANNER_S = 15.0
"""A confirmed STOP is shown so long; one that is not confirmed stays."""


class Seat(Screen[None]):
    """Holds what is known and sends commands; the screens above it show and ask."""

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
        self.night = NightView()
        self.engine = EngineView()
        self.picture: Picture | None = None
        self.outlook: Outlook | None = None
        self.orbit_ahead: OrbitAhead | None = None
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
        self._ticked: tuple[str, ...] = ()
        """Checks that were overridden here last."""
        self._refused_at_once: list[str] = []
        """What the engine has said no to, in a dialog, and its record says once more."""
        self._stopped_utc_ns: int | None = None
        """By the engine's clock, when STOP was given here last."""
        self._is_stop_seen = False
        """Whether the engine has said since STOP was given here that nobody has the mount."""
        """The one that the engine knew of when STOP was given here last."""

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
        return news.phase != "stopped" or (self.engine.is_attached and not self._is_stop_seen)

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

    def on_outcome_came(self, message: OutcomeCame) -> None:
        """Said where it went well, asked where it did not; STOP has the last word."""
        command, outcome = message.command, message.outcome
        self.ask_now()
        if outcome.data.get(ON_RECORD):
            self._expect_refusal(command, message.seq)
        if message.stops != self.stops and not isinstance(command, Shutdown):
            return
        name = command.label()
        if outcome.ok and isinstance(command, MarkByHand):
            self.mark_is_taken(command, outcome)
        elif outcome.ok:
            self.say(self.done_words(command, outcome), "good")
            if isinstance(command, Arm):
                self.show_stop(None)
            elif isinstance(command, Shutdown):
                self.app.exit("stop engine")
            if message.then is not None:
                self.send(message.then)
        elif outcome.data.get("seat"):
            self._ask_for_seat(str(outcome.data["seat"]))
        elif isinstance(command, Arm):
            self._ask_to_override(outcome, command.override, message.then)
        elif isinstance(command, MarkByHand) and outcome.data.get("asks") == "replaces":
            self._ask_to_replace(command, outcome)
        else:
            self.say("")
            self._open_unasked(MessageDialog(f"{name}: not done", outcome.message))

    def done_words(self, command: Command, outcome: Outcome) -> str:
        """What is said of a command that the engine has taken."""
        return f"{command.label()}: {outcome.message or 'done'}"

    def mark_is_taken(self, mark: MarkByHand, outcome: Outcome) -> None:
        """By the engine, and with the next frame by the track."""
        said = f"your mark in frame {mark.frame_id} is {outcome.message or 'sent'}"
        self.say(said, "good", MARK_SAID_S)

    def _open_unasked(
        self, dialog: Dialog[Result], decided: Callable[[Result | None], None] | None = None
    ) -> None:
        """A dialog that the engine's answer opens: a key that bounces does not answer it."""
        dialog.opens_unasked = True
        self.app.push_screen(dialog, decided)

    def _ask_to_replace(self, mark: MarkByHand, outcome: Outcome) -> None:
        """A mark would take the place of what is known better: both sigmas, and enter once more."""

        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self.send(replace(mark, replaces=True))
            else:
                self.say(f"your mark in frame {mark.frame_id} is not used", "title", MARK_SAID_S)
                self.leave_marking(mark.frame_id)

        self.say("the mark waits for your word", "warn")
        own, better = (
            words.unsigned_text(float(outcome.data.get(name) or 0.0))
            for name in ("sigma_arcsec", "better_arcsec")
        )
        text = (
            f"Yours is good to ±{own}: {outcome.data.get('how', '')}.\n"
            f"Frame {mark.frame_id} has it measured to ±{better} already.\n\n"
            "Enter again takes yours instead; esc leaves it as it is."
        )
        self._open_unasked(
            ConfirmDialog("a better measurement", text, yes="Take mine", letter="m", is_yes=True),
            decided,
        )

    def _ask_for_seat(self, holder: str) -> None:
        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self.send(AskSeat())

        text = f"{holder} has control. Who is asked and says nothing for 30 s gives it up."
        self._open_unasked(
            ConfirmDialog("another console acts", text, yes="Ask for it", letter="y"), decided
        )

    @property
    def asker(self) -> str | None:
        """Who asks for this seat, where it is this console's to give."""
        is_ours = bool(self.seat_name) and self.engine.seat == self.seat_name
        return self.engine.seat_asked_by if is_ours else None

    def action_give_seat(self) -> None:
        """To anyone who asks for it."""
        self._answer_for_seat(gives=True)

    def action_keep_seat(self) -> None:
        """Though somebody asks for it."""
        self._answer_for_seat(gives=False)

    def _answer_for_seat(self, *, gives: bool) -> None:
        if self.asker is None:
            self.say("nobody asks for control")
        else:
            self.send(AnswerSeat(gives=gives, to=self.asker))

    def _ask_to_override(
        self, outcome: Outcome, ticked: tuple[str, ...], then: Command | None
    ) -> None:
        given = outcome.data.get("checks")
        checks = [check for check in given if isinstance(check, Mapping)] if given else []

        def decided(names: tuple[str, ...] | None) -> None:
            if names is not None:
                self._ticked = names
                self.send(Arm(override=names), then)

        self.say("not armed", "warn")
        self._open_unasked(ArmDialog(outcome.message, checks, ticked or self._ticked), decided)

    def stop(self) -> None:
        """STOP: act first, then put away whatever is open, then say so."""
        self.orders.stop(lambda news: self.post_from_thread(StopNewsCame(news)))
        self.stops += 1
        self._stopped_utc_ns = self.engine.now_utc_ns
        self._is_stop_seen = False
        self.say("")
        while len(self.app.screen_stack) > 1 and self.app.screen is not self:
            self.app.pop_screen()
        self.show_stop(StopNews(phase="sent", text="sent to the engine"))

    def on_stop_news_came(self, message: StopNewsCame) -> None:
        """Late, stopped or failed."""
        self.show_stop(message.news)
        if message.news.phase == "stopped":
            self.set_timer(BANNER_S, partial(self._forget_stop, message.news))
        self.ask_now()

    def _expect_refusal(self, command: Command, seq: int) -> None:
        """It is said already: its record, which may have been read by now, says nothing new."""
        words = command_words(command.verb, command.arguments())
        if not any(self._refused_here(line) == words for line in self._lines_after(seq)):
            self._refused_at_once.append(words)

    def refused_since(self, before: NightView) -> frozenset[str]:
        """Verbs of this console's commands that the record has refused since ``before``."""
        refused = (self._refused_here(line) for line in self._lines_after(before.seq))
        return frozenset(words.partition(" ")[0] for words in refused if words)

    def _lines_after(self, seq: int) -> list[LogLine]:
        return [line for line in self.night.log[-NEW_LINES:] if line.seq > seq]

    def _refused_here(self, line: LogLine) -> str:
        """The command of this console that the line says was refused; empty: none."""
        own = Sender.console(self.seat_name).words
        return line.asked.removeprefix(f"{own} ") if line.refused_by == own else ""

    def see_refusals(self, before: NightView) -> None:
        """What was accepted here and refused later is said once, where it was asked for."""
        if not self.seat_name or before.folder != self.night.folder or not before.is_read:
            return
        for line in self._lines_after(before.seq):
            refused = self._refused_here(line)
            if refused in self._refused_at_once:
                self._refused_at_once.remove(refused)
            elif refused:
                self.say(line.text.partition(": ")[2], "warn", REFUSAL_S)

    def leave_marking(self, frame_id: int | None) -> None:
        """A mark that was begun is left off: the engine need not keep the frame for it."""
        if frame_id is not None and self.can_act:
            self.orders.send(BeginMark(frame_id=frame_id, is_on=False), lambda _outcome: None)

    def see_marks(self, before: NightView) -> None:
        """What came of a mark that was made here, when it is on record."""
        if not self.seat_name or before.folder != self.night.folder or not before.is_read:
            return
        own = Sender.console(self.seat_name).words
        for line in self._lines_after(before.seq):
            if line.marked_by == own:
                self.say(f"your {line.text.partition(': ')[2]}", "good", MARK_SAID_S)

    def see_stop(self) -> None:
        """A STOP that was not confirmed is an alarm until the mount is seen to stand."""
        news, engine = self.stop_news, self.engine
        self._is_stop_seen |= engine.holder == "nobody"
        said, given = engine.mount_t_utc_ns, self._stopped_utc_ns
        if news is None or news.phase != "failed" or not engine.is_attached:
            return
        last = engine.last_stop
        is_open = last is not None and not (last.is_confirmed or last.is_over)
        has_answered = said is not None and given is not None and said > given + SEEN_AFTER_NS
        if has_answered and not engine.is_slewing and not is_open:
            where = " · ".join(mount_words(engine))
            over = StopNews(phase="stopped", text=f"was late; the mount answers again: {where}")
            self.show_stop(over)
            self.set_timer(BANNER_S, partial(self._forget_stop, over))

    def _forget_stop(self, news: StopNews) -> None:
        if self.stop_news is news:
            self.show_stop(None)

    def post_from_thread(self, message: Message) -> None:
        """Have a message handled by the application (any thread)."""
        self._from_thread(self.post_message, message)
