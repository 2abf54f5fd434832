"""The verb demo: a simulated observatory, and the real program behind it."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from rsoconsole.base import ConfigError, report_waits_to
from rsoconsole.cli.demo.demo_night import NightProcess, SimulatedNight, run_night
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.options import JsonOption, SessionOption, parse_site
from rsoconsole.config import Config, Preset, load_config
from rsoconsole.instruments import stop_without_engine
from rsoconsole.records import Site
from rsoconsole.words import direction, number, semi_major_axis_words

if TYPE_CHECKING:
    from rsoconsole.engine import Engine
    from rsoconsole.pipeline import Reduction
    from rsoconsole.simulator import Scenario, World

KeepFrames: TypeAlias = Literal["all", "detected", "last", "none"]

FRAMES_UNSEEN = 20
FRAME_TIMEOUT_S = 120.0
SOLVER_DEADLINE_S = 60.0
"""Solver deadline, s of wall time: long enough that slow and fast machines give the same night."""
DROPPED_TIMEOUT_S = 30.0
"""Time-out of a frame, s of wall time, in worlds where frames are dropped."""


def demo(
    *,
    named: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO", help="The same as --scenario.", autocompletion=completion.scenarios
        ),
    ] = None,
    scenario: Annotated[
        str,
        typer.Option(help="Which night; --list shows them.", autocompletion=completion.scenarios),
    ] = "intelsat-14",
    list_: Annotated[bool, typer.Option("--list", help="List the scenarios and exit.")] = False,
    world: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|random",
            help="Imperfections: a TOML file that names some, or 'random' (by the seed).",
        ),
    ] = None,
    preset: Annotated[Preset, typer.Option(help="Filter preset.")] = "adaptive",
    speed: Annotated[
        float | None, typer.Option(min=0, help="Virtual seconds a second; 0: as fast as it goes.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same night.")] = 1,
    headless: Annotated[
        bool, typer.Option("--headless", help="No console: print a summary at the end.")
    ] = False,
    lines: Annotated[
        bool, typer.Option("--lines", help="No console: print a line for each frame.")
    ] = False,
    frames: Annotated[
        int | None,
        typer.Option(min=1, help="Exposures to take. Default: 20; in the console: until you quit."),
    ] = None,
    session: SessionOption = None,
    keep_frames: Annotated[
        KeepFrames | None,
        typer.Option(
            help="Which frames' pixels to keep in the session. Default: in the console those of the"
            " last 12, else none."
        ),
    ] = None,
    tle: Annotated[
        list[Path] | None,
        typer.Option(
            help="Element sets to find the satellite's name in, and --target; may be repeated."
            " Default: those after which the simulated ones move."
        ),
    ] = None,
    target: Annotated[
        list[str] | None,
        typer.Option(
            help="A satellite of the element sets, by catalogue number or name, instead of a"
            " scenario; may be repeated."
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(help="UTC of a --target night's start. Default: when it can be seen."),
    ] = None,
    site: Annotated[
        str | None, typer.Option(help="LAT,LON,ELEV of a --target night. Default: Daytona Beach.")
    ] = None,
    json_: JsonOption = False,
) -> None:
    """Watch a simulated observatory find a satellite and follow it.

    Opens the console where there is a terminal, else prints a line for each
    frame. A simulated mount and camera speak INDI on this machine; all else is
    the real program. Your configuration file counts only for the folder of the
    sessions and the library that speaks INDI.

    The console is at its best from 80 x 24; x is STOP, q leaves, F1 shows the
    other keys. A demo left running ends by itself some time after its night.

    'rsoconsole status' and 'rsoconsole stop' reach it from another terminal.
    Where another engine runs already they need --socket with the path that the
    demo prints.

    --world makes the night imperfect: shutter, seeing, focus, wind, sensor, clock,
    optics, mount, flashing, clouds, aircraft, lost frames. Each imperfection is a
    setting, e.g. drift_px = 12 under [stars]; rsoconsole/simulator/README.md lists
    all with units, and how 'random' draws their values. A setting that the file
    does not name keeps its default.

    --target makes a night of any satellites: without --at the program picks a time
    when they are up, sunlit, in a dark sky and in one field. Every object of the
    element sets is in that sky. Beyond 12 deg from the equator it needs the
    whole sky's stars ('rsoconsole index install').

    Example: rsoconsole demo --headless --scenario intelsat-14 --frames 40 --json

    Example: rsoconsole demo --target 26407 --tle gps.tle --site 52.2,21.0,110

    Example: rsoconsole demo --world random --seed 7
    """
    from rsoconsole.cli.demo._demo_targets import config_for_plan, plan_targets, plan_words
    from rsoconsole.simulator import (
        DAYTONA_BEACH,
        NIGHT_FRAMES,
        all_scenarios,
        elements_path,
        scenario_named,
    )

    if list_:
        for known in all_scenarios().values():
            row = {"scenario": known.name, "title": known.title, "description": known.description}
            output.emit_json(row) if json_ else output.say(f"{known.name:14} {known.description}")
        return
    catalogue = [each.resolve() for each in tle or [elements_path()]]
    is_seen = not (headless or json_) and sys.stdin.isatty() and sys.stdout.isatty()
    keeps: KeepFrames = keep_frames or ("last" if is_seen and not lines else "none")
    pace = (0.0 if headless or json_ else 10.0) if speed is None else speed
    if frames is None and not is_seen:
        frames = FRAMES_UNSEEN
    scenario = named or scenario
    night = SimulatedNight(scenario=scenario, seed=seed, speed=pace, frames=frames, session=session)
    if target:
        config = demo_config(
            parse_site(site) if site else DAYTONA_BEACH,
            preset=preset,
            keep_frames=keeps,
            catalogue=catalogue,
        )
        plan = plan_targets(target, config, at=at, seed=seed, frames=frames or NIGHT_FRAMES)
        config = config_for_plan(config, plan)
        night = replace(night, scenario=plan.title, plan=plan.to_table())
        heading: tuple[str, ...] = (plan_words(plan),)
    elif at or site:
        raise typer.BadParameter("--at and --site belong to a night of --target")
    else:
        known = scenario_named(scenario)
        config = demo_config(known.site, preset=preset, keep_frames=keeps, catalogue=catalogue)
        config = config_for_scenario(known, config)
        heading = (known.title, *known.description.splitlines())
    imperfect = _world_of(world, seed)
    config = config_for_world(imperfect, config)
    night = replace(night, world=imperfect.non_default_settings())
    if not (headless or json_):
        output.say(*heading)
    if is_seen and not lines:
        _watch_night(config, night)
        return
    with report_waits_to(output.print_to_stderr):
        found = run_night(config, night) if headless or json_ else _print_night(config, night)
    if json_:
        output.emit_json(found)
    else:
        _say_summary(found)


def _world_of(named: str | None, seed: int) -> "World":
    """The world that the option names. Raises ConfigError with the remedy."""
    from rsoconsole.simulator import DEFAULT_WORLD, load_world, random_world

    if named is None:
        return DEFAULT_WORLD
    return random_world(seed) if named == "random" else load_world(Path(named))


def config_for_scenario(scenario: "Scenario", config: Config) -> Config:
    """Return the configuration with the settings that the scenario's night needs."""
    sections = {
        name: getattr(config, name).model_copy(update=dict(values))
        for name, values in scenario.settings.items()
    }
    return config.model_copy(update=sections)


