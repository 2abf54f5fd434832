"""Waiting for a command (--wait): the engine's status is polled until the command is done.

The mount's position and measured motion decide that it is done; the driver's own state counts only
where no motion could be measured. Seconds are those of the engine's clock, which runs faster in a
simulated night.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rsoconsole.base import ControlError, SessionError
from rsoconsole.cli.words.batch_options import stderr_progress_bars
from rsoconsole.config import Config, load_config
from rsoconsole.control import NOT_KNOWN, Outcome, Status, motion_words
from rsoconsole.sky import separation_deg

if TYPE_CHECKING:
    from rsoconsole.control import ControlClient

WaitOption = Annotated[
    bool, typer.Option("--wait", help="Return when the mount has done it, or is kept from it.")
]
LOOK_S = 1.0
GRACE_S = 60.0
"""Time beyond mount.slew_timeout_s after which the wait for a goal fails, s."""
BY_WORD_S = 10.0
"""Longest wait for a measured motion, s; after that the driver's own state counts."""
AT_REST_S = 12.0
"""Time at rest elsewhere, s, after which a mount is taken to go no further."""
REPEATED_S = 45.0
"""Time at rest after which a parking mount goes no further: parking is sent again every 30 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """Goal of a command: the state of the mount in which the command is done."""

    done: str
    """Word for the reached goal, e.g. "parked"."""
    is_there: Callable[[Status], bool]
    """True where a status has the goal's position or state; motion is checked separately."""
    ends: tuple[str, ...] = ("stands", "tracks")
    """Measured motions of the mount in which the goal counts as reached."""
    at_rest_s: float = AT_REST_S
    """Time at rest away from the goal after which the wait fails, s."""
    others: tuple[str, ...] = ("MANUAL",)
    """States of the engine that end the wait, since only a different command causes them."""


GOALS = {
    "park": Goal(
        done="parked",
        is_there=lambda status: bool(status.is_parked),
        ends=("stands",),
        at_rest_s=REPEATED_S,
    ),
    "unpark": Goal(done="released", is_there=lambda status: status.is_parked is False),
}


def arrival_goal(ra_icrs_deg: float, dec_icrs_deg: float, near_arcmin: float) -> Goal:
    """Return a slew's goal: the mount's own coordinates within ``near_arcmin`` of a direction."""

    def is_there(status: Status) -> bool:
        ra, dec = status.mount_ra_icrs_deg, status.mount_dec_icrs_deg
        if ra is None or dec is None or status.is_parked:
            return False
        return 60.0 * separation_deg(ra, dec, ra_icrs_deg, dec_icrs_deg) <= near_arcmin

    return Goal(done="arrived", is_there=is_there, others=())


def session_config(session: Path | None) -> Config:
    """Return the configuration recorded in a session; the user's own where it cannot be read."""
    from rsoconsole.session import SessionReader

    if session is not None:
        try:
            return SessionReader(session).config()
        except SessionError:
            pass
    return load_config()


