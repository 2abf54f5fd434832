"""The seat in a test: an engine that says what it is told, a made-up night, a pilot."""

import asyncio
import atexit
import math
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from textual._compositor import Compositor
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet
from textual.pilot import Pilot

from rsoconsole.base import ControlError
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.panes.panes import NOT_DRAWN, LinesPane, StopBanner
from rsoconsole.console.tuning import what_if_watch
from rsoconsole.control import BeginMark, Command, Outcome
from rsoconsole.pipeline import WhatIfProcess, WhatIfQuestion
from rsoconsole.session import SessionWriter
from tests.makers import NS
from tests.nights import made_up_night as night

FRAMES = 20
PATIENCE_S = 90.0
FULL = (80, 24)
ANSWERED = {"is_answered": True, "number": 1, "path": "mount", "ms": 12.0}
"""The mount's driver has taken ABORT; how the mount moves is being measured."""
STOPPED = ANSWERED | {"motion": "tracks"}
PREVIEW = {
    "ra_icrs_deg": 83.05,
    "dec_icrs_deg": -4.87,
    "ra_date_deg": 83.33,
    "dec_date_deg": -4.86,
    "alt_deg": 47.2,
    "az_deg": 201.3,
    "way_deg": 12.4,
    "slew_s": 9.0,
    "pier_side": "west",
    "pier_side_after": "east",
    "margins_deg": [["altitude", 32.0]],
    "refused": None,
}
"""Of a go-to that nothing speaks against."""

Play = Callable[[ConsoleApp, Pilot[str]], Awaitable[None]]


class FakeWire:
    """An engine that says what a test wants and remembers what it was told."""

    def __init__(self, session: Path) -> None:
        self.sent: list[tuple[str, dict[str, Any]]] = []
        self.begun: list[tuple[int | None, bool]] = []
        """Marks that were begun, or left off: (frame, whether begun)."""
        self.outcomes: dict[str, Outcome] = {"stop": Outcome(ok=True, data=STOPPED)}
        self.is_gone = False
        self.hangs: dict[str, threading.Event] = {}
        self.status: dict[str, Any] = {
            "state": "TRACK",
            "holder": "autonomy",
            "frame": FRAMES,
            "ra": 150.0,
            "dec": -5.0,
            "alt": 41.2,
            "az": 171.0,
            "now_utc_ns": night.t_of(FRAMES) + 7 * NS,
            "session": str(session),
            "target": None,
            "faults": [],
            "lifted": [],
            "next_limit": "pier",
            "next_limit_utc_ns": night.t_of(FRAMES) + (7 + 52 * 60) * NS,
            "exposing_until_utc_ns": night.t_of(FRAMES) + 9 * NS,
            "health": [
                {"name": "mount", "ok": True, "text": "tracking"},
                {"name": "clock", "ok": True, "text": "NTP ±0.2 ms"},
                {"name": "disk", "ok": False, "text": "4 GB, 2 h"},
            ],
        }

    def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
        verb = command.verb
        if isinstance(command, BeginMark):
            self.begun.append((command.frame_id, command.is_on))
        elif verb != "status":
            self.sent.append((verb, command.arguments()))
        if verb in self.hangs:
            self.hangs[verb].wait(PATIENCE_S)
        if self.is_gone:
            raise ControlError("no engine is running: start one") from ConnectionRefusedError()
        if verb == "status":
            return Outcome(ok=True, data=dict(self.status))
        return self.outcomes.get(verb, Outcome(ok=True, message="done"))

    @property
    def verbs(self) -> list[str]:
        return [verb for verb, _ in self.sent]


def written(folder: Path) -> SessionWriter:
    writer = night.begin(folder)
    night.armed(writer)
    night.add_frames(writer, range(1, FRAMES + 1))
    night.add_previews(writer, range(FRAMES, FRAMES + 1))
    return writer


def play(
    wire: FakeWire,
    scene: Play,
    size: tuple[int, int] = FULL,
    *,
    frames: int = FRAMES,
    **settings: Any,
) -> str | None:
    """Open the seat, wait until it shows the night, play the scene; what the seat gave back."""

    async def run() -> str | None:
        app = ConsoleApp(lambda: wire, **settings)
        async with opened(app, size) as pilot:
            if not wire.is_gone or settings.get("session"):
                await until(
                    pilot,
                    lambda: len(app.live.night.rows) >= frames and app.live.picture is not None,
                )
            await scene(app, pilot)
        return app.return_value

    return asyncio.run(run())


