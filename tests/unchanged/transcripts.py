"""Every order of seeded nights, in sequence: 30 of odd mounts by INDI, 30 of whole engines.

    python -m tests.unchanged.transcripts          compares with what was written down
    python -m tests.unchanged.transcripts --write  writes it down

The first are random nights of one odd mount (``tests/rigs/odd_sequence.py``): each INDI vector that
its driver receives, what the mount's process answers, what the engine's watch says. In the second
whole engines search, track, coast and lose a satellite among drawn commands, limits and foreign
hands, with STOP in each of the loop's states.
"""

import json
import logging
import random
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.instruments import StopResult
from rsoconsole.records import Event, OperatorAction, SlewCommand, StateChange
from rsoconsole.sky import altaz_to_icrs
from tests.engine.test_wishes import SlowMount
from tests.makers import T0_UTC_NS
from tests.rigs.engine_rig import SITE, Rig, command_handler_of, rig, told
from tests.rigs.odd_sequence import OddNight

KEPT = Path(__file__).with_name("transcripts.jsonl")
SEEDS = range(30)
FRAMES = 40
STOPS = 3
STATES = ("SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST", "MANUAL")
"""In one of which, by the seed, a whole engine is stopped; in others by chance."""
OVERRIDES = ("sun", "index", "pointing", "disk", "clock")
NS = 1_000_000_000
DIGITS = 6
WALL = frozenset(("ms", "stop_ms", "stop_ordered_ms", "ordered_ms", "measured_ms", "id"))
"""Members that are of the wall's time, or of the process."""


