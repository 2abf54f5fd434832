"""Random nights of one odd mount, in process and in a clock of the test's own.

The product's part of it is the mount's process (its orders, its measurement, its watch) and the
engine's watch over the limits; the border is the client library, whose place this takes. The judge
is the mount's own motion.
"""

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import Ordered
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import (
    SIDEREAL_ARCSEC_S,
    Instruments,
    MountAbilities,
    MountReport,
    StopResult,
)
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.motion import Motion
from rsoconsole.instruments.mount._mount_owner import MountOwner
from rsoconsole.instruments.mount.mount_child import MountChild
from rsoconsole.records import Event
from rsoconsole.sky import Pose, jnow_to_icrs
from tests.makers import T0_UTC_NS
from tests.rigs.odd_engine import SITE
from tests.rigs.odd_mount import ABORT, COORDINATES, DEVICE, PARK, Oddities, OddMount

NS = 1_000_000_000
STEP_S = 0.1
WATCH_EVERY_S, LIMITS_EVERY_S, ASK_EVERY_S, JUDGE_EVERY_S = 0.2, 1.0, 0.1, 0.2
PARK_ROOM_DEG = 5.0
FINE_ARCSEC_S = 10.0
"""A motion that reports of fine steps show."""
CONFIG = Config.model_validate({"site": SITE, "limits": {"past_meridian_deg": 90}})


class _Voice:
    """What the mount's process tells its parent."""

    def __init__(self) -> None:
        self.said: list[Mapping[str, Any]] = []

    def send(self, message: Mapping[str, Any]) -> None:
        """One line."""
        if message.get("event") != "report":
            self.said.append(message)


class _Client(IndiClient):
    """The client library's place: the mount's vectors at once, and time passes while it waits."""

    def __init__(self, night: "OddNight", on_vector: Callable[[Vector], None]) -> None:
        super().__init__(DEVICE, on_vector)
        self._night, self._time_ns = night, night.utc_ns

    def wait(
        self, name: str, is_wanted: Callable[[Vector], bool], timeout_s: float, after: int = -1
    ) -> Vector | None:
        """As of every client."""
        ends_s = self._night.now_s + timeout_s
        while True:
            vector = self._vectors.get(name)
            if vector is not None and vector.serial > after and is_wanted(vector):
                return vector
            if self._night.now_s >= ends_s:
                return None
            self._night.pass_step()

    def driver_message_since(self, after: int, wait_s: float = 0.0) -> str:
        """Without waiting in the wall's time."""
        return super().driver_message_since(after)

    def take(self, element: ET.Element) -> None:
        """What the driver says."""
        if element.tag == "message":
            self._note_message(element.get("message", ""))
            return
        if element.tag == "delProperty" or not element.tag.endswith("Vector"):
            return
        name, is_definition = element.get("name", ""), element.tag.startswith("def")
        if is_definition and name in self._vectors:
            return
        kind = element.tag[3:].removesuffix("Vector")
        texts = {each.get("name", ""): (each.text or "").strip() for each in element}
        values: dict[str, Any] = dict(texts)
        if kind == "Number":
            values = {key: float(text) for key, text in texts.items()}
        elif kind == "Switch":
            values = {key: text == "On" for key, text in texts.items()}
        self._store(
            Vector(
                name=name,
                state=element.get("state", ""),
                values=values,
                serial=self._next_serial(),
                is_definition=is_definition,
                arrived_monotonic_s=self._night.now_s,
            )
        )

    def _connect(self, host: str, port: int) -> bool:
        return True

    def _connect_device(self) -> None:
        self._send_switch("CONNECTION", "CONNECT")

    def _send_numbers(self, name: str, values: Mapping[str, float]) -> None:
        self._send("Number", name, {key: repr(value) for key, value in values.items()})

    def _send_switch(self, name: str, member: str) -> None:
        self._send("Switch", name, {member: "On"})

    def _send(self, kind: str, name: str, values: Mapping[str, str]) -> None:
        vector = ET.Element(f"new{kind}Vector", device=DEVICE, name=name)
        for member, value in values.items():
            ET.SubElement(vector, f"one{kind}", name=member).text = value
        self._night.model.receive(vector)
        self._night.deliver()

    def enable_blobs(self, name: str) -> None:
        """None come."""

    def _let_go(self, content: memoryview) -> None:
        """Nobody else holds it."""