def config_for_world(world: "World", config: Config) -> Config:
    """Return the configuration with what an operator would know of a simulated telescope."""
    from rsoconsole.simulator import binned_optics

    exposure: dict[str, float] = {}
    if world.known_latency_s:
        exposure["header_latency_s"] = world.known_latency_s
    if world.shutter.line_time_us:
        exposure["line_time_us"] = round(world.shutter.line_time_us)
    if world.frames.dropped_rate:
        exposure["frame_timeout_s"] = DROPPED_TIMEOUT_S
    return config.model_copy(
        update={
            "optics": binned_optics(config.optics, world),
            "exposure": config.exposure.model_copy(update=exposure),
        }
    )


def _watch_night(config: Config, night: SimulatedNight) -> None:
    """Run the night in a process of its own, the console in this terminal."""
    from rsoconsole.console import run_console

    output.say("starting the simulated observatory and the engine ...")
    process = NightProcess(config, night, on_wait=output.say)
    at = _socket_words(process.socket)
    if at:
        output.say(*_beside_lines(process.socket))
    ending = run_console(socket=process.socket, owns_engine=True, stop_directly=stop_without_engine)
    if ending == "stop engine":
        output.say("the engine ends ...")
        _say_summary(process.wait_for_figures())
        return
    output.say(f"the demo's engine runs on; session {process.session}")
    output.say("left alone it ends some time after its night; the console again, and its end:")
    output.say(f"rsoconsole console{at}", f"rsoconsole quit{at}")


def _socket_words(socket: Path) -> str:
    """Option that a verb needs to reach the engine; empty where it is at the default place."""
    from rsoconsole.control import default_socket_path

    return "" if socket == default_socket_path() else f" --socket {shlex.quote(str(socket))}"


def _beside_lines(socket: Path) -> tuple[str, ...]:
    return (
        "another engine runs, to which every verb goes; this demo is reached by",
        f"rsoconsole status{_socket_words(socket)}",
    )


def _print_night(config: Config, night: SimulatedNight) -> dict[str, Any]:
    """Run the night here, with a line for each frame; return its figures."""

    def has_started(_folder: Path, socket: Path) -> None:
        if _socket_words(socket):
            output.say(*_beside_lines(socket))
        output.say(_CYCLE_HEADING)

    return run_night(
        config,
        night,
        on_cycle=lambda engine, seen: output.say(_cycle_line(engine, seen)),
        on_start=has_started,
    )


