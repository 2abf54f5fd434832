"""One night of an engine to which a fault happens every few frames, and what became of it.

A whole engine among simulated instruments, small frames, a wire in between that can be spoilt. An
operator's notes and settings go on all the while; what was acknowledged is looked for afterwards.
What the engine orders of the mount is read from the wire and judged with limits of its own.
"""

import random
import subprocess
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from rsoconsole.base import ControlError, SessionError
from rsoconsole.control import ControlClient, Outcome, Sender, make_command
from rsoconsole.records import OperatorAction
from rsoconsole.session import SessionReader
from rsoconsole.simulator import start_observatory
from tests.campaign.fault_growth import Sample, pace_s
from tests.campaign.fault_wire import FaultyWire
from tests.rigs.stop_witness import Ear
from tests.rigs.whole_engine import CHILDREN, COMMAND, OVERRIDES, WholeEngine, wait_for

SPEED = 20.0
EXPOSURE = {"exposure_s": 2.0, "cadence_s": 4.0, "readout_s": 0.0}
NEAR = {
    "pattern": "targets",
    "frames_per_field": 1,
    "targets": [
        {"name": "east", "hour_angle_deg": -40.0, "declination_deg": -5.0},
        {"name": "west", "hour_angle_deg": -36.0, "declination_deg": -2.0},
    ],
}
VERB_S, RECOVERED_S, DELAYED_S = 10.0, 60.0, 2.5
"""A verb that takes longer hangs; so long after a fault frames may stay away; and so late a STOP is
answered where the mount obeys its second order only."""
MEASURED_S = 12.0
"""So long after a STOP it is waited for how the mount is measured to move."""
_SAMPLE_FRAMES = 3


@dataclass(slots=True)
class Row:
    """One fault and what was seen of it."""

    kind: str
    frame: int
    recovered_s: float = 0.0
    """Until frames came again."""
    armed_again: bool = False
    """Autonomy had let go of the mount, and was asked again."""
    slowest_verb_s: float = 0.0
    stop_ordered_ms: float | None = None
    stop_answered_ms: float | None = None
    """Until the answer that the mount has taken it; None: no STOP was given, or it did not say."""
    wrong: list[str] = field(default_factory=list)
    """What should not have happened, in words."""


