"""Record the sample session again: a simulated night of Intelsat 14, small enough to ship.

    python sessions/make_sample.py [--out FOLDER]

Run from the project's root; it takes a minute. Engine and observatory are the demo's own, with a
camera binned 2 x 2, one bank of clouds, and an operator whose commands stand in ``COMMANDS``. Same
seed, same night: only the times that the stages took are those of the machine. Afterwards the
pixels of all frames but ``KEPT_FRAMES`` are pruned, and ``upkeep.jsonl`` says so as for any other
session: the hash of every frame stays on record.
"""

import argparse
import json
import logging
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from rsoconsole.cli.demo.demo import config_for_world, demo_config
from rsoconsole.cli.demo.demo_night import SimulatedNight, run_night
from rsoconsole.config import with_setting
from rsoconsole.control import (
    Command,
    ControlClient,
    Goto,
    MarkByHand,
    Note,
    Nudge,
    Reject,
    Resume,
    Sender,
    Set,
)
from rsoconsole.engine import Engine
from rsoconsole.pipeline import Reduction
from rsoconsole.session import SessionReader
from rsoconsole.session.files.upkeep_log import add_note
from rsoconsole.simulator import elements_path, scenario_named, world_from

SAMPLE = Path(__file__).parent / "intelsat-14"
SCENARIO = "intelsat-14"
SEED = 119
"""Of those of which the clouds come once, between two turns of the satellite."""
FRAMES = 36
WORLD = {
    "seeing": {"fwhm_arcsec": 4.0},
    "sensor": {"binning": 2},
    "clouds": {"rate_h": 2.0, "duration_s": 60.0, "extinction_mag": 12.0},
    "satellite": {"fainter_mag": 0.65},
}
KEPT_FRAMES = (9, 13)
MAX_BYTES = 8_000_000
INDI_PORT = 7624
ROOT = "sessions"
ELEMENTS = "rsoconsole/simulator/data/belt_20230622.tle"
"""In place of what it was on the machine; both paths as they are seen from the project's root."""

OPERATOR = Sender.console("observer@demo")
COMMANDS: Mapping[int, Sequence[Command]] = {
    5: (Note(text="one satellite in the field, no clouds"),),
    12: (Set(name="detector.tau", value=0.95),),
    14: (
        Set(name="detector.tau", value=0.1),
        Set(name="filter.q_multiplier", value=2.0, frames=4),
        Set(name="filter.r_multiplier", value=1.5, frames=4),
    ),
    20: (Reject(frame_id=20),),
    24: (Note(text="clouds from the west"),),
    # Orion in June: the limits refuse it.
    27: (Goto(ra_icrs_deg=83.8, dec_icrs_deg=-5.4),),
    29: (Nudge(east_arcmin=6.0, north_arcmin=-4.0),),
    # Too faint for the detector; seen in the close-up, which shows where it was expected.
    35: (MarkByHand(frame_id=35, x_a_px=780.0, y_a_px=889.0, x_b_px=840.0, y_b_px=886.5),),
}
"""What the operator says, by the frame after which it is said. After a move by hand one frame is
taken where it led, then the operator gives the mount back."""
REFUSED = {"goto"}
ARRIVED = "the mount has arrived"


class Operator:
    """Sends ``COMMANDS`` over the engine's socket, from the loop's own thread: never in between."""

    def sit_down(self, socket: Path) -> None:
        """The engine listens."""
        self._client = ControlClient(socket, OPERATOR)

    def on_cycle(self, engine: Engine, _reduction: Reduction) -> None:
        """A frame has been followed."""
        for command in COMMANDS.get(engine.frame_id, ()):
            self._send(command)

    @contextmanager
    def watching(self) -> Iterator[None]:
        """While this lasts the mount is given back after each move by hand."""
        log, handler = logging.getLogger("rsoconsole.engine"), _OnArrival(self._give_back)
        before = log.level
        log.setLevel(logging.INFO)
        log.addHandler(handler)
        try:
            yield
        finally:
            log.removeHandler(handler)
            log.setLevel(before)

    def _give_back(self) -> None:
        self._send(Resume())

    def _send(self, command: Command) -> None:
        outcome = self._client.send(command)
        if outcome.ok == (command.verb in REFUSED):
            raise SystemExit(f"{command.words()}: {outcome.message or 'not refused'}")


