"""Each key of the seat by its effect in the engine: console, command handler, loop: one process."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from rsoconsole.config import Config
from rsoconsole.console.actions.second_press import REPEAT_S
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.commands.commands import COMMANDS
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.control import Command, Outcome, PendingOutcome, Request, Sender
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.records import OperatorAction, Ruling
from rsoconsole.session import SessionWriter
from rsoconsole.sky import separation_deg
from tests.pipeline.test_rulings import night
from tests.rigs.engine_rig import Memory, Rig, heed_alarms
from tests.rigs.seat_rig import can_answer, opened, until

FRAMES = 5
SIZE = (120, 40)


class Kept(Memory):
    """Remembers, and writes a session as the engine does."""

    writer: SessionWriter

    def append(self, record: Any, t_utc_ns: int) -> int:
        super().append(record, t_utc_ns)
        return self.writer.append(record, t_utc_ns)

    def save_preview(self, frame_id: int, picture: Any, stars: Any = None) -> bool:
        return self.writer.save_preview(frame_id, picture, stars)

    def save_closeup(self, frame_id: int, picture: Any) -> bool:
        return self.writer.save_closeup(frame_id, picture)


class DeskWire:
    """The wire without a socket; what is asked for is granted at once, as between two frames."""

    def __init__(self, r: Rig, folder: Path) -> None:
        self.command_handler = CommandHandler(r.engine, r.queue, folder, mount_word_s=0.0)
        self._rig = r

    def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
        verb = command.verb
        outcome = self.command_handler.begin(Request(command=command, sender=Sender.console("a@b")))
        if verb == "stop":
            heed_alarms(self._rig)
        elif verb not in {"status", "preview"}:
            self._rig.engine.commands.execute_waiting()
            self._rig.engine._parking.see_to_it()
        return outcome.outcome() if isinstance(outcome, PendingOutcome) else outcome


def decisions(r: Rig) -> list[Ruling]:
    return r.memory.of(Ruling)


def done(r: Rig) -> list[str]:
    """Verbs that have come to something."""
    return [
        action.verb for action in r.memory.of(OperatorAction) if action.outcome.kind != "accepted"
    ]


def is_done(r: Rig, verb: str) -> bool:
    return verb in done(r)


def by_hand(r: Rig, least_deg: float) -> bool:
    """Whether the operator has sent the mount on its way, so far at least."""
    *_, before, last = r.mount.slews
    is_far = separation_deg(*before, *last) >= least_deg
    return r.engine.authority.state == "MANUAL" and before != last and is_far


def setting(r: Rig, name: str) -> Any:
    section, _, key = name.partition(".")
    return getattr(getattr(r.engine.config, section), key)


EFFECTS: dict[str, tuple[list[str], Callable[[Rig], bool]]] = {
    "stop": (["ctrl+x"], lambda r: r.engine.authority.state == "IDLE" and r.mount.aborts > 0),
    "stop_by_letter": (["x"], lambda r: r.engine.authority.state == "IDLE" and r.mount.aborts > 0),
    "arm_or_disarm": (["twice:a"], lambda r: r.engine.authority.holder == "nobody"),
    "hold_or_resume": (["h"], lambda r: r.engine.authority.is_held),
    "wait_for_sky": (["w"], lambda r: r.engine.authority.resumes_when_clear),
    "goto": (
        ["g", "text:alt 50 az 175", "told", "enter"],
        lambda r: r.engine.authority.state == "MANUAL",
    ),
    "nudge_up": (["twice:up"], lambda r: r.engine.authority.state == "MANUAL"),
    "nudge_down": (["twice:down"], lambda r: r.engine.authority.state == "MANUAL"),
    "nudge_left": (["twice:left"], lambda r: r.engine.authority.state == "MANUAL"),
    "nudge_right": (["twice:right"], lambda r: r.engine.authority.state == "MANUAL"),
    "centre": (["c", "told", "enter"], lambda r: r.engine.authority.state == "MANUAL"),
    "aim": (["i", "text:20", "told", "enter"], lambda r: setting(r, "aim.lead_s") == 20.0),
    "exposure": (["e", "text:5", "enter"], lambda r: setting(r, "exposure.exposure_s") == 5.0),
    "abort_exposure": (["b"], lambda r: is_done(r, "abort")),
    "park": (["p", "asked", "y"], lambda r: r.mount.is_parked),
    "unpark": (
        ["p", "asked", "y", "done:park", "ctrl+u"],
        lambda r: not r.mount.is_parked and is_done(r, "unpark"),
    ),
    "track_or_stand": (["twice:a", "done:disarm", "k"], lambda r: not r.mount.is_tracking),
    "undo": (
        ["twice:a", "done:disarm", "u"],
        lambda r: is_done(r, "resume") and r.engine.authority.state == "COAST",
    ),
    "follow_next": (["twice:d"], lambda r: decisions(r)[-1].taken is not None),
    "accept": (["y"], lambda r: decisions(r)[-1].taken.source == "operator"),
    "reject": (["j", "asked", "1"], lambda r: len(decisions(r)[-1].refused) == 1),
    "mark": (
        ["m", "enter", *["right"] * 6, "enter"],
        lambda r: decisions(r)[-1].taken is not None,
    ),
    "take_back": (
        ["y", "ruled", "backspace"],
        lambda r: decisions(r)[-1].taken is None and not decisions(r)[-1].refused,
    ),
    "seek": (["twice:s"], lambda r: r.engine.planner._search.is_spiral),
    "tune": (["t", "right", "enter"], lambda r: setting(r, "detector.tau") == 0.125),
    "note": (["n", "text:clouds", "enter"], lambda r: is_done(r, "note")),
}


@pytest.mark.parametrize("command", EFFECTS)
def test_a_key_does_in_the_engine_what_it_says(tmp_path: Path, impatient_seat: None, command: str):
    acting = {each.name for each in COMMANDS if each.acts or each.priority}
    assert acting - {"give_seat", "keep_seat"} <= set(EFFECTS)
    r = night(set(range(1, FRAMES + 1)))
    folder = tmp_path / "night"
    writer = SessionWriter.create(folder, Config(), {"title": "effects"})
    for record in r.memory.records:
        writer.append(record, r.clock.t_utc_ns)
    r.memory.__class__ = Kept
    r.memory.writer = writer  # type: ignore[attr-defined]
    r.engine.run(frames=FRAMES)
    assert writer.flush()
    wire = DeskWire(r, folder)
    app = ConsoleApp(lambda: wire, seat_name="a@b")  # type: ignore[arg-type, return-value]
    keys, has_effect = EFFECTS[command]

    async def scene(pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "autonomy")
        await until(pilot, lambda: app.live.picture is not None)
        await until(pilot, lambda: app.live.picture.frame_id == FRAMES)
        # A mark begins in the close-up, which comes a little later.
        await until(pilot, lambda: app.live.picture.closeup is not None or command != "mark")
        assert not has_effect_yet(has_effect, r)
        for key in keys:
            await press(app, pilot, r, key)
        await until(pilot, lambda: has_effect_yet(has_effect, r))

    async def run() -> None:
        async with opened(app, SIZE) as pilot:
            await scene(pilot)

    asyncio.run(run())
    writer.close()


def has_effect_yet(has_effect: Callable[[Rig], bool], r: Rig) -> bool:
    try:
        return has_effect(r)
    except (IndexError, AttributeError):
        return False


async def press(app: ConsoleApp, pilot: Pilot[str], r: Rig, key: str) -> None:
    """A key, or ``twice:`` the same; ``text:`` into the field that has the focus.

    ``told``, ``asked``, ``ruled`` and ``done:`` wait.
    """
    if key.startswith("text:"):
        await until(pilot, lambda: isinstance(app.focused, Input))
        assert isinstance(app.focused, Input)
        app.focused.value = key.removeprefix("text:")
    elif key == "ruled":
        await until(pilot, lambda: bool(decisions(r)))
    elif key == "asked":
        await until(pilot, lambda: app.screen is not app.live)
        if isinstance(app.screen, Dialog):
            await can_answer(app, pilot)
    elif key == "told":
        await until(
            pilot, lambda: any("way" in str(w.render()) for w in app.screen.query("Static"))
        )
        await can_answer(app, pilot)
    elif key.startswith("done:"):
        await until(pilot, lambda: key.removeprefix("done:") in done(r))
        await until(pilot, lambda: app.screen is app.live and app.live.engine.holder == "nobody")
    elif key.startswith("twice:"):
        await pilot.press(key.removeprefix("twice:"))
        await pilot.pause(2 * REPEAT_S)
        await pilot.press(key.removeprefix("twice:"))
    else:
        await pilot.press(key)
        await pilot.pause(0.05)