_render_update = Compositor.render_update


def _when_looked_at(compositor: Compositor, full: bool = False, **named: Any) -> Any:
    """The whole screen as it is asked for; nothing for a terminal that is not there."""
    if full:
        return _render_update(compositor, full, **named)
    compositor._dirty_regions.clear()
    return None


_parse_rules = Stylesheet._parse_rules
_PARSED: dict[tuple[object, ...], list[RuleSet]] = {}


def _parsed_once(sheet: Stylesheet, *arguments: Any, **named: Any) -> list[RuleSet]:
    """The rules of a style sheet, read by the first seat for all others of the same colours."""
    key = (arguments, *sorted(named.items()), *sorted(sheet._variables.items()))
    if key not in _PARSED:
        _PARSED[key] = _parse_rules(sheet, *arguments, **named)
    return _PARSED[key]


class _SharedTrials(WhatIfProcess):
    """One for all seats: its libraries take a second to load."""

    def __init__(self) -> None:
        super().__init__()
        self._turn = threading.Lock()
        atexit.register(super().close)

    def _answer_to(self, question: WhatIfQuestion) -> Any:
        """One seat after the other."""
        with self._turn:
            return super()._answer_to(question)

    def close(self) -> None:
        """It stays for the next seat."""


_shared_trials = cache(_SharedTrials)


@asynccontextmanager
async def opened(app: ConsoleApp, size: tuple[int, int] = FULL) -> AsyncIterator[Pilot[str]]:
    """The seat, drawn where a test looks at it and once at the end: drawing costs the most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Compositor, "render_update", _when_looked_at)
        patch.setattr(Stylesheet, "_parse_rules", _parsed_once)
        patch.setattr(what_if_watch, "WhatIfProcess", _shared_trials)
        async with app.run_test(size=size) as pilot:
            yield pilot
            panes = [p for screen in app.screen_stack for p in screen.query(LinesPane)]
            assert [p.id for p in panes if NOT_DRAWN in p.text] == []
            if app.screen_stack and app.screen.is_running:
                app.screen._compositor.render_update(
                    full=True, screen_stack=app._background_screens
                )


async def until(pilot: Pilot[str], is_so: Callable[[], bool]) -> None:
    """Wait for what threads bring; a slow machine is given time, a broken seat is not."""
    deadline = time.monotonic() + PATIENCE_S
    begun = time.monotonic()
    while not is_so():
        # A look at a whole screen takes longer than one at a value.
        took_s = time.monotonic() - begun
        assert time.monotonic() < deadline, "it never came to be"
        await asyncio.sleep(max(0.01, 2.0 * took_s))
        begun = time.monotonic()
    await pilot.pause()


def has_outlook(app: ConsoleApp) -> bool:
    """Whether the next hours are told of where the telescope looks, and of what is followed."""
    outlook = app.live.outlook
    if outlook is None or not outlook.margins_deg:
        return False
    return app.live.night.track is None or outlook.target_limit is not None


async def can_answer(app: ConsoleApp, pilot: Pilot[str]) -> None:
    """Wait for a dialog, and until it takes an answer."""

    def is_ready() -> bool:
        dialog = app.screen
        is_drawn = isinstance(dialog, Dialog) and dialog._opened_s < math.inf
        return is_drawn and not dialog.ignores_keys

    await until(pilot, is_ready)


def pane(app: ConsoleApp, name: str) -> str:
    return app.live.query_one(f"#{name}", LinesPane).text


async def click(app: ConsoleApp, pilot: Pilot[str], words: str) -> None:
    """On a key of the last line, once it is there."""
    await until(pilot, lambda: words in pane(app, "keys"))
    rows = pane(app, "keys").splitlines()
    row = next(n for n, each in enumerate(rows) if words in each)
    await pilot.click("#keys", offset=(rows[row].index(words), row))


def screen_text(app: ConsoleApp) -> str:
    """The screen as a person reads it: no colours, no trailing blanks."""
    strips = app.live._compositor.render_strips()
    lines = ("".join(segment.text for segment in strip).rstrip() for strip in strips)
    return "\n".join(lines).rstrip() + "\n"


def stop_text(app: ConsoleApp) -> str:
    banner = app.live.query_one("#stop", StopBanner)
    return " ".join(banner.text.split()) if banner.display else ""
