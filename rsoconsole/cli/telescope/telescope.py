"""Verbs for the telescope's engine: console, engine, status, stop."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from rsoconsole.base import ControlError, report_waits_to, system_errors_as
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.options import (
    ConfigOption,
    GraphicsOption,
    JsonOption,
    OverrideOption,
    SessionOption,
    SocketOption,
)
from rsoconsole.config import load_config
from rsoconsole.control import AskStatus, Status
from rsoconsole.instruments import stop_without_engine
from rsoconsole.words import ENGINE_ENDS, direction

log = logging.getLogger(__name__)

STILL_MOVES_EXIT, NOT_KNOWN_EXIT = 3, 4
"""Exit statuses of ``stop`` where the mount still moves, and where its motion is unknown."""


def console(
    session: Annotated[
        Path | None,
        typer.Option(
            help="Show this session's folder, read-only, without an engine.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Only look; STOP works all the same.")
    ] = False,
    graphics: GraphicsOption = None,
    socket: SocketOption = None,
) -> None:
    """Open the operator's console: attach to the running engine and show its whole night.

    When the console is left or lost, nothing changes for the telescope.

    x or ctrl+x is STOP, q leaves, F1 shows every other key, ctrl+p finds each
    action by its name; a keymap.toml beside the configuration gives actions
    other keys. Works from 40 x 12 on, at its best from 80 x 24; NO_COLOR=1 is
    obeyed, ctrl+t changes the colours (night: red only). Pictures are drawn by
    the terminal's own graphics, or by the finest characters that it draws;
    --graphics chooses.

    Example: rsoconsole console
    """
    from rsoconsole.console import run_console

    ending = run_console(
        socket=socket,
        session=session,
        read_only=read_only,
        stop_directly=stop_without_engine,
        graphics=graphics,
    )
    if ending == "stop engine":
        output.print_to_stderr(ENGINE_ENDS)


def engine(
    *,
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
    pass_: Annotated[
        int | None,
        typer.Option(
            "--pass",
            min=1,
            metavar="NORAD",
            help="Wait for the passes of this low satellite, and leap ahead of it.",
        ),
    ] = None,
    tle: Annotated[
        list[Path] | None,
        typer.Option(
            help="Element sets for --pass; may be repeated. Default: catalogue.tle_files of the"
            " configuration."
        ),
    ] = None,
) -> None:
    """Run the telescope; no terminal needed. SIGTERM or 'rsoconsole quit' end it safely.

    It moves nothing until it is armed: by --arm, or by 'rsoconsole arm' from another terminal.

    With --pass the telescope waits at a point of the satellite's path until the satellite comes
    through the field, early or late by up to three times leap.late_sigma_s. The first streak says
    how late it is and how far across its path; from then on the telescope is aimed by the orbit
    fitted to the streaks ('rsoconsole passes' lists a night's passes).

    Example: rsoconsole engine --config ~/.config/rsoconsole/config.toml --arm

    Example: rsoconsole engine --arm --pass 25544 --tle active.tle
    """
    from rsoconsole.engine import RunSettings, load_awaited_elements, run_engine

    if tle and pass_ is None:
        raise typer.BadParameter("--tle belongs to --pass")
    overrides: dict[str, Any] = {}
    if pass_ is not None:
        overrides = {"leap.enabled": True, "leap.pass_norad": pass_}
        if tle:
            overrides["catalogue.tle_files"] = [str(each.resolve()) for each in tle]
        load_awaited_elements(load_config(config, overrides))  # now, not when the night has begun
    waits = "" if arm else "; it waits for 'rsoconsole arm'"
    with report_waits_to(output.print_to_stderr):
        run_engine(
            load_config(config, overrides),
            RunSettings(
                title="night",
                session=session,
                frames=frames,
                is_armed=arm,
                lifted=frozenset(override or ()),
            ),
            on_start=lambda folder: output.print_to_stderr(f"engine runs; session {folder}{waits}"),
        )


def status(
    *,
    socket: SocketOption = None,
    json_: JsonOption = False,
    prometheus: Annotated[
        bool, typer.Option("--prometheus", help="Print figures as Prometheus reads them.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="With --prometheus: a file, written whole or not at all.")
    ] = None,
) -> None:
    """Print one line about the running engine, for scripts and tmux.

    Where several satellites are followed, a table of them comes below, with where the telescope
    looks next: * marks the lead, + a track that is kept, "next" whether it is then in the field.
    Then come each one's nearest neighbour with their next closest approach, tracks that are in no
    catalogue, and objects that should be in the field and are not seen.

    With --prometheus --out FILE, run by a timer, figures are written for node_exporter's textfile
    collector; no port is opened. Without an engine it writes rsoconsole_up 0 and does not fail.

    Example: rsoconsole status --json

    Example: rsoconsole status --prometheus --out /var/lib/node_exporter/rsoconsole.prom
    """
    if prometheus:
        _write_metrics(socket, out)
        return
    if out is not None:
        raise typer.BadParameter("--out belongs to --prometheus")
    from rsoconsole.control import (
        ControlClient,
        Machine,
        Sender,
        ask_engine,
        fault_words,
        hold_words,
        mount_holder_words,
        mount_words,
        read_status,
        track_magnitude_words,
    )

    answer = ask_engine(ControlClient(socket, sender=Sender(name="status")), AskStatus())
    if json_:
        output.emit_json(dict(answer))
        return
    status = read_status(answer)
    state = f"{status.state} {hold_words(status)}".rstrip()
    words = [state, mount_holder_words(status.holder, "plain"), f"frame {status.frame_id}"]
    if status.target:
        words.append(f"follows {status.target}")
    if status.kept:
        way = "" if status.is_resumable else "'rsoconsole arm', then "
        words.append(f"{status.kept} kept: {way}'rsoconsole resume' follows it again")
    if status.ra_icrs_deg is not None and status.dec_icrs_deg is not None:
        words.append(direction(status.ra_icrs_deg, status.dec_icrs_deg, "bare"))
    if status.alt_deg is not None and status.az_deg is not None:
        words.append(f"alt {status.alt_deg:.1f} az {status.az_deg:.1f}")
    words += [track_magnitude_words(track) for track in status.tracks if track.is_lead]
    words.extend(mount_words(status))
    machine = status.machine or Machine()
    if machine.cpu_temperature_c is not None:
        words.append(f"CPU {machine.cpu_temperature_c:.0f} °C")
    words.extend(f"MACHINE {trouble}" for trouble in machine.troubles)
    last = status.last_stop
    if last is not None and not (last.is_at_rest or last.is_over):
        words.append(f"STOP {last.text}")
    words.extend(fault_words(status))
    output.say(" · ".join(word for word in words if word), *status.mount_lacks)
    _say_field(status)


def _write_metrics(socket: Path | None, out: Path | None) -> None:
    from rsoconsole.base import write_durably
    from rsoconsole.cli.telescope._prometheus import metrics_text
    from rsoconsole.control import ControlClient, Sender, ask_status

    try:
        text = metrics_text(ask_status(ControlClient(socket, sender=Sender(name="status"))))
    except ControlError:
        text = metrics_text(None)
    if out is None:
        output.emit_text(text)
        return
    with system_errors_as(ControlError, f"{out} cannot be written: "):
        write_durably(out, text.encode(), mode=0o644)


def _say_field(status: Status) -> None:
    """Print tracks, the next aim point, closest approaches, and objects that were not seen."""
    from rsoconsole.control import neighbours_and_missing_words, next_aim_parts, track_table

    lines: list[str] = []
    if len(status.tracks) > 1:
        lines += track_table(status)
        lines += [] if status.next_aim is None else [" · ".join(next_aim_parts(status.next_aim))]
    lines += neighbours_and_missing_words(status.pairs, status.unseen, status.uncatalogued)
    output.say(*lines)


def stop(
    config: ConfigOption = None, socket: SocketOption = None, json_: JsonOption = False
) -> None:
    """Stop the telescope now, with or without an engine, and say whether it has stopped.

    ABORT is sent at once; the mount's motion is then measured from the directions that it
    reports, which takes some seconds. Exit status: 0 it stands or tracks, 3 it moves on (cut its
    power), 4 not known.

    Where an engine does not answer at once, the command goes directly to the configured mount.
    With --socket it goes only to the engine that listens there.

    Example: rsoconsole stop
    """
    from rsoconsole.control import ControlClient, Found, Sender, StopNews, Stopping

    def directly(on_found: Callable[[Found], None]) -> None:
        from rsoconsole.instruments import stop_without_engine

        stop_without_engine(on_found, config_path=config, on_fault=_say_fault)

    def say(news: StopNews) -> None:
        if not json_:
            output.say(f"STOP {news.text}")

    # With a socket the configured mount is another engine's.
    way_past = directly if socket is None else None
    stopping = Stopping(lambda: ControlClient(socket, sender=Sender(name="stop")), way_past, say)
    stopping.begin()
    ended = stopping.wait()
    if json_:
        output.emit_json(ended, stopped=ended.phase == "stopped", reason=ended.reason or None)
    if ended.phase != "stopped":
        raise typer.Exit(STILL_MOVES_EXIT if ended.motion == "moves" else NOT_KNOWN_EXIT)


def _say_fault(words: str) -> None:
    output.print_to_stderr(f"rsoconsole: {words}")
