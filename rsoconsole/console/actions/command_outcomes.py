"""What came of the commands that were sent here: said, asked, or put right in a dialog."""

from collections.abc import Mapping

from rsoconsole.console.actions.mark_actions import MarkActions
from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.dialogs import ArmDialog, ConfirmDialog, MessageDialog
from rsoconsole.console.watches import OutcomeCame
from rsoconsole.control import (
    ON_RECORD,
    Arm,
    AskSeat,
    Command,
    MarkByHand,
    Outcome,
    Sender,
    Shutdown,
    command_words,
)
from rsoconsole.night import LogLine, NightView

REFUSAL_S = 10.0


class CommandOutcomes:
    """What the engine says to a command, and what its record says of it later."""

    def __init__(self, seat: Seat, marks: MarkActions, tune: TuneActions) -> None:
        self._seat, self._marks, self._tune = seat, marks, tune
        self._ticked: tuple[str, ...] = ()
        """Checks that were overridden here last."""
        self._refused_at_once: list[str] = []
        """What the engine has said no to, in a dialog, and its record says once more."""

    def see(self, message: OutcomeCame) -> None:
        """Said where it went well, asked where it did not; STOP has the last word."""
        seat = self._seat
        command, outcome = message.command, message.outcome
        seat.ask_now()
        if outcome.data.get(ON_RECORD):
            self._expect_refusal(command, message.seq)
        if message.stops != seat.stops and not isinstance(command, Shutdown):
            return
        name = command.label()
        if outcome.ok and isinstance(command, MarkByHand):
            self._marks.see_taken(command, outcome)
        elif outcome.ok:
            said = f"{name}: {outcome.message or 'done'}"
            seat.say(self._tune.done_words(command) or said, "good")
            if isinstance(command, Arm):
                seat.show_stop(None)
            elif isinstance(command, Shutdown):
                seat.app.exit("stop engine")
            if message.then is not None:
                seat.send(message.then)
        elif outcome.data.get("seat"):
            self._ask_for_seat(str(outcome.data["seat"]))
        elif isinstance(command, Arm):
            self._ask_to_override(outcome, command.override, message.then)
        elif isinstance(command, MarkByHand) and outcome.data.get("asks") == "replaces":
            self._marks.ask_to_replace(command, outcome)
        else:
            seat.say("")
            seat.ask_unasked(MessageDialog(f"{name}: not done", outcome.message))

    def _ask_to_override(
        self, outcome: Outcome, ticked: tuple[str, ...], then: Command | None
    ) -> None:
        seat = self._seat
        given = outcome.data.get("checks")
        checks = [check for check in given if isinstance(check, Mapping)] if given else []

        def decided(names: tuple[str, ...] | None) -> None:
            if names is not None:
                self._ticked = names
                seat.send(Arm(override=names), then)

        seat.say("not armed", "warn")
        seat.ask_unasked(ArmDialog(outcome.message, checks, ticked or self._ticked), decided)

    def _expect_refusal(self, command: Command, seq: int) -> None:
        """It is said already: its record, which may have been read by now, says nothing new."""
        words = command_words(command.verb, command.arguments())
        if not any(self._refused_here(line) == words for line in self._seat.log_lines_after(seq)):
            self._refused_at_once.append(words)

    def refused_since(self, before: NightView) -> frozenset[str]:
        """Verbs of this console's commands that the record has refused since ``before``."""
        refused = (self._refused_here(line) for line in self._seat.log_lines_after(before.seq))
        return frozenset(words.partition(" ")[0] for words in refused if words)

    def _refused_here(self, line: LogLine) -> str:
        """The command of this console that the line says was refused; empty: none."""
        own = Sender.console(self._seat.seat_name).words
        return line.asked.removeprefix(f"{own} ") if line.refused_by == own else ""

    def see_refusals(self, before: NightView) -> None:
        """What was accepted here and refused later is said once, where it was asked for."""
        seat = self._seat
        if not seat.seat_name or before.folder != seat.night.folder or not before.is_read:
            return
        for line in seat.log_lines_after(before.seq):
            refused = self._refused_here(line)
            if refused in self._refused_at_once:
                self._refused_at_once.remove(refused)
            elif refused:
                seat.say(line.text.partition(": ")[2], "warn", REFUSAL_S)

    def _ask_for_seat(self, holder: str) -> None:
        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self._seat.send(AskSeat())

        text = f"{holder} has control. Who is asked and says nothing for 30 s gives it up."
        self._seat.ask_unasked(
            ConfirmDialog("another console acts", text, yes="Ask for it", letter="y"),
            decided,
        )
