"""Verbs for the telescope's engine: run it, ask it, tell it what is wanted, stop it."""

import logging
import math
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from rsoconsole.cli import output
from rsoconsole.config import IndiConfig, load_config
from rsoconsole.errors import ConfigError, ControlError, InstrumentError

log = logging.getLogger(__name__)

JsonOption = Annotated[bool, typer.Option("--json", help="Print only JSON on stdout.")]
SessionOption = Annotated[
    Path | None, typer.Option(help="Session folder, new or empty. Default: in your data folder.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="Configuration file (see 'config show').")
]
STOP_BY_ENGINE_S = 1.0
"""How long STOP waits for the engine before it goes to the mount itself."""


def register(app: typer.Typer) -> None:
    """Hang the verbs into the program."""
    app.command()(engine)
    app.command()(status)
    app.command()(arm)
    app.command()(disarm)
    app.command("set")(set_)
    app.command("quit")(quit_)
    app.command()(stop)


def engine(
    config: ConfigOption = None,
    session: SessionOption = None,
    arm: Annotated[
        bool,
        typer.Option("--arm", help="Begin to search at once; otherwise wait for 'rsoconsole arm'."),
    ] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, help="End after this many exposures.")
    ] = None,
) -> None:
    """Run the telescope; no terminal needed. SIGTERM or 'rsoconsole quit' end it safely.

    It moves nothing until it is armed: by --arm, or by 'rsoconsole arm' from another terminal.
    Example: rsoconsole engine --config ~/.config/rsoconsole/config.toml --arm
    """
    from rsoconsole.engine.service import RunSettings, run_engine

    waits = "" if arm else "; it waits for 'rsoconsole arm'"
    run_engine(
        load_config(config),
        RunSettings(title="night", session=session, frames=frames, is_armed=arm),
        on_start=lambda folder: output.complain(f"engine runs; session {folder}{waits}"),
    )


def status(json_: JsonOption = False) -> None:
    """One line about the running engine, for scripts and tmux.

    Example: rsoconsole status --json
    """
    from rsoconsole.control import ControlClient

    outcome = ControlClient(by="status").send("status")
    if not outcome.ok:
        raise ControlError(outcome.message)
    data = dict(outcome.data)
    if json_:
        output.emit_json(data)
        return
    words = [str(data["state"]), f"{data['holder']} has the mount", f"frame {data['frame']}"]
    if data["ra"] is not None:
        words.append(output.direction_text(data["ra"], data["dec"]))
    if data["alt"] is not None:
        words.append(f"alt {data['alt']:.1f} az {data['az']:.1f}")
    words.extend(f"FAULT {fault}" for fault in data["faults"])
    output.say(" · ".join(words))


def arm(json_: JsonOption = False) -> None:
    """Hand the mount to the engine: it searches from where the telescope points.

    Example: rsoconsole arm
    """
    _tell_engine("arm", "arm", json_)


def disarm(json_: JsonOption = False) -> None:
    """Take the mount back from the engine; it keeps running and waits to be armed again.

    Example: rsoconsole disarm
    """
    _tell_engine("disarm", "disarm", json_)


def set_(
    name: Annotated[str, typer.Argument(help="Dotted name, as 'config show' lists it.")],
    value: Annotated[str, typer.Argument(help="New value.")],
    json_: JsonOption = False,
) -> None:
    """Change a setting of the running engine, from the next exposure until the engine ends.

    Example: rsoconsole set detector.tau 0.2
    """
    _tell_engine("set", "set", json_, name=name, value=_number_or_text(value))


def quit_(json_: JsonOption = False) -> None:
    """End the engine safely: the mount stops, the session is closed.

    Example: rsoconsole quit
    """
    _tell_engine("quit", "shutdown", json_)


def stop(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """Stop the telescope now, engine or no engine.

    Example: rsoconsole stop
    """
    begun_s = time.monotonic()
    path, detail = _stop_by_engine(), ""
    if path is None:
        path, detail = _stop_directly(config)
    is_stopped = not detail
    ms = (time.monotonic() - begun_s) * 1e3
    if json_:
        output.emit_json({"stopped": is_stopped, "path": path, "ms": ms})
    else:
        ending = "stopped" if is_stopped else "NOT confirmed stopped"
        output.say(f"{ending} in {math.ceil(ms)} ms, path {path}")
    if not is_stopped:
        raise InstrumentError(
            f"the mount did not confirm that it stopped ({detail}): cut its power if it moves"
        )


def _stop_by_engine() -> str | None:
    """The way the engine stopped the mount; None when it did not, for whatever reason."""
    from rsoconsole.control import ControlClient

    try:
        data = ControlClient(by="stop").send("stop", timeout_s=STOP_BY_ENGINE_S).data
        path = str(data["path"])
        return path if data["stopped"] is True else None
    except Exception as error:  # nothing that is wrong with the engine may stand in STOP's way
        log.warning("STOP goes past the engine: %s: %s", type(error).__name__, error)
        return None


def _stop_directly(config: Path | None) -> tuple[str, str]:
    """(path, what is wrong or empty) of a STOP by a connection of its own to the INDI server."""
    from rsoconsole.instruments.indi_wire import stop_mount

    try:
        indi = load_config(config).indi
    except (ConfigError, OSError) as error:
        indi = IndiConfig()
        output.complain(
            f"rsoconsole: {error}; stopping '{indi.mount}' at {indi.host}:{indi.port} instead"
        )
    result = stop_mount(indi.host, indi.port, indi.mount)
    return result.path, "" if result.stopped else result.detail or "no reason given"


def _tell_engine(name: str, verb: str, json_: bool, /, **arguments: Any) -> None:
    """Send an intention and say what came of it. Raises ControlError when it is refused."""
    from rsoconsole.control import ControlClient

    outcome = ControlClient(by="command").send(verb, **arguments)
    if json_:
        output.emit_json({"verb": name, "ok": outcome.ok, "message": outcome.message})
    if not outcome.ok:
        raise ControlError(outcome.message or f"the engine refused '{name}' without a reason")
    if not json_:
        output.say(outcome.message)


def _number_or_text(value: str) -> float | str:
    try:
        number = float(value)
    except ValueError:
        return value
    return number if math.isfinite(number) else value