class GoalWait:
    """Polls the engine's status once a second until a goal is reached or cannot be reached."""

    def __init__(self, wire: "ControlClient") -> None:
        """Read the status; make the follower before the command is sent.

        A state that the engine had before the command does not end the wait.
        """
        self._wire = wire
        self._before = self._last = self._look()
        self._case: Case = "on its way"
        self._case_since_s = 0.0

    def wait_for(self, goal: Goal) -> str:
        """Wait for the goal; return in words how it was reached. Raises ControlError on failure."""
        sent = self._last = self._look()
        bound_s = session_config(sent.session).mount.slew_timeout_s + GRACE_S
        began_s = time.monotonic()
        with _shown() as show:
            while True:
                time.sleep(LOOK_S)
                status = self._look()
                self._expect_no_other(status, goal)
                waited_s = _engine_s(status) - _engine_s(sent)
                # What was reported before the order has been taken tells nothing of it.
                if (status.mount_t_utc_ns or 0) > (sent.now_utc_ns or 0):
                    words = self._ended(status, goal)
                    if words:
                        return words
                    show(f"{motion_words(status)}, {waited_s:.0f} s")
                if max(waited_s, time.monotonic() - began_s) > bound_s:
                    raise ControlError(f"not {goal.done} in {bound_s:.0f} s: {_how(status)}")

    def wait_for_outcome(self, goal: Goal) -> Outcome:
        """Wait for the goal; return success or failure as an ``Outcome``."""
        try:
            return Outcome(ok=True, message=self.wait_for(goal))
        except ControlError as error:
            return Outcome(ok=False, message=str(error))

    def _ended(self, status: Status, goal: Goal) -> str:
        """Words on the reached goal; empty: not yet. Raises ControlError where it failed."""
        case, now_s = _case_of(status, goal), _engine_s(status)
        if case != self._case:
            self._case, self._case_since_s = case, now_s
        lasts_s = now_s - self._case_since_s
        if case == "done":
            return f"{goal.done}: it {status.mount_motion}, measured"
        if case == "not measured" and lasts_s > BY_WORD_S:
            return f"{goal.done}, by its driver's word: {NOT_KNOWN}"
        if case in ("moves there", "elsewhere") and lasts_s > goal.at_rest_s:
            raise ControlError(f"not {goal.done}: {_how(status)}")
        return ""

    def _look(self) -> Status:
        from rsoconsole.control import ask_status

        return ask_status(self._wire)

    def _expect_no_other(self, status: Status, goal: Goal) -> None:
        """Raises ControlError where something else has the mount now."""
        last, self._last = self._last, status
        stop, before = status.last_stop, self._before.last_stop
        is_new = status.state != last.state
        if stop is not None and (before is None or stop.t_utc_ns != before.t_utc_ns):
            raise ControlError(f"not {goal.done}: STOP by {stop.by}; {_how(status)}")
        if status.pid != self._before.pid:
            raise ControlError(f"not {goal.done}: another engine runs now; {_how(status)}")
        if is_new and status.state == "FAULT":
            why = "; ".join(status.faults)
            raise ControlError(f"not {goal.done}: FAULT {why}".rstrip())
        is_taken = status.holder == "autonomy" != last.holder
        if is_taken or (is_new and status.state in goal.others):
            raise ControlError(
                f"not {goal.done}: another order came ({status.state}); {_how(status)}"
            )


Case = Literal["done", "not measured", "moves there", "elsewhere", "on its way"]


def _case_of(status: Status, goal: Goal) -> Case:
    """State of the mount relative to a goal."""
    motion, claims_motion = status.mount_motion, status.is_slewing or status.is_parking
    is_known = motion not in (None, "unknown")
    if goal.is_there(status):
        if motion in goal.ends:
            return "done"
        if is_known:
            return "moves there"
        return "on its way" if claims_motion else "not measured"
    is_at_rest = motion != "moves" if is_known else not claims_motion
    return "elsewhere" if is_at_rest else "on its way"


def _engine_s(status: Status) -> float:
    return (status.now_utc_ns or 0) / 1e9


def _how(status: Status) -> str:
    """Place and motion of the mount, in words."""
    place, words = "", motion_words(status)
    if status.mount_alt_deg is not None and status.mount_az_deg is not None:
        place = f" at alt {status.mount_alt_deg:.1f} az {status.mount_az_deg:.1f}"
    return f"the mount{place}: {words}"


@contextlib.contextmanager
def _shown() -> Iterator[Callable[[str], None]]:
    """Line on the mount's motion meanwhile, on a terminal's stderr; nothing elsewhere."""
    from rich.progress import SpinnerColumn, TextColumn

    with stderr_progress_bars(SpinnerColumn(), TextColumn("{task.description}")) as line:
        task = line.add_task("waits for the mount", total=None)
        yield lambda words: line.update(task, description=words)