_CYCLE_HEADING = 'frame state    RA          Dec         confidence  residual ± 3 sigma (")'


def _cycle_line(engine: "Engine", reduction: "Reduction") -> str:
    """Line on a frame and on the loop's state after it; ``_CYCLE_HEADING`` names the columns."""
    following = engine.following
    start = f"{engine.frame_id:5d} {following.state:8}"
    track, taken = following.track, following.lead_measured
    if following.state == "TRACK" and track is not None and taken is not None:
        place = direction(taken.ra_icrs_deg, taken.dec_icrs_deg, "bare")
        line = f"{start} {place} {taken.confidence:9.2f}"
        if track.innovation_arcsec is None or track.sigma_innovation_arcsec is None:
            together = len(track.begun_through) + 2
            agree = "two frames agree" if together == 2 else f"{together} frames agree"
            return f"{line}   {agree}: locked"
        east, north = track.innovation_arcsec
        bounds = [3.0 * sigma for sigma in track.sigma_innovation_arcsec]
        return f"{line}   {east:+5.1f} ± {bounds[0]:.1f}  {north:+5.1f} ± {bounds[1]:.1f}"
    if reduction.measurements:
        best = reduction.measurements[0]
        place = direction(best.ra_icrs_deg, best.dec_icrs_deg, "bare")
        return f"{start} {place} {best.confidence:9.2f}   measured, not followed yet"
    return f"{start} {reduction.absence}, {reduction.star_count} stars"


def _say_summary(found: dict[str, Any]) -> None:
    tracks = found["tracks"]
    target = found["target"] or "nothing"
    states = ", ".join(f"{state} {count}" for state, count in found["states"].items())
    output.say(
        f"{found['frames']} frames{f' ({states})' if states else ''}",
        f"{found['detections']} streaks detected; followed {target}"
        + (f", locked after {found['locked_after_frames']} frames" if found["target"] else ""),
        f"{found['misses']} misses: frames in which what was followed was looked for and not found",
    )
    for each in tracks:
        output.say(*(f"  {line}" for line in _track_words(each)))
    if found["target"]:
        if len(tracks) > 1:
            output.say(f"  of {found['target']}:")
        names = {
            "measured_rms_arcsec": "one measurement, rms against truth (arcsec)",
            "prediction_rms_arcsec": "filter (averages many), one step ahead",
            "nis_mean": "NIS mean (2)",
            "inside_3sigma": "3σ holds",
        }
        for key, words in names.items():
            output.say(f"  {words:42} {number(found[key], '.2f')}")
    if not tracks:
        output.say(f"  {'orbit':42} none")
    total = found["latency_ms"].get("total")
    if total:
        spread = f"{total['median']:.0f}, 95 %: {total['p95']:.0f}"
        output.say(f"  {'last byte to slew command (ms)':42} {spread}")
    output.say(f"session {found['session']}")


def _track_words(track: dict[str, Any]) -> tuple[str, str]:
    """Two lines on a satellite that was followed: name, frames, how it ended; orbit."""
    name = track["name"] or f"unidentified (track {track['tracks'][-1]})"
    ending = {
        "TRACK": "followed to the end",
        "COAST": "coasted at the end",
        "LOST": f"lost in frame {track['last_frame']}: {track['lost']}",
        "IDLE": f"ended in frame {track['last_frame']}",
    }[track["state"]]
    orbit = track["orbit"]
    words = "no orbit"
    if orbit is not None:
        words = f"{orbit['label']}, {semi_major_axis_words(orbit['a_km'], orbit['sigma_a_km'])}"
    return f"{name}: measured in {track['frames']} frames, {ending}", f"  {words}"


def demo_config(
    site: Site, *, preset: Preset, keep_frames: KeepFrames, catalogue: Sequence[Path] = ()
) -> Config:
    """Return the default configuration for a site, with two of the user's own settings.

    The two are the sessions' folder and the library that speaks INDI. The defaults describe the
    telescope that the scenarios simulate. ``catalogue``: element files.
    """
    own = _own_settings()
    return Config.model_validate(
        {
            "site": {"name": "simulated", **asdict(site)},
            "indi": {"client": own.indi.client},
            "exposure": {"frame_timeout_s": FRAME_TIMEOUT_S},
            "solver": {"deadline_s": SOLVER_DEADLINE_S},
            "filter": {"preset": preset},
            "catalogue": {"tle_files": tuple(catalogue)},
            "session": {"root": own.session.root, "keep_frames": keep_frames},
        }
    )


def _own_settings() -> Config:
    """The user's settings, as far as they can be read."""
    try:
        return load_config()
    except (ConfigError, OSError) as error:
        own = Config()
        root = own.session.root
        output.print_to_stderr(
            f"rsoconsole: {error}; the demo does without, its session goes to {root}"
        )
        return own