class _Clock:
    """The night's."""

    is_simulated, speed, is_steady = False, 1.0, True

    def __init__(self, night: "OddNight") -> None:
        self._night = night

    def now_utc_ns(self) -> int:
        return self._night.utc_ns()


class _Mount:
    """The mount's port for the engine's watch, straight to the mount's process."""

    def __init__(self, night: "OddNight") -> None:
        self._night = night

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        table = self._night.order("report")["report"]
        return MountReport(**{**table, "motion": Motion(**table["motion"])})

    def abort(self, timeout_s: float = 2.0, *, on_news: Any = None) -> StopResult:
        answer = self._night.order("abort")
        return StopResult(
            is_answered=answer["is_answered"], ms=0.0, path="mount", detail=answer["detail"]
        )

    def set_tracking(self, is_on: bool) -> None:
        self._night.order("set_tracking", is_on=is_on)

    def park(self) -> None:
        self._night.order("park")

    def abilities(self) -> MountAbilities:
        return MountAbilities(**self._night.order("abilities")["abilities"])

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        self._night.order("keep", lease_s=lease_s, track_until_utc_ns=None)


@dataclass
class Verdict:
    """What was found wrong; empty: nothing."""

    faults: list[str] = field(default_factory=list)
    stops: int = 0
    rests_claimed: int = 0
    rests_told: int = 0
    """By STOPs."""
    limits_met: int = 0
    lowest_deg: float = 90.0


