"""The live screen: the night's present state, and the keys that act."""

import math
from pathlib import Path
from typing import Any, ClassVar

from textual import events
from textual.binding import BindingType

from rsoconsole.base import RsoconsoleError
from rsoconsole.console.actions.command_outcomes import CommandOutcomes
from rsoconsole.console.actions.mark_actions import late_mark_reason
from rsoconsole.console.actions.nudge_actions import NudgeActions
from rsoconsole.console.actions.second_press import REPEAT_S, TwoPressKeys, has_track
from rsoconsole.console.actions.streak_actions import StreakActions
from rsoconsole.console.actions.telescope_actions import TelescopeActions
from rsoconsole.console.actions.track_actions import LiveTrackActions
from rsoconsole.console.commands.keymap import bindings, first_key
from rsoconsole.console.dialogs.ask import LineDialog
from rsoconsole.console.dialogs.candidates import MARKED, CandidatesDialog
from rsoconsole.console.dialogs.dialogs import LeaveDialog
from rsoconsole.console.dialogs.tour import intro_text
from rsoconsole.console.frame.sheet_actions import MarkCallbacks
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.panes.last_line import Key, Mode, live_keys
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.screens._pane_places import frame_aspect
from rsoconsole.console.screens.night_screen import KNOWN, Draw, NightScreen
from rsoconsole.console.screens.review import HEAD, ReviewScreen
from rsoconsole.console.watches.messages import Pointed
from rsoconsole.console.watches.sheet_worker import read_night_frame
from rsoconsole.console.words import words
from rsoconsole.control import (
    Command,
    MarkByHand,
    Note,
    Nudge,
    Outcome,
    Shutdown,
    StopNews,
    motion_words,
    mount_holder_words,
)
from rsoconsole.night import NightView
from rsoconsole.session import SessionReader


