"""The verb ``service``: the engine as a systemd service of the user who runs it."""

import getpass
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import platformdirs
import typer

from rsoconsole.base import ConfigError, RsoconsoleError, resource_path
from rsoconsole.cli.words import output
from rsoconsole.cli.words.options import ConfigOption, JsonOption
from rsoconsole.config import (
    APP,
    INIT_WRITES,
    default_config_path,
    environment_overrides,
    load_config,
)

UNIT = f"{APP}.service"
MARK = "# Written by 'rsoconsole service install'"
CARRIED = ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME")
"""Environment variables that move the default folders; the unit sets them for the engine."""
LINGER = Path("/var/lib/systemd/linger")
TRIAL_S = 20.0
FIRST_OF_SYSTEMD = 200
"""First of the exit statuses for what systemd could not set up. Source: systemd.exec(5)."""
SYSTEMCTL_S = 120.0
"""Time-out of systemctl, long enough for a safe stop of the engine."""

_WITHOUT = {
    False: "this system gives a user's service no user namespace",
    None: "systemd cannot be asked here whether it gives the service a user namespace"
    " ('rsoconsole service install' again, after a login, asks)",
}

service_app = typer.Typer(
    no_args_is_help=True, help="The engine as a systemd service: show, install, remove, status."
)


@service_app.command("show")
def service_show(config: ConfigOption = None) -> None:
    """Print the unit that 'install' would write; changes nothing.

    Example: rsoconsole service show
    """
    is_possible = is_namespace_allowed()
    output.emit_text(
        unit_text(exec_start_command(config), os.environ, is_in_namespace=is_possible is True)
    )


@service_app.command("install")
def service_install(config: ConfigOption = None) -> None:
    """Write the unit for this installation, but neither enable nor start it.

    The unit never arms: after each start the telescope does not move until 'rsoconsole arm'.
    Example: rsoconsole service install --config ~/.config/rsoconsole/config.toml
    """
    _need_systemd()
    if load_config(config).indi.simulated:
        raise ConfigError(
            "indi.simulated = true: a simulated observatory is no service: 'rsoconsole demo' "
            "brings it"
        )
    path = unit_path()
    _refuse_foreign(path)
    is_possible = is_namespace_allowed()
    text = unit_text(exec_start_command(config), os.environ, is_in_namespace=is_possible is True)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RsoconsoleError(
            f"{path} cannot be written ({error.strerror}): see to the rights of its folder"
        ) from error
    output.say(f"wrote {path}")
    if is_possible is not True:
        names = ", ".join(line.partition("=")[0] for line in namespace_lines())
        output.print_to_stderr(
            f"{APP}: {_WITHOUT[is_possible]}; it is without {names}, and otherwise the same"
        )
    if fault := _systemctl("daemon-reload")[1]:
        output.say(f"systemd has not read it yet ({fault}): it will at your next login")
    elif _word("is-active") == "active":
        output.say(f"it runs still as it was: systemctl --user restart {APP}")
    if own := environment_overrides():
        output.print_to_stderr(
            f"{APP}: of your environment the service has nothing: write what {', '.join(own)}"
            f" {'say' if len(own) > 1 else 'says'} into the file"
        )
    if not default_config_path().exists() and config is None:
        output.say(f"there is no configuration yet: {INIT_WRITES}")
    output.say(
        f"start it now and at every login: systemctl --user enable --now {APP}",
        "start it at boot, without a login: loginctl enable-linger",
        f"what it says:                     journalctl --user -u {APP} -f",
        "it moves nothing until:           rsoconsole arm",
    )


@service_app.command("remove")
def service_remove() -> None:
    """Stop the service safely, disable it, and delete its unit.

    Example: rsoconsole service remove
    """
    path = unit_path()
    if not path.exists():
        output.say(f"there is no {path}: nothing to remove")
        return
    _refuse_foreign(path)
    if shutil.which("systemctl") and (fault := _systemctl("disable", "--now", UNIT)[1]):
        output.print_to_stderr(f"{APP}: systemd did not stop it ({fault}): 'rsoconsole quit' does")
    path.unlink()
    if shutil.which("systemctl"):
        _systemctl("daemon-reload")
    output.say(f"removed {path}")


@service_app.command("status")
def service_status(json_: JsonOption = False) -> None:
    """Say whether the service is installed, enabled and running, and continues after logout.

    Example: rsoconsole service status --json
    """
    path = unit_path()
    found = path.read_text(encoding="utf-8") if path.exists() else None
    has_systemd = shutil.which("systemctl") is not None
    row = {
        "installed": found is not None,
        "unit": str(path),
        "program": None if found is None else _starts(found),
        "program_exists": None if found is None else Path(_starts(found)).is_file(),
        "enabled": _word("is-enabled") if has_systemd else None,
        "active": _word("is-active") if has_systemd else None,
        "lingers": (LINGER / getpass.getuser()).exists(),
        "systemd": has_systemd,
    }
    if json_:
        output.emit_json(row)
        return
    if not has_systemd:
        output.say("this machine has no systemd: start 'rsoconsole engine' by what it has instead")
    if found is None:
        output.say("not installed: 'rsoconsole service install' writes the unit")
        return
    output.say(f"{path}: {row['enabled'] or 'unknown'}, {row['active'] or 'unknown'}")
    if not row["program_exists"]:
        output.say("its program is gone: 'rsoconsole service install' writes the unit again")
    if not row["lingers"]:
        output.say("it ends when you log out: 'loginctl enable-linger' lets it run on")