class OddNight:
    """One mount, one seed."""

    def __init__(self, seed: int, oddities: Oddities | None = None) -> None:
        self._draw = random.Random(seed)
        self.oddities = oddities or drawn_oddities(self._draw)
        self.now_s = 1000.0
        self._spoken: list[str] = []
        self.model = OddMount(
            self.oddities,
            monotonic_s=lambda: self.now_s,
            utc_ns=self.utc_ns,
            emit=self._spoken.append,
        )
        self.voice, self.verdict = _Voice(), Verdict()
        child: Any = MountChild
        self.child: MountChild = child(
            self.voice, monotonic_s=lambda: self.now_s, time_ns=self.utc_ns
        )
        self._client = _Client(self, self.child._on_vector)
        self._later: list[tuple[float, Callable[[], None]]] = []
        self._due_s = {
            "judge": self.now_s,
            "watch": self.now_s,
            "limits": self.now_s + 2.0,
            "ask": self.now_s,
        }
        self._in_limits = self._is_judging = False
        self._fast_since_s: float | None = None
        self._rest_since_s, self._rest_altitude_deg = self.now_s, 90.0
        self._heard = 0
        self._was_deaf = False
        self._connect()
        instruments = Instruments(
            clock=_Clock(self),  # type: ignore[arg-type]
            mount=_Mount(self),  # type: ignore[arg-type]
            camera=None,  # type: ignore[arg-type]
            host="",
            port=0,
            mount_name="",
            camera_name="",
        )
        self.events: list[Event] = []
        self.queue = CommandQueue()
        self._ordered: Ordered | None = None
        self.watch = Watch(
            instruments, CONFIG, self.queue, self.events.append, lambda: self._ordered
        )
        self._is_judging = True

    def utc_ns(self) -> int:
        """The night's instant."""
        return T0_UTC_NS + round((self.now_s - 1000.0) * NS)

    def _connect(self) -> None:
        self.model.receive(ET.Element("getProperties", version="1.7", device=DEVICE))
        self._client._connect_device()
        self.deliver()
        settings = {"simulated": False, "after_stop": "track", "answer_s": 15.0, "lease_s": 600.0}
        self.mount_watch = self.child.attach(self._client, settings, _NoOwner())

    # -- time -----------------------------------------------------------------------------------

    def pass_s(self, seconds: float) -> None:
        """Let time pass."""
        ends_s = self.now_s + seconds
        while self.now_s < ends_s:
            self.pass_step()

    def pass_step(self) -> None:
        """A step of it: the mount moves, its driver speaks, and who watches looks."""
        self.now_s += STEP_S
        self.model.advance()
        self.deliver()
        # What is done may itself let time pass.
        due = [each for each in self._later if each[0] <= self.now_s]
        self._later = [each for each in self._later if each not in due]
        for _, act in due:
            act()
        if self._is_due("ask", ASK_EVERY_S) and self.child._motion.wants_word():
            question = ET.Element("getProperties", version="1.7", device=DEVICE, name=COORDINATES)
            self.model.receive(question)
            self.deliver()
        if self._is_due("watch", WATCH_EVERY_S) and self._is_judging:
            self.mount_watch.watch()
        if self._is_judging and not self._in_limits and self._is_due("limits", LIMITS_EVERY_S):
            self._in_limits = True
            try:
                self.watch.look()
                self.queue.take_alarms()
            finally:
                self._in_limits = False
        if self._is_judging and self._is_due("judge", JUDGE_EVERY_S):
            self._judge()

    def _is_due(self, what: str, every_s: float) -> bool:
        if self.now_s < self._due_s[what]:
            return False
        self._due_s[what] = self.now_s + every_s
        return True

    def deliver(self) -> None:
        """What the driver has said, to the client, and its answers to the ear."""
        while self._spoken:
            text = self._spoken.pop(0)
            if "\udc80" <= max(text, default="") <= "\udcff":
                continue
            element = ET.fromstring(text)
            self._client.take(element)
            name = element.get("name", "")
            if element.tag.startswith("def") and name in (COORDINATES, "POLLING_PERIOD"):
                values = {each.get("name", ""): (each.text or "").strip() for each in element}
                self.child._motion.take(
                    IndiVector(
                        device=DEVICE,
                        name=name,
                        kind="Number",
                        is_definition=True,
                        state=element.get("state", ""),
                        timestamp="",
                        values=values,
                    )
                )

    def later(self, seconds: float, act: Callable[[], None]) -> None:
        """Have something done while others wait."""
        self._later.append((self.now_s + seconds, act))

    def abilities(self) -> MountAbilities:
        """What the mount's process says that its driver offers."""
        return self.watch._instruments.mount.abilities()

    def report(self) -> MountReport:
        """What it says of the mount now."""
        return self.watch._instruments.mount.report()

    # -- orders ---------------------------------------------------------------------------------

    def order(self, verb: str, **arguments: Any) -> dict[str, Any]:
        """Of the parent; a refusal is no fault. Empty: refused."""
        order = {"verb": verb, "id": 0, **arguments}
        self.child.on_order(order)
        found: dict[str, Any] = getattr(self.child, verb)(order)
        return found

    def try_order(self, verb: str, **arguments: Any) -> None:
        """The same of somebody who takes no for an answer."""
        try:
            self.order(verb, **arguments)
        except InstrumentError:
            return

    def goto(self) -> None:
        """By hand, within the limits."""
        ha_deg, dec_deg = self._draw.uniform(-60.0, 60.0), self._draw.uniform(0.0, 60.0)
        ra_deg = (self.model.ra_deg + self.model.ha_deg - ha_deg) % 360.0
        ra_icrs, dec_icrs = jnow_to_icrs(ra_deg, dec_deg, self.utc_ns())
        try:
            report = self.watch._instruments.mount.report()
        except InstrumentError:
            return
        start = Pose(
            t_utc_ns=report.t_utc_ns,
            ra_icrs_deg=report.ra_icrs_deg,
            dec_icrs_deg=report.dec_icrs_deg,
            pier_side=report.pier_side,
        )
        refused = self.watch.limits.refuse_slew(
            start,
            float(ra_icrs),
            float(dec_icrs),
            t_aim_utc_ns=self.utc_ns(),
            t_until_utc_ns=self.utc_ns(),
            lifted=("twilight",),
        )
        if refused is not None:
            return
        to = float(ra_icrs), float(dec_icrs)
        self._ordered = Ordered(t_utc_ns=self.utc_ns(), to_icrs_deg=to)
        self.try_order("slew", ra_icrs_deg=to[0], dec_icrs_deg=to[1], now_utc_ns=self.utc_ns())

    def stop(self) -> None:
        """STOP; its first ABORT is looked for."""
        self.verdict.stops += 1
        begun_s = self.now_s
        self.try_order("abort")
        if self.oddities.noabort:
            return
        sent = [at_s for at_s, name, _ in self.model.received if name == ABORT and at_s >= begun_s]
        if not sent or sent[0] - begun_s > 0.2:
            self.verdict.faults.append(f"STOP at {begun_s:.1f}: ABORT left at {sent[:1]}")

    def foreign(self, *, is_low: bool) -> None:
        """Another client's go-to."""
        ha_deg = self._draw.uniform(-100.0, 100.0) if is_low else self._draw.uniform(-50.0, 50.0)
        dec_deg = self._draw.uniform(-80.0, -30.0) if is_low else self._draw.uniform(0.0, 60.0)
        ra_deg = (self.model.ra_deg + self.model.ha_deg - ha_deg) % 360.0
        self.model.go_to(ra_deg, dec_deg)
        self.deliver()
        if is_low:
            self.pass_s(self._draw.uniform(5.0, 40.0))

    # -- the judge ------------------------------------------------------------------------------

    def _judge(self) -> None:
        rates = self.model.ra_rate_arcsec_s, self.model.dec_rate_arcsec_s
        stands = max(abs(rates[0] - SIDEREAL_ARCSEC_S), abs(rates[1])) <= shown_arcsec_s(
            self.oddities
        )
        tracks = max(abs(rates[0]), abs(rates[1])) <= shown_arcsec_s(self.oddities)
        altitude_deg = self.model.altitude_deg
        if stands or tracks:
            self._rest_since_s, self._rest_altitude_deg = self.now_s, altitude_deg
        # What begins beside the limit is over it before anybody has looked.
        unseen_deg = max(0.0, unseen_way_deg(self.oddities) - max(self._rest_altitude_deg, 0.0))
        self.verdict.lowest_deg = min(self.verdict.lowest_deg, altitude_deg + unseen_deg)
        self._judge_stops()
        motion = self.child._mirror.motion if self.child._mirror is not None else Motion()
        if motion.is_at_rest:
            self.verdict.rests_claimed += 1
            moved_s = self.now_s - self._rest_since_s
            if moved_s > known_within_s(self.oddities):
                self._fault(f"said that it {motion.kind} while it moves since {moved_s:.1f} s")

    def _judge_stops(self) -> None:
        """Each new word of a STOP against what the mount did then."""
        while self._heard < len(self.voice.said):
            said = self.voice.said[self._heard]
            self._heard += 1
            if said.get("event") != "stop measured" or said["motion"] is None:
                continue
            kind = said["motion"]["kind"]
            moved_s = self.now_s - self._rest_since_s
            if kind in ("stands", "tracks"):
                self.verdict.rests_told += 1
                if moved_s > known_within_s(self.oddities):
                    self._fault(f"STOP: told to {kind[:-1]}, and moves since {moved_s:.1f} s")

    def _fault(self, words: str) -> None:
        self.verdict.faults.append(f"at {self.now_s - 1000.0:.1f} s: {words}")

    def act(self) -> None:
        """One thing that somebody does, or that happens."""
        kinds: list[tuple[float, Callable[[], None]]] = [
            (4.0, self.goto),
            (3.0, self.stop),
            (1.0, lambda: self.try_order("park")),
            (1.0, lambda: self.try_order("unpark")),
            (1.0, lambda: self.try_order("set_tracking", is_on=self._draw.random() < 0.5)),
            (1.5, lambda: self.foreign(is_low=False)),
            (1.5, lambda: self.foreign(is_low=True)),
            (0.7, self._go_deaf),
            (1.0, lambda: self.later(self._draw.uniform(0.0, 1.0), self.stop) or self.goto()),
        ]
        weights, acts = zip(*kinds, strict=True)
        self._draw.choices(acts, weights)[0]()

    def _go_deaf(self) -> None:
        self.model.deaf = self._was_deaf = True

        def hear() -> None:
            self.model.deaf = False

        self.later(self._draw.uniform(1.0, 12.0), hear)

    def run(self, acts: int = 12) -> Verdict:
        """A number of things with random pauses; then quiet."""
        for _ in range(acts):
            self.act()
            self.pass_s(self._draw.choice((0.3, 1.0, 3.0, 8.0, 15.0)))
        self.model.deaf = False
        self.pass_s(20.0)
        self._judge_limits()
        return self.verdict

    def _judge_limits(self) -> None:
        """A mount that obeys goes no farther below the horizon than it needs to stop."""
        if disobeys(self.oddities) or self._was_deaf:
            return
        way_deg = way_to_stop_deg(self.oddities) + park_room_deg(self.model)
        if self.verdict.lowest_deg < -way_deg - 0.1:
            self._fault(
                f"{-self.verdict.lowest_deg:.1f} deg below the horizon, stops in {way_deg:.1f}"
            )