def rounded(value: Any) -> Any:
    """As JSON has it, with figures that another processor finds too."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, Mapping):
        return {str(key): rounded(each) for key, each in value.items() if key not in WALL}
    if isinstance(value, list | tuple | set | frozenset):
        return [rounded(each) for each in value]
    return value


# -- odd mounts ------------------------------------------------------------------------------------


def odd_night(seed: int) -> list[Any]:
    """One of an odd mount: what its driver received, what was answered, what was said."""
    night = OddNight(seed)
    judged = night.run()
    received = [
        [round(at_s - 1000.0, 2), name, {key: _figure(text) for key, text in values.items()}]
        for at_s, name, values in night.model.received
    ]
    told_ = [rounded(dict(each)) for each in night.voice.said]
    events = [[each.level, each.topic] for each in night.events]
    return [received, told_, events, judged.faults]


def _figure(text: str) -> Any:
    try:
        return rounded(float(text))
    except ValueError:
        return text


# -- whole engines ---------------------------------------------------------------------------------


class Written(SlowMount):
    """A slow mount that writes down each order."""

    def __init__(self, clock: Any) -> None:
        super().__init__(clock)
        self.lines: list[Any] = []

    def _write(self, verb: str, *figures: Any) -> None:
        at_s = (self.clock.t_utc_ns - T0_UTC_NS) / NS
        self.lines.append(rounded([round(at_s, 3), verb, *figures]))

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        self._write("slew", ra_icrs_deg, dec_icrs_deg)
        super().slew(ra_icrs_deg, dec_icrs_deg, now_utc_ns)

    def park(self) -> None:
        self._write("park")
        super().park()

    def unpark(self) -> None:
        self._write("unpark")
        super().unpark()

    def set_tracking(self, is_on: bool) -> None:
        self._write("tracking", is_on)
        super().set_tracking(is_on)

    def abort(self, timeout_s: float = 2.0, **news: Any) -> StopResult:
        self._write("abort")
        return super().abort(timeout_s, **news)

    def moved_by_another(self, to_deg: tuple[float, float]) -> None:
        """By another program."""
        self._write("another's go-to", *to_deg)
        self._look()
        self.way = None
        self._go(to_deg)


class EngineNight:
    """One whole engine, one seed."""

    def __init__(self, seed: int) -> None:
        self._draw = random.Random(seed)
        self._busy = self._draw.choice((0.005, 0.01, 0.04))
        self._stops_in = STATES[seed % len(STATES)]
        first = self._draw.randint(2, 5)
        gaps = [(self._draw.randint(8, FRAMES), 4 * k) for k in range(3)]
        unseen = {n for at, length in gaps for n in range(at, at + length)}
        if self._stops_in in ("COAST", "LOST"):  # nobody disturbs what leads there
            self._busy, unseen = 0.0, set(range(first + 6, FRAMES))
        settings = {"limits": {"past_meridian_deg": 20}, "filter": {"max_coast_s": 150.0}}
        config = Config.model_validate(settings)
        self.whole: Rig = rig(set(range(first, FRAMES)) - unseen, config, make_mount=Written)
        self.handler: CommandHandler = command_handler_of(self.whole)
        self._wait = self.whole.clock.wait_until
        self.whole.clock.wait_until = self.wait_until  # type: ignore[method-assign]
        self._turns = 0
        self._is_inside = False
        self.stopped_in: list[str] = []

    @property
    def mount(self) -> Written:
        """Its mount."""
        assert isinstance(self.whole.mount, Written)
        return self.whole.mount

    def wait_until(self, t_utc_ns: int) -> bool:
        """Time passes; now and then somebody does something first."""
        self._turns += 1
        if self._turns > 900 or self.whole.engine.frame_id > FRAMES:
            self.whole.queue.request_shutdown()
        elif not self._is_inside:
            self._is_inside = True
            self._act_now_and_then()
            self._is_inside = False
        return self._wait(t_utc_ns)

    def _act_now_and_then(self) -> None:
        state, draw = self.whole.engine.authority.state, self._draw
        if self._turns == 1 or (state == "IDLE" and draw.random() < 0.1):
            self._do("arm", state)
        elif state == self._stops_in and len(self.stopped_in) < STOPS and draw.random() < 0.2:
            self._do("stop", state)
        elif draw.random() < self._busy:
            self._act(state)

    def _act(self, state: str) -> None:
        draw = self._draw
        kinds = {
            "arm": 9.0,
            "stop": 3.0,
            "disarm": 1.0,
            "hold": 1.0,
            "resume": 3.0,
            "goto": 2.0,
            "nudge": 1.5,
            "park": 0.7,
            "unpark": 1.5,
            "track": 0.4,
            "abort": 0.7,
            "seek": 0.7,
            "set": 1.0,
            "another": 1.0,
        }
        self._do(draw.choices(list(kinds), list(kinds.values()))[0], state)

    def _do(self, verb: str, state: str) -> None:
        draw = self._draw
        altitude, azimuth = draw.uniform(5.0, 80.0), draw.uniform(90.0, 270.0)
        at_deg = altaz_to_icrs(SITE, altitude, azimuth, self.whole.clock.t_utc_ns)
        arguments: dict[str, Any] = {
            "arm": {"override": [*OVERRIDES]},
            "goto": {"ra_icrs_deg": float(at_deg[0]), "dec_icrs_deg": float(at_deg[1])},
            "nudge": {
                "east_arcmin": draw.uniform(-20.0, 20.0),
                "north_arcmin": draw.uniform(-20.0, 20.0),
            },
            "track": {"is_on": draw.random() < 0.5},
            "set": {"name": "detector.tau", "value": round(draw.uniform(0.05, 0.5), 2)},
        }.get(verb, {})
        if verb == "another":
            self.mount.moved_by_another((float(at_deg[0]), float(at_deg[1])))
            return
        if verb == "stop":
            self.stopped_in.append(state)
        outcome = told(self.handler, verb, arguments)
        for thread in threading.enumerate():
            if thread.name == "stop under way":
                thread.join()
        self.mount._write("asked", verb, outcome.ok)

    def run(self) -> list[Any]:
        """The night; its orders, what was asked, and what went on record of it."""
        try:
            self.whole.engine.run()
        except RsoconsoleError as error:
            self.mount._write("ended", type(error).__name__)
        return [self.mount.lines, [*self._recorded()], sorted(set(self.stopped_in))]

    def _recorded(self) -> Iterator[Any]:
        for record in self.whole.memory.records:
            match record:
                case StateChange():
                    yield ["state", record.before, record.after, record.reason.kind]
                case OperatorAction():
                    yield ["action", record.verb, record.outcome.kind]
                case SlewCommand():
                    yield rounded(["slew", record.ra_icrs_deg, record.dec_icrs_deg])
                case Event():
                    yield ["event", record.level, record.topic]


def engine_night(seed: int) -> list[Any]:
    """One of a whole engine."""
    return EngineNight(seed).run()


# -- written down and compared ---------------------------------------------------------------------


def found() -> Iterator[tuple[str, Any]]:
    """Each night by its name."""
    for seed in SEEDS:
        yield f"odd mount {seed}", odd_night(seed)
    for seed in SEEDS:
        yield f"engine {seed}", engine_night(seed)


def kept() -> dict[str, Any]:
    """What was written down."""
    lines = KEPT.read_text(encoding="utf-8").splitlines()
    return dict(map(json.loads, lines))


def first_difference(one: Any, other: Any, at: str = "") -> str | None:
    """Where two nights part."""
    if isinstance(one, list) and isinstance(other, list):
        for n, (left, right) in enumerate(zip(one, other, strict=False)):
            if (where := first_difference(left, right, f"{at}/{n}")) is not None:
                return where
        return None if len(one) == len(other) else f"{at}: {len(one)} and {len(other)}"
    if isinstance(one, dict) and isinstance(other, dict):  # a figure may come, none may go
        parted = (first_difference(one[key], other.get(key), f"{at}/{key}") for key in one)
        return next((where for where in parted if where is not None), None)
    if isinstance(one, float) and isinstance(other, float):
        room = 2.0 * 10.0 ** (1 - DIGITS) * max(abs(one), abs(other))
        near = one == other or abs(one - other) <= room
        return None if near else f"{at}: {one} and {other}"
    return None if one == other else f"{at}: {one} and {other}"


def main() -> int:
    """Write it down, or compare."""
    logging.disable()
    nights = {name: json.loads(json.dumps(rounded(night))) for name, night in found()}
    if "--write" in sys.argv[1:]:
        lines = [json.dumps([name, night], separators=(",", ":")) for name, night in nights.items()]
        KEPT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    before = kept()
    parted = {n: first_difference(before[n], each) for n, each in nights.items()}
    for name, where in parted.items():
        if where is not None:
            print(f"{name}: {where}")
    stops = sorted({s for n, each in nights.items() if n.startswith("engine") for s in each[2]})
    print(f"{len(nights)} nights, {sum(map(bool, parted.values()))} differ; STOP in {stops}")
    return int(any(parted.values()))


if __name__ == "__main__":
    sys.exit(main())
