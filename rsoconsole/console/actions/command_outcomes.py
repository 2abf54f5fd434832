"""The engine's answers to this console's commands, and refusals that are recorded later."""

from collections.abc import Mapping
from typing import Any

from rsoconsole.console.actions.mark_actions import REFUSAL_S, MarkActions
from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.dialogs.dialogs import ArmDialog, ConfirmDialog, MessageDialog
from rsoconsole.control import (
    ON_RECORD,
    Arm,
    Command,
    MarkByHand,
    Outcome,
    RequestControl,
    Sender,
    Shutdown,
    command_words,
)
from rsoconsole.night import LogLine, NightView


class CommandOutcomes(MarkActions):
    """Reports results of this console's commands: the engine's answer, later refusals."""

    tune: TuneActions
    _ticked: tuple[str, ...] = ()
    """Names of the arming checks that were overridden last at this console."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._refused_at_once: list[str] = []
        """Commands refused in a dialog, whose refusal the record will repeat."""

    def handle_outcome(
        self, command: Command, stops: int, seq: int, then: Command | None, outcome: Outcome
    ) -> None:
        """Report a success, or open a dialog for a refusal; neither if STOP was given since.

        Arguments as in the base class.
        """
        self.ask_now()
        if outcome.data.get(ON_RECORD):
            self._expect_refusal(command, seq)
        if stops != self.stops and not isinstance(command, Shutdown):
            return
        name = command.label()
        if outcome.ok and isinstance(command, MarkByHand):
            self.report_mark_accepted(command, outcome)
        elif outcome.ok:
            said = f"{name}: {outcome.message or 'done'}"
            self.say(self.tune.take_applied(command) or said, "good")
            if isinstance(command, Arm):
                self.show_stop(None)
            elif isinstance(command, Shutdown):
                self.app.exit("stop engine")
            if then is not None:
                self.send(then)
        elif outcome.data.get("seat"):
            self._ask_for_seat(str(outcome.data["seat"]))
        elif isinstance(command, Arm):
            self._ask_to_override(outcome, command.override, then)
        elif isinstance(command, MarkByHand) and outcome.data.get("asks") == "replaces":
            self._ask_to_replace(command, outcome)
        else:
            self.say("")
            self.open_unrequested_dialog(MessageDialog(f"{name}: not done", outcome.message))

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
        self.open_unrequested_dialog(
            ArmDialog(outcome.message, checks, ticked or self._ticked), decided
        )

    def _expect_refusal(self, command: Command, seq: int) -> None:
        """Note a refusal that a dialog has shown, so that its log line is not reported too."""
        words = command_words(command.verb, command.arguments())
        if not any(self._refused_here(line) == words for line in self.log_lines_after(seq)):
            self._refused_at_once.append(words)

    def refused_verbs_since(self, before: NightView) -> frozenset[str]:
        """Return the verbs of this console's commands that the record shows as refused.

        ``before``: an earlier view of the night; refusals recorded since then count.
        """
        refused = (self._refused_here(line) for line in self.log_lines_after(before.seq))
        return frozenset(words.partition(" ")[0] for words in refused if words)

    def _refused_here(self, line: LogLine) -> str:
        """Return this console's command whose refusal a line of the log reports; empty: none."""
        own = Sender.console(self.seat_name).words
        return line.asked.removeprefix(f"{own} ") if line.refused_by == own else ""

    def report_refusals(self, before: NightView) -> None:
        """Report each command that the engine accepted from this console and refused later.

        ``before``: the night as it was before its newest lines. A refusal that a dialog has shown
        is left out.
        """
        for line in self.log_lines_since(before):
            refused = self._refused_here(line)
            if refused in self._refused_at_once:
                self._refused_at_once.remove(refused)
            elif refused:
                self.say(line.text.partition(": ")[2], "warn", REFUSAL_S)

    def _ask_for_seat(self, holder: str) -> None:
        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self.send(RequestControl())

        text = f"{holder} has control. Who is asked and says nothing for 30 s gives it up."
        self.open_unrequested_dialog(
            ConfirmDialog("another console acts", text, yes="Ask for it", letter="y"), decided
        )