def way_to_stop_deg(odd: Oddities) -> float:
    """How far a mount at full speed goes on."""
    return math.sqrt(2.0) * odd.speed_deg_s**2 / (2.0 * odd.acceleration_deg_s2)


def unseen_way_deg(odd: Oddities) -> float:
    """How far it goes before it is looked at."""
    look_s = LIMITS_EVERY_S + known_within_s(odd)
    return math.sqrt(2.0) * odd.speed_deg_s * look_s


def park_room_deg(model: OddMount) -> float:
    """The way to a park position is its owner's affair down to a little below the horizon, where it
    is looked at once a second."""
    has_parked = any(name == PARK for _, name, _ in model.received)
    return PARK_ROOM_DEG + unseen_way_deg(model.oddities) if has_parked else 0.0


def disobeys(odd: Oddities) -> bool:
    """Whether ABORT does not end its motion."""
    is_deaf = odd.lieabort or odd.abortalert or odd.abortignored or odd.noabort
    return bool(is_deaf or odd.aborts_ignored)


def shown_arcsec_s(odd: Oddities) -> float:
    """A motion that its reports show within the time in which rest is named."""
    return max(FINE_ARCSEC_S, 2.0 * odd.step_arcsec / 5.0)


def known_within_s(odd: Oddities) -> float:
    """How old what is known of the mount may be."""
    return 2.0 * (odd.slowreport or odd.period_s) + 1.2