class LiveScreen(NightScreen, LiveTrackActions, CommandOutcomes, NudgeActions):
    """The operator's screen of a night that goes on, or of a session shown read-only."""

    BINDINGS: ClassVar[list[BindingType]] = [*bindings("live")]
    _key_before = ""
    _key_before_s = -math.inf
    """Time at which that key was typed, monotonic seconds."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.twice = TwoPressKeys(self)
        self.streaks = StreakActions(self, self.twice)
        self.telescope = TelescopeActions(self, self.twice, self.take_back_drop)
        # Textual looks for an action at the screen alone.
        for part in (self.streaks, self.telescope):
            for name in dir(part):
                if name.startswith("action_"):
                    setattr(self, name, getattr(part, name))

    def on_key(self, event: events.Key) -> None:
        """Pass arrows and enter to an unfinished mark.

        A key other than the last one cancels a command that waits for the second press of its key,
        or after that for the moment to be carried out.
        """
        if event.key != self._key_before:
            self.twice.press.forget()
        elif event.time - self._key_before_s < REPEAT_S:
            self.twice.press.note_repeat(self.now_s())
        self._key_before, self._key_before_s = event.key, event.time
        if self.handle_mark_key(event.key):
            event.stop()
            event.prevent_default()

    # -- what is known ----------------------------------------------------------------------

    def update_night(self, night: NightView, picture: Picture | None) -> None:
        """Show a new state of the night, or another night, with its newest picture."""
        has_other_shape = frame_aspect(picture) != frame_aspect(self.picture)
        if night.folder != self.night.folder:
            self.drop_mark_on_new_session()
            self.streaks.forget_choice()
        before, self.night = self.night, night
        self.report_refusals(before)
        self.telescope.handle_refused_verbs(self.refused_verbs_since(before))
        self.report_mark_result(before)
        self.receive_picture(picture)
        if has_other_shape:
            self.place_panes()
        self.tune.refresh_stale_figures()

    def update_engine(self, engine: EngineView) -> None:
        """Take the engine's new status."""
        before, self.engine = self.engine, engine
        if before.holder != self.engine.holder:
            # Whatever was said of it is done, or undone: the first line has it now.
            self.forget_notice()
        self.telescope.handle_control_change(before)
        self.end_failed_stop_alarm()

    def handle_outcome(
        self, command: Command, stops: int, seq: int, then: Command | None, outcome: Outcome
    ) -> None:
        """Handle the engine's answer to a command. Arguments as in the base class."""
        self.telescope.handle_outcome(command, outcome)
        if isinstance(command, Nudge):
            self.is_nudging = False
        super().handle_outcome(command, stops, seq, then, outcome)
        self.show_top()  # what was asked for is perhaps on its way no longer

    def on_pointed(self, message: Pointed) -> None:
        """Set an end of an unfinished mark, or choose the clicked streak."""
        if self.marking is not None:
            self.set_mark_end(message)
        elif not message.is_release:
            self.streaks.click(message)

    def stop(self) -> None:
        """Send STOP, and cancel every command of a key pressed before that still waits.

        It waits for the second press of its key, or after that for the moment to be carried out.
        """
        self.telescope.handle_stop()
        self.twice.press.forget()
        super().stop()

    @property
    def is_following_again(self) -> bool:
        """True from the request to follow the kept track again until the engine follows it."""
        return self.telescope.is_following_again

    def draw_dependencies(self) -> dict[Draw, tuple[str, ...]]:
        """Return each drawing function with the names of the reactives that it draws.

        To those of any night it adds the application's part and the words of a STOP.
        """
        return {
            self._make_known: ("night", "engine"),
            self._show_log_that_is_read: ("engine",),
            **super().draw_dependencies(),
            self.show_stop_words: KNOWN,
        }

    def _make_known(self) -> None:
        self.outlook_watch.update(self.night, self.engine)
        self.on_known(self.night, self.engine)

    def _show_log_that_is_read(self) -> None:
        if not self.night.is_read:
            self.show_log()

    def stop_words(self, news: StopNews) -> str:
        """Return the state of a STOP in words; after its end also the key to press next."""
        said, engine = super().stop_words(news), self.engine
        if news.phase != "stopped" or not engine.is_attached or engine.holder != "nobody":
            return said
        arm = first_key("arm_or_disarm", self.keymap)
        kept = self.kept_track_words or (f"{arm} arms it again",)
        return f"{said}. {engine.state}: disarmed. {kept[0]}"

    @property
    def alert_words(self) -> str:
        """Another console's request for control, and the alert, in words; empty: neither."""
        give, keep = (first_key(name, self.keymap) for name in ("give_seat", "keep_seat"))
        asker = self.control_requester
        asked = f"{asker} asks for control: {give} gives it, {keep} keeps it" if asker else ""
        said = words.alert_text(self.night, self.engine)
        return " · ".join(part for part in (asked, said) if part)

    @property
    def night_intro(self) -> str:
        """Introduction to a simulated night in words; empty for other nights."""
        return intro_text(self.night, self.engine, self.keymap)

    @property
    def keys(self) -> list[Key]:
        """The keys that the last line shows."""
        return live_keys(
            self.engine,
            can_act=self.can_act,
            mode=self.mode,
            keymap=self.keymap,
            is_in_cloud=self.night.is_in_cloud,
            has_several=len(self.night.tracks) > 1,
        )

    @property
    def mode(self) -> Mode:
        """What the keys mean now."""
        return "mark" if self.marking is not None else super().mode

    # -- the console's own keys -----------------------------------------------------------------

    def action_leave(self) -> None:
        """Leave the console; first ask whether to keep the engine running, if it is attached.

        A console that may only read leaves without asking.
        """
        if self.read_only or not self.engine.is_attached:
            self.app.exit("quit")
            return

        def decided(choice: str | None) -> None:
            if choice == "leave":
                self.app.exit("quit")
            elif choice == "stop engine":
                self.send(Shutdown())

        is_moving = bool(self.engine.is_slewing)
        is_left_alone = is_moving and self.engine.holder != "autonomy"
        dialog = LeaveDialog(self._running_words, proposes_staying=is_left_alone)
        self.app.push_screen(dialog, decided)

    def _running_words(self) -> str:
        """Return what the engine does now, for an operator who leaves."""
        engine = self.engine
        holder = mount_holder_words(engine.holder, "seat")
        text = f"The engine is running: {engine.state or 'state not known'}, {holder}."
        if engine.is_slewing:
            text += f" THE TELESCOPE IS MOVING: {motion_words(engine)}."
        if has_track(engine):
            text += f" It follows {self.twice.track_words()}."
        return text

    def action_put_away(self) -> None:
        """Cancel an unfinished mark; without one close the uppermost overlay."""
        if self.marking is not None:
            self.cancel_mark()
        else:
            super().action_put_away()

    def action_mark(self) -> None:
        """Begin a mark, with the picture in view; pressed again: cancel it."""
        if self.marking is None:
            if self.is_log_open:
                self.action_log()
            if self.is_picture_covered():
                self.action_orbit()
        super().action_mark()

    def mark_refusal(self, frame_id: int) -> str:
        """Return why a frame accepts no mark from this console; empty: it accepts one."""
        if not self.can_act:
            return f"no mark in frame {frame_id}: no engine takes one from this console"
        return late_mark_reason(self.engine, frame_id)

    @property
    def mark_callbacks(self) -> MarkCallbacks | None:
        """The callbacks by which an opened frame's screen sends marks; None: read-only."""
        if self.read_only:
            return None

        def send(mark: MarkByHand) -> str:
            self.send(mark)
            return f"mark sent, frame {mark.frame_id} …"

        return MarkCallbacks(
            send=send,
            begin=self.begin_mark,
            leave=self.release_marked_frame,
            refusal=self.mark_refusal,
        )

    def action_verdicts(self) -> None:
        """List the shown frame's streaks; after a mark, a page for the marked frame as well.

        The marked frame's page comes first at the first call after the mark.
        """
        marked_id, is_first = self.recent_mark()
        shown, folder = self.picture, self.night.folder
        if marked_id is None or folder is None or shown is None or shown.frame_id == marked_id:
            super().action_verdicts()
            return
        try:
            marked = read_night_frame(SessionReader(folder), marked_id)
        except RsoconsoleError as error:
            self.say(str(error), "warn")
            return
        pages = [(shown.detail, ""), (marked, MARKED)]
        ordered = pages[::-1] if is_first else pages
        self.app.push_screen(CandidatesDialog(ordered, self.night.tau, self.keymap))

    def action_note(self) -> None:
        """Ask for a note, which is recorded in the session."""
        if not self.check_can_act():
            return

        def decided(text: str | None) -> None:
            if text:
                self.send(Note(text=text))

        self.app.push_screen(LineDialog("note", "what you want to remember"), decided)

    # -- the past -----------------------------------------------------------------------------

    def open_session(self, folder: Path) -> None:
        """Open a review of a session over this screen; of the present night, at its last frame."""
        is_this = folder == self.night.folder and not self.night.is_closed
        self.app.push_screen(
            ReviewScreen(
                self.orders,
                keymap=self.keymap,
                sessions_root=self.sessions_root,
                folder=folder,
                start=HEAD if is_this else "",
                live=self,
            )
        )
