"""The operator's commands as verbs of the program, generated from the command classes.

A command class that has an example for the shell becomes a verb; its fields become arguments and
options.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from rsoconsole.base import ControlError
from rsoconsole.cli.telescope.waiting import GOALS, Goal, GoalWait, WaitOption
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.options import JsonOption, SocketOption, number_or_text
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.control import COMMANDS, Command, Outcome, Set

if TYPE_CHECKING:
    from rsoconsole.control import ControlClient

_COMPLETED: Mapping[tuple[str, str], completion.Completer] = {
    ("set", "name"): completion.tunable_names,
    ("set", "value"): completion.setting_values,
    ("arm", "override"): completion.checks,
}
"""Completers by (verb, field of its command)."""


def add_command_verbs(app: typer.Typer) -> None:
    """Add a verb to the program for every command that has an example for the shell."""
    for command in COMMANDS.values():
        if command.shell:
            # A negative angle is an argument, no option.
            settings = {"ignore_unknown_options": _has_numbers(command)}
            app.command(shell_verb(command), context_settings=settings)(verb_function(command))


def shell_verb(command: type[Command]) -> str:
    """Verb of a command in the shell: the second word of its example."""
    return command.shell.split()[1]


def verb_function(command: type[Command]) -> Callable[..., None]:
    """A function for typer that sends the command; its parameters are the command's fields."""
    hints = get_type_hints(command)
    shown = {str(each.metadata.get("shell", each.name)): each for each in fields(command)}
    parameters = [
        _parameter(name, each, hints[each.name], _COMPLETED.get((command.verb, each.name)))
        for name, each in shown.items()
    ]
    if command.verb in GOALS:
        parameters.append(_keyword("wait", WaitOption, default=False))
    for name, hint, default in (("socket", SocketOption, None), ("json_", JsonOption, False)):
        parameters.append(_keyword(name, hint, default))

    def verb(*, socket: Path | None, json_: bool, wait: bool = False, **given: Any) -> None:
        from rsoconsole.control import ControlClient, Sender

        values = {
            shown[name].name: _value(hints[shown[name].name], value)
            for name, value in given.items()
            if value is not None
        }
        wanted = command(**values)
        _check(wanted)
        client = ControlClient(socket, sender=Sender(name="command"))
        goal_of = (lambda _: GOALS[command.verb]) if wait else None
        send_and_report(wanted, shell_verb(command), client, json_=json_, goal_of=goal_of)

    verb.__doc__ = f"{command.shell_help}\n\nExample: {command.shell}"
    verb.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    verb.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return verb


def send_and_report(
    command: Command,
    verb: str,
    client: "ControlClient",
    *,
    json_: bool,
    goal_of: Callable[[Outcome], Goal] | None = None,
    more: Mapping[str, Any] | None = None,
) -> None:
    """Send a command to the engine and print its result.

    ``goal_of``: makes the goal to wait for from the engine's outcome; None: do not wait.
    ``more``: further keys of the JSON. Raises ControlError where the engine refuses the command
    or the mount does not reach the goal.
    """
    follower = None if goal_of is None else GoalWait(client)
    outcome = client.send(command)
    if follower is not None and goal_of is not None and outcome.ok:
        if not json_:
            output.say(outcome.message)
        outcome = follower.wait_for_outcome(goal_of(outcome))
    if json_:
        report = {"verb": verb, "ok": outcome.ok, "message": outcome.message}
        output.emit_json(report, **(more or {}))
    if not outcome.ok:
        raise ControlError(outcome.message or f"the engine refused '{verb}' without a reason")
    if not json_:
        output.say(outcome.message)


def _check(command: Command) -> None:
    """Raises BadParameter for a command that no engine could carry out, before it is sent."""
    from rsoconsole.engine import check_tunable

    with as_usage_error():
        command.check()
        if isinstance(command, Set):
            check_tunable(command.name)


def _parameter(
    name: str, each: "Field[Any]", hint: Any, completed: completion.Completer | None
) -> inspect.Parameter:
    help_ = str(each.metadata.get("help", ""))
    kind = _shell_type(hint)
    if each.default is MISSING and each.default_factory is MISSING:
        argument = typer.Argument(help=help_, autocompletion=completed)
        return _keyword(name, Annotated[kind, argument], inspect.Parameter.empty)
    option = typer.Option(f"--{name.replace('_', '-')}", help=help_, autocompletion=completed)
    return _keyword(name, Annotated[kind | None, option], None)


def _keyword(name: str, hint: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _shell_type(hint: Any) -> Any:
    """Type of a shell's value for a field of that type."""
    if hint == tuple[str, ...]:
        return list[str]
    for kind in (str, float, int, bool):
        if kind in (hint, *get_args(hint)):
            return kind
    raise TypeError(f"the shell cannot give a {hint}")


def _value(hint: Any, given: Any) -> Any:
    """Value from the shell in the field's own type."""
    if isinstance(given, list):
        return tuple(given)
    return number_or_text(given) if {str, float} <= {*get_args(hint)} else given


def _has_numbers(command: type[Command]) -> bool:
    return any(hint is float for hint in get_type_hints(command).values())
