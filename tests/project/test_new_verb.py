"""A verb is added in three files: the documentation's example, applied and used by every way."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from rsoconsole.base import resource_path
from rsoconsole.control import COMMANDS, AimOffset, Command, Preview
from rsoconsole.engine.operator.handlers import Handler
from tests.rigs.engine_rig import command_handler_of, rig
from tests.rigs.worked_example import expect_used

PAGE = resource_path("control", "README.md").read_text(encoding="utf-8")
MAX_FILES = 4

USE = """
from typer.testing import CliRunner
from rsoconsole.cli.app import app
from rsoconsole.console.commands.commands import BY_NAME
from rsoconsole.console.commands.keymap import bindings
from rsoconsole.control import ControlServer, make_command, command_words, default_socket_path
from rsoconsole.control.commands import Flats
from rsoconsole.words import text
from rsoconsole.records import OperatorAction
from rsoconsole.sky import icrs_to_altaz
from tests.rigs.engine_rig import SITE, command_handler_of, rig

r = rig(set())
handler = command_handler_of(r)

# By the shell, over the wire, to the command handler.
with ControlServer(default_socket_path(), handler.handle):
    run = CliRunner().invoke(app, ["flats", "--altitude-deg", "65"])
    assert run.exit_code == 0, run.output
    low = CliRunner().invoke(app, ["flats", "--altitude-deg", "-20"])
    assert low.exit_code == 1 and "altitude" in str(low.exception), low.exception
assert run.output == "on its way; you have the mount\\n", run.output
assert "Above the horizon" in CliRunner().invoke(app, ["flats", "--help"]).output

# By the loop, to the mount and the record.
assert r.queue.is_interrupt_wanted, "it is urgent"
r.engine.commands.execute_waiting()
altitude_deg, azimuth_deg = icrs_to_altaz(SITE, *r.mount.slews[-1], r.clock.now_utc_ns())
assert abs(altitude_deg - 65.0) < 0.1 and abs(azimuth_deg - 180.0) < 0.1
accepted, refused, done = r.memory.of(OperatorAction)
assert (done.verb, text(done.outcome), done.by) == ("flats", "on its way", "command")
assert refused.outcome.kind == "refused", refused
assert refused.outcome.detail.startswith("altitude"), refused
assert done.arguments == {"altitude_deg": 65.0}
assert command_words(done.verb, done.arguments) == "flats at altitude 65°"

# By its key.
assert BY_NAME["flats"].sends == Flats() == make_command("flats", {})
assert "hand_over('flats')" in [binding.action for binding in bindings("live")]
print("used")
"""


def example() -> dict[str, list[tuple[str, str]]]:
    """File -> what the documentation's example makes of it: (piece, the same afterwards)."""
    (diff,) = re.findall(r"```diff\n(.*?)```", PAGE, re.DOTALL)
    found: dict[str, list[tuple[str, str]]] = {}
    for part in re.split(r"^--- a/", diff, flags=re.MULTILINE)[1:]:
        path, _, rest = part.partition("\n")
        for hunk in rest.split("\n@@\n")[1:]:
            lines = hunk.splitlines()
            before = "\n".join(line[1:] for line in lines if not line.startswith("+"))
            after = "\n".join(line[1:] for line in lines if not line.startswith("-"))
            found.setdefault(path, []).append((before, after))
    return found


def test_the_documentations_new_verb_takes_four_files_and_works_by_every_way(tmp_path: Path):
    assert len(example()) <= MAX_FILES
    nowhere = str(tmp_path / "none.toml")
    expect_used(tmp_path, example(), USE, XDG_RUNTIME_DIR=str(tmp_path), RSOCONSOLE_CONFIG=nowhere)


def documented() -> dict[str, tuple[str, str]]:
    """Verb -> (arguments, policy), as the page has them."""
    rows = re.findall(r"^\| `(\w+)` \| (.*?) ?\| (.*?) ?\|$", PAGE, re.MULTILINE)
    return {verb: (arguments.strip("`"), policy) for verb, arguments, policy in rows}


def policy_of(command: type[Command]) -> str:
    words = {
        "immediate": command.is_immediate,
        "urgent": command.is_urgent,
        "moves": command.moves_mount,
        "answered": command.awaits_mount,
        "survives stop": command.survives_stop,
        "free": not command.needs_control,
        "panel": command.is_on_panel,
        "shell": bool(command.shell),
    }
    return ", ".join(word for word, is_so in words.items() if is_so)


@pytest.mark.parametrize("verb", COMMANDS)
def test_the_page_has_every_verb_with_its_arguments_and_its_policy(verb: str):
    command = COMMANDS[verb]
    arguments, policy = documented()[verb]
    assert policy == policy_of(command)
    if command is not Preview:
        keys = [str(f.metadata.get("key", f.name)) for f in fields(command)]
        assert arguments == ", ".join(keys)


def test_the_page_has_no_verb_that_there_is_not():
    assert {verb for verb in documented() if verb not in COMMANDS} <= {
        *("verb", "arguments", "by", "id", "timeout_s")
    }


@pytest.mark.parametrize("verb", COMMANDS)
def test_the_engine_has_a_way_to_do_every_command(verb: str):
    command_handler, command = command_handler_of(rig(set())), COMMANDS[verb]
    answered, handled = command in command_handler._answers, command_handler._handlers.get(command)
    assert answered != isinstance(handled, Handler)
    assert command.is_immediate <= answered


def test_the_settings_of_a_look_beside_the_prediction_are_those_of_the_configuration():
    from rsoconsole.config import AimConfig

    # The policy says which of several tracks, not how far beside it.
    assert {each.name for each in fields(AimOffset)} == set(AimConfig.model_fields) - {"policy"}
