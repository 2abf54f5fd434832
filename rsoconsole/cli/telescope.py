"""Verbs that run a telescope: demo, engine, status, stop."""

import math
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from rsoconsole.cli import output
from rsoconsole.config import Config, load_config

JsonOption = Annotated[bool, typer.Option("--json", help="Print only JSON on stdout.")]
SessionOption = Annotated[
    Path | None, typer.Option(help="Session folder, new or empty. Default: in your data folder.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="Configuration file (see 'config show').")
]


def register(app: typer.Typer) -> None:
    """Hang the verbs into the program."""
    app.command()(demo)
    app.command()(engine)
    app.command()(status)
    app.command()(stop)


def demo(
    *,
    scenario: Annotated[str, typer.Option(help="Which night; --list shows them.")] = "intelsat-14",
    list_: Annotated[bool, typer.Option("--list", help="List the scenarios and exit.")] = False,
    preset: Annotated[str, typer.Option(help="Filter preset: tuned or paper.")] = "tuned",
    speed: Annotated[
        float | None,
        typer.Option(min=0, help="Virtual seconds a second; 0: as fast as it goes."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same night.")] = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="Print a summary only, no line a frame.")
    ] = False,
    frames: Annotated[int, typer.Option(min=1, help="Exposures to take.")] = 20,
    session: SessionOption = None,
    keep_frames: Annotated[
        str, typer.Option(help="Which frames to keep in the session: all, detected, none.")
    ] = "none",
    json_: JsonOption = False,
) -> None:
    """Watch a simulated observatory find a satellite and follow it.

    A simulated mount and camera speak INDI on this machine; everything behind them is the real
    program. Example: rsoconsole demo --headless --scenario intelsat-14 --frames 40 --json
    """
    from rsoconsole.simulator.scenarios import all_scenarios, scenario_named

    if list_:
        for known in all_scenarios().values():
            row = {"scenario": known.name, "title": known.title, "description": known.description}
            output.emit_json(row) if json_ else output.say(f"{known.name:14} {known.description}")
        return
    night = scenario_named(scenario)
    config = load_config(
        overrides={
            "site.name": "simulated",
            "site.latitude_deg": night.site.latitude_deg,
            "site.longitude_deg": night.site.longitude_deg,
            "site.elevation_m": night.site.elevation_m,
            "filter.preset": preset,
            "session.keep_frames": keep_frames,
        }
    )
    wants_lines = not (headless or json_)
    pace = (0.0 if headless or json_ else 10.0) if speed is None else speed
    if wants_lines:
        output.say(f"{night.title}: {night.description}")
    found = _run_demo(
        config,
        scenario=scenario,
        seed=seed,
        speed=pace,
        frames=frames,
        session=session,
        wants_lines=wants_lines,
    )
    if json_:
        output.emit_json(found)
    else:
        _say_summary(found)


def _run_demo(
    config: Config,
    *,
    scenario: str,
    seed: int,
    speed: float,
    frames: int,
    session: Path | None,
    wants_lines: bool,
) -> dict[str, Any]:
    from rsoconsole.cli.cycle_line import cycle_line
    from rsoconsole.engine.service import RunSettings, run_engine
    from rsoconsole.engine.summary import read_truth, summarise
    from rsoconsole.session.reader import SessionReader
    from rsoconsole.simulator.launch import start_observatory

    with tempfile.TemporaryDirectory(prefix="rsoconsole-") as scratch:
        truth_path = Path(scratch) / "truth.jsonl"
        with start_observatory(scenario, seed, speed, truth_path) as observatory:
            indi = config.indi.model_copy(
                update={
                    "host": observatory.host,
                    "port": observatory.port,
                    "mount": observatory.mount_name,
                    "camera": observatory.camera_name,
                    "simulated": True,
                }
            )
            folder = run_engine(
                config.model_copy(update={"indi": indi}),
                RunSettings(
                    title=f"{scenario} seed {seed}",
                    session=session,
                    frames=frames,
                    is_armed=True,
                    socket=Path(scratch) / "engine.sock",
                ),
                on_cycle=(lambda engine, seen: output.say(cycle_line(engine, seen)))
                if wants_lines
                else None,
                on_start=(lambda folder: output.say(f"session {folder}")) if wants_lines else None,
            )
        records = (record for _, _, record in SessionReader(folder).records())
        figures = summarise(records, read_truth(truth_path))
    return {"scenario": scenario, "seed": seed, "session": str(folder), **figures}


def _say_summary(found: dict[str, Any]) -> None:
    target = found["target"] or "nothing"
    output.say(
        f"{found['frames']} frames, {found['detections']} detections, {found['misses']} misses;"
        f" followed {target}"
        + (f", locked after {found['locked_after_frames']} frames" if found["target"] else "")
    )
    if found["target"]:
        names = {
            "measured_rms_arcsec": "measured, rms against truth (arcsec)",
            "prediction_rms_arcsec": "predicted one step ahead, rms (arcsec)",
            "nis_mean": "NIS, mean (ideal 2)",
            "inside_3sigma": "inside 3 sigma",
        }
        for key, words in names.items():
            value = found[key]
            output.say(f"  {words:42} {'-' if value is None else f'{value:.2f}'}")
    total = found["latency_ms"].get("total")
    if total:
        spread = f"{total['median']:.0f}, 95 %: {total['p95']:.0f}"
        output.say(f"  {'last byte to slew command (ms)':42} {spread}")
    output.say(f"session {found['session']}")


def engine(
    config: ConfigOption = None,
    session: SessionOption = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="Begin to search at once; otherwise wait to be armed.")
    ] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, help="End after this many exposures.")
    ] = None,
) -> None:
    """Run the telescope; no terminal needed. SIGTERM stops it safely.

    Example: rsoconsole engine --config ~/.config/rsoconsole/config.toml --arm
    """
    from rsoconsole.engine.service import RunSettings, run_engine

    run_engine(
        load_config(config),
        RunSettings(title="night", session=session, frames=frames, is_armed=arm),
        on_start=lambda folder: output.complain(f"engine runs; session {folder}"),
    )


def status(json_: JsonOption = False) -> None:
    """One line about the running engine, for scripts and tmux.

    Example: rsoconsole status --json
    """
    from rsoconsole.control import ControlClient

    data = dict(ControlClient(by="status").send("status").data)
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


def stop(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """Stop the telescope now, engine or no engine.

    Example: rsoconsole stop
    """
    from rsoconsole.control import ControlClient
    from rsoconsole.errors import ControlError, InstrumentError
    from rsoconsole.instruments.indi_wire import stop_mount

    try:
        data: dict[str, Any] = dict(ControlClient(by="stop").send("stop").data)
    except ControlError:
        indi = load_config(config).indi
        result = stop_mount(indi.host, indi.port, indi.mount)
        data = {"stopped": result.stopped, "path": result.path, "ms": result.ms}
    if json_:
        output.emit_json(data)
    else:
        ending = "stopped" if data["stopped"] else "NOT confirmed stopped"
        output.say(f"{ending} in {math.ceil(data['ms'])} ms, path {data['path']}")
    if not data["stopped"]:
        raise InstrumentError(
            "the mount did not confirm that it stopped: cut its power if it moves"
        )