class _NoOwner(MountOwner):
    """Nobody else claims this mount."""

    def __init__(self) -> None:
        super().__init__("", 0, "", Path())

    def claim(self) -> None:
        """No file."""


def drawn_oddities(draw: random.Random) -> Oddities:
    """Far beyond what was met: of each kind, in any company."""
    faults = (
        "busyforever nopark notrackstate noabort abortalert abortignored noside nogeo notime "
        "trackwhileparked parkok_instant noidle lieabort parklies parkfails startparked "
        "getproperties_fresh nopollingperiod abort_ends_tracking"
    )
    chosen: dict[str, Any] = {name: True for name in faults.split() if draw.random() < 0.08}
    return Oddities(
        **chosen,
        period_s=draw.choice((0.2, 0.5, 1.0, 1.0, 2.0)),
        threshold_arcsec=draw.choice((None, 0.1, 1.5, 1.5)),
        step_arcsec=draw.choice((0.0, 0.0, 0.0, 1.5, 15.0, 90.0)),
        speed_deg_s=draw.choice((1.0, 3.0, 4.0, 8.0)),
        acceleration_deg_s2=draw.choice((1.0, 2.0, 4.0, 20.0)),
        aborts_ignored=draw.choice((0, 0, 0, 1, 3)),
        start_delay_s=draw.choice((0.0, 0.0, 0.5, 2.0)),
        ha_deg=draw.uniform(-60.0, 60.0),
        dec_deg=draw.uniform(10.0, 80.0),
    )