class FaultNight:
    """An engine that runs, and the means to hurt it."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.random = folder, random.Random(f"faults {seed}")
        self.acknowledged: list[str] = []
        self.destroyed: set[str] = set()
        """Acknowledged facts on a log that a fault has destroyed with all it held."""
        self.said: list[str] = []
        """Everything that verbs printed."""
        self.samples: list[Sample] = []
        self.frames_of_earlier = 0
        self._stack = ExitStack()
        self._notes = self._of_this = self._life_from = 0

    def __enter__(self) -> Self:
        sky = self._stack.enter_context(
            start_observatory("intelsat-14", 1, SPEED, stage="tests.rigs.stub_stage:open_plain")
        )
        self.sky = sky
        self.wire = self._stack.enter_context(FaultyWire(sky.host, sky.port))
        self.ear = self._stack.enter_context(Ear(sky))
        self.engine = WholeEngine(
            self.folder,
            sky,
            indi={"port": self.wire.port, "simulated_latency_s": 0.0},
            exposure=EXPOSURE,
            search=NEAR,
            session={"keep_frames": "all"},
        )
        self._stack.callback(self.engine.close)
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start(self) -> None:
        """Start the engine, again if need be."""
        self._life_from = len(self.acknowledged)
        self.engine.start()

    @property
    def pid(self) -> int:
        """Of the engine."""
        assert self.engine.process is not None
        return self.engine.process.pid

    def frames(self) -> int:
        """Exposed so far, by the engine's own count."""
        self._of_this = int(self.ask("status").data.get("frame_id") or 0)
        return self.frames_of_earlier + self._of_this

    def destroy(self) -> None:
        """What the log of this engine's life held is gone with it."""
        self.destroyed |= set(self.acknowledged[self._life_from :])

    @property
    def note_frame(self) -> int:
        """The frames seen last."""
        return self.frames_of_earlier + self._of_this

    def is_living(self) -> bool:
        """Whether the engine's process is there."""
        return self.engine.process is not None and self.engine.process.poll() is None

    def restart(self) -> None:
        """After an engine that was killed or ended."""
        self.frames_of_earlier += self._of_this
        self._of_this = 0
        self.start()

    def ask(self, verb: str, **arguments: Any) -> Outcome:
        """A command by the socket; raises ControlError where no answer comes in time."""
        client = ControlClient(self.engine.socket, sender=Sender(name="test"))
        return client.send(make_command(verb, arguments), timeout_s=VERB_S)

    def note(self) -> None:
        """A remark and a setting for the record; kept where they are acknowledged."""
        self._notes += 1
        value = round(0.1 + self._notes * 1e-6, 6)
        for fact, verb, arguments in (
            (f"fact {self._notes}", "note", {"text": f"fact {self._notes}"}),
            (f"tau {value}", "set", {"name": "detector.tau", "value": value}),
        ):
            with suppress(ControlError):
                if self.ask(verb, **arguments).ok:
                    self.acknowledged.append(fact)

    def run(self, *words: str, timeout_s: float = 30.0) -> tuple[int | None, float]:
        """A verb from another terminal: its exit status (None: it hung) and how long it took."""
        begun_s = time.monotonic()
        try:
            done = subprocess.run(
                [*COMMAND, *words],
                env=self.engine.environment,
                capture_output=True,
                text=True,
                timeout=timeout_s,
                check=False,
                stdin=subprocess.DEVNULL,
            )
        except subprocess.TimeoutExpired:
            return None, time.monotonic() - begun_s
        self.said.append(done.stdout + done.stderr)
        return done.returncode, time.monotonic() - begun_s

    def family(self) -> list[int]:
        """The engine and its children."""
        children = [self.engine.child(kind) for kind in CHILDREN]
        return [self.pid, *(pid for pid in children if pid is not None)]

    def sample(self, frame: int, cycle_s: float) -> None:
        """Note what the engine and its children hold, and how fast they are."""
        mib, descriptors, threads = 0.0, 0, 0
        for pid in self.family():
            with suppress(OSError):
                rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
                kib = {line.split()[0]: int(line.split()[1]) for line in rollup}
                mib += (kib["Pss:"] - kib["Pss_File:"]) / 1024.0
                descriptors += len(list(Path(f"/proc/{pid}/fd").iterdir()))
                threads += len(list(Path(f"/proc/{pid}/task").iterdir()))
        self.samples.append(Sample(frame, mib, descriptors, threads, cycle_s, pace_s()))

    def stop(self, row: Row, *, is_delayed: bool = False) -> None:
        """STOP by the wire while the mount moves, measured: the worst of a row is kept.

        ``is_delayed``: the mount obeys late, so that it is asked only to answer at all.
        """
        with suppress(AssertionError):
            self.ear.slew()
        begun_s = time.monotonic()
        seen = len(self.wire.orders.aborts_s)
        outcome = self.ask("stop")
        answered_s = time.monotonic() - begun_s
        slews = len(self.wire.orders.slews)
        # The mount may stand before the wire has come to read the order.
        time.sleep(0.3)
        aborts = self.wire.orders.aborts_s[seen:]
        if aborts:
            ordered_ms = (aborts[0] - begun_s) * 1e3
            row.stop_ordered_ms = max(ordered_ms, row.stop_ordered_ms or 0.0)
        else:
            row.wrong.append("STOP ordered nothing")
        if outcome.data.get("is_answered") is not True:
            row.wrong.append(f"STOP not answered: {outcome.message}")
        elif not is_delayed:
            row.stop_answered_ms = max(answered_s * 1e3, row.stop_answered_ms or 0.0)
        elif answered_s > DELAYED_S:
            row.wrong.append(f"STOP answered after {answered_s:.1f} s")
        if len(self.wire.orders.slews) > slews:
            row.wrong.append("a slew after STOP was answered")

    def measure(self, row: Row) -> None:
        """What the last STOP has come to, as the engine measures it."""
        last: dict[str, Any] = {}
        ends_s = time.monotonic() + MEASURED_S
        while time.monotonic() < ends_s:
            last = self.ask("status").data.get("last_stop") or {}
            if last.get("motion") in ("stands", "tracks"):
                return
            time.sleep(0.1)
        row.wrong.append(f"after STOP the mount is measured: {last.get('motion')}")

    def recover(self, row: Row) -> None:
        """Wait for frames again, arming where the fault has cost autonomy the mount."""
        begun_s = time.monotonic()
        try:
            if not self.is_living():
                self.restart()
            goal = None

            def goes_on() -> bool:
                nonlocal goal
                status = self.ask("status").data
                if status.get("holder") != "autonomy":
                    row.armed_again = True
                    if status.get("is_parked"):  # one of the orders at random
                        self.ask("unpark")
                    self.ask("arm", override=[*OVERRIDES])
                    return False
                goal = self.frames() + 1 if goal is None else goal
                return self.frames() >= goal

            wait_for(goes_on, "a frame", RECOVERED_S)
        except AssertionError as error:
            row.wrong.append(f"frames do not come again: {str(error).splitlines()[0]}")
        row.recovered_s = time.monotonic() - begun_s

    def look(self, row: Row) -> None:
        """``status`` by the wire: it answers, or says why not, in time."""
        begun_s = time.monotonic()
        with suppress(ControlError):
            self.ask("status")
        row.slowest_verb_s = max(row.slowest_verb_s, time.monotonic() - begun_s)

    def kept(self) -> set[str]:
        """Every fact on record, in whatever session."""
        state = Path(self.engine.environment["XDG_STATE_HOME"])
        found: set[str] = set()
        for database in [*self.engine.root.rglob("session.db"), *state.rglob("session.db")]:
            with suppress(SessionError):
                records = SessionReader(database.parent).records(kinds=(OperatorAction,))
                for _, _, record in records:
                    if record.outcome.kind in ("accepted", "done"):
                        told = record.arguments
                        found.add(
                            f"tau {told['value']}" if "value" in told else str(told.get("text"))
                        )
        return found