class _OnArrival(logging.Handler):
    def __init__(self, act: Callable[[], None]) -> None:
        super().__init__(logging.INFO)
        self._act = act

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage() == ARRIVED:
            self._act()


def record(folder: Path) -> None:
    """The night, into a folder; prints how good it was."""
    world = world_from(WORLD)
    config = demo_config(
        scenario_named(SCENARIO).site,
        preset="adaptive",
        keep_frames="all",
        catalogue=[elements_path()],
    )
    # Another night that was not ended would be continued.
    config = with_setting(config, "session.root", str(folder.parent))
    night = SimulatedNight(
        scenario=SCENARIO,
        seed=SEED,
        speed=0.0,
        frames=FRAMES,
        session=folder,
        world=world.non_default_settings(),
    )
    operator = Operator()
    with operator.watching():
        figures = run_night(
            config_for_world(world, config),
            night,
            on_cycle=operator.on_cycle,
            on_start=lambda _folder, socket: operator.sit_down(socket),
        )
    print(json.dumps({name: figures[name] for name in ("states", "orbit", "identified")}, indent=1))


def prune(folder: Path) -> None:
    """Leave the pixels of some frames; what goes is on record beside the session."""
    reader = SessionReader(folder)
    kept = {reader.frame_path(number) for number in KEPT_FRAMES}
    gone = [path for path in sorted((folder / "frames").iterdir()) if path not in kept]
    files = [str(path.relative_to(folder)) for path in gone]
    size = sum(path.stat().st_size for path in gone)
    *_, (_, t_last_utc_ns, _) = reader.records()
    add_note(folder, "prune", t_last_utc_ns, {"what": "frames", "files": files, "bytes": size})
    for path in gone:
        path.unlink()


def forget_machine(folder: Path) -> None:
    """Leave nothing of the machine it was made on, and one file of the database."""
    with closing(sqlite3.connect(folder / "session.db")) as database, database:
        ((text,),) = database.execute("SELECT value FROM meta WHERE key = 'config'")
        config = json.loads(text)
        config["indi"]["port"] = INDI_PORT
        config["session"]["root"] = ROOT
        config["catalogue"]["tle_files"] = [ELEMENTS]
        database.execute("UPDATE meta SET value = ? WHERE key = 'config'", (json.dumps(config),))
        database.execute("DELETE FROM meta WHERE key IN ('pid', 'writer')")
    with closing(sqlite3.connect(folder / "session.db")) as database:
        database.execute("PRAGMA journal_mode=DELETE")
        database.execute("VACUUM")
    path = folder / "config.toml"
    said = {"port": str(INDI_PORT), "root": f'"{ROOT}"', "tle_files": f'["{ELEMENTS}"]'}
    lines = path.read_text(encoding="utf-8").splitlines()
    named = (line.partition(" = ") for line in lines)
    kept = [f"{name} = {said[name]}" if name in said else name + eq + to for name, eq, to in named]
    path.write_text("\n".join(kept) + "\n", encoding="utf-8")


def main() -> None:
    """Record, prune, put in place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=SAMPLE)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for kind in ("DATA", "STATE", "CACHE", "CONFIG"):
            folder = place / kind.lower()
            folder.mkdir()
            os.environ[f"XDG_{kind}_HOME"] = str(folder)
        (place / "run").mkdir(mode=0o700)
        os.environ["XDG_RUNTIME_DIR"] = str(place / "run")
        night = place / "night"
        record(night)
        prune(night)
        forget_machine(night)
        size = sum(path.stat().st_size for path in night.rglob("*") if path.is_file())
        print(f"{size / 1e6:.2f} MB")
        if size > MAX_BYTES:
            raise SystemExit(f"more than {MAX_BYTES / 1e6:.0f} MB: keep fewer frames")
        shutil.rmtree(options.out, ignore_errors=True)
        shutil.copytree(night, options.out)


if __name__ == "__main__":
    main()