def unit_path() -> Path:
    """Path of the service's unit among this user's systemd units."""
    return Path(platformdirs.user_config_path()) / "systemd" / "user" / UNIT


def namespace_lines() -> list[str]:
    """Lines of the unit whose settings need a user namespace."""
    text = resource_path("engine", "service", "namespace.conf").read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def is_namespace_allowed() -> bool | None:
    """Return whether this user's services may have a user namespace; None: the test failed.

    In the test, systemd runs the program ``true`` in one. Where the result is False, a unit that
    requires a namespace does not start.
    """
    program, does_nothing = shutil.which("systemd-run"), shutil.which("true")
    if program is None or does_nothing is None:
        return None
    words = [program, "--user", "--quiet", "--collect", "--wait"]
    words += [f"--property={line}" for line in namespace_lines()]
    try:
        done = subprocess.run(
            [*words, "--", does_nothing], capture_output=True, timeout=TRIAL_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    if done.returncode >= FIRST_OF_SYSTEMD:
        return False
    return True if done.returncode == 0 else None


def unit_text(
    command: tuple[str, ...], environ: Mapping[str, str], *, is_in_namespace: bool = True
) -> str:
    """Return the text of a systemd unit that runs ``command``.

    ``command``: program (an absolute path) and arguments. ``environ``: environment of which the
    unit gets the variables in ``CARRIED``. ``is_in_namespace``: include the settings that need a
    user namespace.
    """
    template = resource_path("engine", "service", UNIT).read_text(encoding="utf-8")
    settings = ["PYTHONUNBUFFERED=1"]
    settings += [f"{name}={environ[name]}" for name in CARRIED if environ.get(name)]
    environment = "\n".join(f"Environment={_quoted(setting, dollar='$')}" for setting in settings)
    # Of the program's own path systemd replaces no variables, of the arguments it does.
    start = " ".join([_quoted(command[0], dollar="$"), *map(_quoted, command[1:])])
    inner = resource_path("engine", "service", "namespace.conf").read_text(encoding="utf-8")
    # First: what else is put in may hold any word.
    template = template.replace("@NAMESPACE@", f"\n{inner}" if is_in_namespace else "")
    return template.replace("@EXEC_START@", start).replace("@ENVIRONMENT@", environment)


def exec_start_command(config: Path | None) -> tuple[str, ...]:
    """Command that starts this installation's engine unarmed, with ``config`` as absolute path."""
    if not sys.executable:
        raise RsoconsoleError("Python does not know its own path: start it by its full path")
    # Not resolved: the link inside a virtual environment is what leads to its libraries.
    python = Path(sys.executable).absolute()
    script = python.with_name(APP)
    start = (
        (str(script),)
        if script.exists()
        else (str(python), "-c", "from rsoconsole.cli import main; main()")
    )
    path = config or default_config_path()
    if config is None and not path.exists():
        return (*start, "engine")
    return (*start, "engine", "--config", str(path.expanduser().absolute()))


def _quoted(word: str, dollar: str = "$$") -> str:
    """One word as systemd reads it. Source: systemd.service(5), systemd.syntax(7)."""
    if any(ord(letter) < 32 for letter in word):
        raise RsoconsoleError(f"{word!r} holds a control character: rename it")
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
    return '"' + escaped.replace("$", dollar) + '"'


def _need_systemd() -> None:
    if shutil.which("systemctl") is None:
        raise RsoconsoleError(
            "this machine has no systemd: start 'rsoconsole engine' by what it has instead; "
            "'rsoconsole service show' prints the unit"
        )


def _refuse_foreign(path: Path) -> None:
    """Raises RsoconsoleError when somebody else's unit lies there."""
    if path.exists() and MARK not in path.read_text(encoding="utf-8", errors="replace"):
        raise RsoconsoleError(f"{path} was not written by rsoconsole: move it away first")


def _systemctl(*arguments: str) -> tuple[str, str]:
    """Answer of the user's own service manager, and its fault or empty."""
    try:
        done = subprocess.run(
            ["systemctl", "--user", *arguments],
            capture_output=True,
            text=True,
            timeout=SYSTEMCTL_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", str(error)
    words = done.stderr.strip().splitlines()
    fault = "" if done.returncode == 0 else (words[-1] if words else f"exit {done.returncode}")
    return done.stdout.strip(), fault


def _word(question: str) -> str | None:
    """Answer of systemctl in one word, e.g. "active"; None without an answer."""
    return _systemctl(question, UNIT)[0] or None


def _starts(unit: str) -> str:
    """The program that a unit starts."""
    line = next((row for row in unit.splitlines() if row.startswith("ExecStart=")), "")
    words = shlex.split(line.removeprefix("ExecStart="))
    return words[0].replace("%%", "%") if words else ""
