"""Verbs for the telescope's engine: run it, ask it, tell it what is wanted, stop it."""

import contextlib
import logging
import math
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Annotated

import typer

from rsoconsole.cli import order, output
from rsoconsole.cli.options import (
    ConfigOption,
    JsonOption,
    OverrideOption,
    SessionOption,
    SocketOption,
)
from rsoconsole.config import IndiConfig, MountConfig, load_config
from rsoconsole.control.commands import AskStatus, Stop
from rsoconsole.errors import ConfigError, ControlError, InstrumentError
from rsoconsole.waits import told_to

log = logging.getLogger(__name__)

STOP_BY_ENGINE_S = 1.0
"""How long the engine's answer to STOP counts."""
LATE_S = 0.3
"""How long STOP waits for it before it goes to the mount itself."""


def register(app: typer.Typer) -> None:
    """Hang the verbs into the program."""
    app.command()(engine)
    app.command()(status)
    order.register(app)
    app.command()(stop)


def engine(
    config: ConfigOption = None,
    session: SessionOption = None,
    arm: Annotated[
        bool,
        typer.Option("--arm", help="Begin to search at once; otherwise wait for 'rsoconsole arm'."),
    ] = False,
    override: OverrideOption = None,
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
    with told_to(output.complain):
        run_engine(
            load_config(config),
            RunSettings(
                title="night",
                session=session,
                frames=frames,
                is_armed=arm,
                lifted=frozenset(override or ()),
            ),
            on_start=lambda folder: output.complain(f"engine runs; session {folder}{waits}"),
        )


def status(socket: SocketOption = None, json_: JsonOption = False) -> None:
    """One line about the running engine, for scripts and tmux.

    Example: rsoconsole status --json
    """
    from rsoconsole.control import ControlClient

    outcome = ControlClient(socket, by="status").send(AskStatus())
    if not outcome.ok:
        raise ControlError(outcome.message)
    data = dict(outcome.data)
    if json_:
        output.emit_json(data)
        return
    held = " HELD" if data.get("is_held") else ""
    words = [f"{data['state']}{held}", f"{data['holder']} has the mount", f"frame {data['frame']}"]
    if data["ra"] is not None:
        words.append(output.direction_text(data["ra"], data["dec"]))
    if data["alt"] is not None:
        words.append(f"alt {data['alt']:.1f} az {data['az']:.1f}")
    machine = data.get("machine") or {}
    if machine.get("cpu_temperature_c") is not None:
        words.append(f"CPU {machine['cpu_temperature_c']:.0f} °C")
    words.extend(f"MACHINE {trouble}" for trouble in machine.get("troubles", ()))
    words.extend(f"FAULT {fault}" for fault in data["faults"])
    output.say(" · ".join(words))


def stop(
    config: ConfigOption = None, socket: SocketOption = None, json_: JsonOption = False
) -> None:
    """Stop the telescope now, engine or no engine.

    An engine that does not answer at once is gone past: the configured mount itself is told.
    With --socket only the engine that listens there is told.

    Example: rsoconsole stop
    """
    begun_s = time.monotonic()
    by_engine = _begin_stop_by_engine(socket)
    path, detail = _outcome(by_engine, LATE_S if socket is None else STOP_BY_ENGINE_S), ""
    if path is None and socket is not None:
        # The configured mount is another engine's.
        path, detail = "engine", f"nothing that listens at {socket} stopped it"
    elif path is None:
        path, detail = _stop_directly(config)
        # One yes is enough: the engine may know a mount that is configured nowhere.
        late = _outcome(by_engine, STOP_BY_ENGINE_S) if detail else None
        path, detail = (path, detail) if late is None else (late, "")
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


def _begin_stop_by_engine(socket: Path | None) -> Future[str | None]:
    """Ask the engine, on a thread that nothing waits for in the end."""
    answer: Future[str | None] = Future()

    def ask() -> None:
        answer.set_result(_stop_by_engine(socket))

    threading.Thread(target=ask, daemon=True, name="stop").start()
    return answer


def _outcome(answer: Future[str | None], timeout_s: float) -> str | None:
    """The way the engine stopped the mount; None when it did not, or has not yet."""
    with contextlib.suppress(TimeoutError):
        return answer.result(timeout_s)
    return None


def _stop_by_engine(socket: Path | None = None) -> str | None:
    """The way the engine stopped the mount; None when it did not, for whatever reason."""
    from rsoconsole.control import ControlClient

    try:
        data = ControlClient(socket, by="stop").send(Stop(), timeout_s=STOP_BY_ENGINE_S).data
        path = str(data["path"])
        return path if data["stopped"] is True else None
    except Exception as error:  # nothing that is wrong with the engine may stand in STOP's way
        log.warning("STOP goes past the engine: %s: %s", type(error).__name__, error)
        return None


def _stop_directly(config: Path | None) -> tuple[str, str]:
    """(path, what is wrong or empty) of a STOP by a connection of its own to the INDI server."""
    from rsoconsole.instruments.indi_wire import stop_mount

    after_stop = MountConfig().after_stop
    try:
        loaded = load_config(config)
        indi, after_stop = loaded.indi, loaded.mount.after_stop
    except (ConfigError, OSError) as error:
        indi = IndiConfig()
        output.complain(
            f"rsoconsole: {error}; stopping '{indi.mount}' at {indi.host}:{indi.port} instead"
        )
    result = stop_mount(indi.host, indi.port, indi.mount, after_stop=after_stop)
    return result.path, "" if result.stopped else result.detail or "no reason given"
