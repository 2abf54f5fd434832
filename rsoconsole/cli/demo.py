"""The verb demo: a simulated observatory, and the real program behind it."""

import tempfile
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import typer

from rsoconsole.cli import output
from rsoconsole.cli.telescope import JsonOption, SessionOption
from rsoconsole.config import Config, SessionConfig, load_config
from rsoconsole.errors import ConfigError, ControlError
from rsoconsole.records import Site

Preset: TypeAlias = Literal["tuned", "paper"]
KeepFrames: TypeAlias = Literal["all", "detected", "none"]

FRAME_TIMEOUT_S = 120.0
SOLVER_DEADLINE_S = 60.0
"""Wall-clock limits so wide that a slow machine gives the same night as a fast one."""


def register(app: typer.Typer) -> None:
    """Hang the verb into the program."""
    app.command()(demo)


def demo(
    *,
    scenario: Annotated[str, typer.Option(help="Which night; --list shows them.")] = "intelsat-14",
    list_: Annotated[bool, typer.Option("--list", help="List the scenarios and exit.")] = False,
    preset: Annotated[Preset, typer.Option(help="Filter preset.")] = "tuned",
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
        KeepFrames, typer.Option(help="Which frames to keep in the session.")
    ] = "none",
    json_: JsonOption = False,
) -> None:
    """Watch a simulated observatory find a satellite and follow it.

    A simulated mount and camera speak INDI on this machine; everything behind them is the real
    program. Your configuration file has no part in it, but for the folder of the sessions.
    'rsoconsole status' and 'rsoconsole stop' reach it from another terminal.
    Example: rsoconsole demo --headless --scenario intelsat-14 --frames 40 --json
    """
    from rsoconsole.simulator.scenarios import all_scenarios, scenario_named

    if list_:
        for known in all_scenarios().values():
            row = {"scenario": known.name, "title": known.title, "description": known.description}
            output.emit_json(row) if json_ else output.say(f"{known.name:14} {known.description}")
        return
    night = scenario_named(scenario)
    config = demo_config(night.site, preset=preset, keep_frames=keep_frames)
    wants_lines = not (headless or json_)
    pace = (0.0 if headless or json_ else 10.0) if speed is None else speed
    if wants_lines:
        output.say(f"{night.title}\n{night.description}")
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
    from rsoconsole.cli.cycle_line import HEADING, cycle_line
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
                    socket=control_socket(Path(scratch)),
                ),
                on_cycle=(lambda engine, seen: output.say(cycle_line(engine, seen)))
                if wants_lines
                else None,
                on_start=(lambda _folder: output.say(HEADING)) if wants_lines else None,
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


def demo_config(site: Site, *, preset: Preset, keep_frames: KeepFrames) -> Config:
    """The defaults at the scenario's site; of the user's own settings only the sessions' folder.

    The defaults describe the telescope that the scenarios simulate.
    """
    return Config.model_validate(
        {
            "site": {
                "name": "simulated",
                "latitude_deg": site.latitude_deg,
                "longitude_deg": site.longitude_deg,
                "elevation_m": site.elevation_m,
            },
            "exposure": {"frame_timeout_s": FRAME_TIMEOUT_S},
            "solver": {"deadline_s": SOLVER_DEADLINE_S},
            "filter": {"preset": preset},
            "session": {"root": _sessions_root(), "keep_frames": keep_frames},
        }
    )


def _sessions_root() -> Path:
    try:
        return load_config().session.root
    except (ConfigError, OSError) as error:
        root = SessionConfig().root
        output.complain(f"rsoconsole: {error}; the demo does without, its session goes to {root}")
        return root


def control_socket(scratch: Path) -> Path | None:
    """Where the demo listens: None, the default place, if no engine has it; else in ``scratch``."""
    from rsoconsole.control.place import EngineLock, default_socket_path

    try:
        # Asking an engine would not do: one that hangs or has just begun holds the place, too.
        with EngineLock(default_socket_path()):
            return None
    except (ControlError, OSError):
        return scratch / "engine.sock"
