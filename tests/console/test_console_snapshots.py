"""Every screen in every state, as pictures that somebody has looked at.

``RSOCONSOLE_WRITE_SNAPSHOTS=1`` writes them again; look at the diff then.
"""

from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.pane_layout import has_tuning_column
from rsoconsole.control import Outcome
from rsoconsole.records import Cause, Missed, StateChange, TrackLost
from tests.nights import eight_tracks, orbit_night
from tests.nights import made_up_night as night
from tests.rigs.screen_text import expect_as_agreed, screen_text
from tests.rigs.seat_rig import FakeWire, has_outlook, play, until
from tests.tiers import plain_first

SIZES = ((80, 24), (120, 40), (200, 60))
FAILED = {"name": "network", "ok": False, "detail": "damaged", "remedy": "install it again"}
AIM = {
    "ra_icrs_deg": 152.0,
    "dec_icrs_deg": -5.0,
    "t_utc_ns": night.t_of(22),
    "policy": "group",
    "reason": "orbit, 8 of 8 in the field",
    "moves_arcmin": 7.5,
}
WIDE = Cause(
    kind="missed",
    missed=Missed(kind="no detection", lost=TrackLost.by_uncertainty(40.0, fits_field=True)),
)
Act = Callable[[ConsoleApp, Pilot[str]], Awaitable[None]]


def told(folder: Path, frames: int, *, after: str = "") -> Path:
    """A night of so many frames, closed; ``after``: a state it ends in."""
    writer = night.begin(folder)
    night.armed(writer)
    night.add_frames(writer, range(1, frames + 1))
    night.add_previews(writer, range(frames, frames + 1))
    if after:
        change = StateChange(
            frame_id=frames,
            before="COAST",
            after=after,
            reason=WIDE,
        )
        writer.append(change, night.t_of(frames))
    writer.close()
    return folder


def orbit_told(folder: Path, frames: int, *, after: str = "") -> Path:
    """The same with orbits and a name on record."""
    orbit_night.write(folder, frames).close()
    return folder


def eight_told(folder: Path, frames: int, *, after: str = "") -> Path:
    """A slot of eight satellites, of which one is not seen."""
    writer = night.begin(folder)
    eight_tracks.write(writer, range(1, frames + 1))
    night.add_previews(writer, range(frames, frames + 1))
    writer.close()
    return folder


async def nothing(app: ConsoleApp, pilot: Pilot[str]) -> None:
    await until(pilot, lambda: app.live.engine.is_attached)


def keys(*names: str) -> Act:
    async def press(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await nothing(app, pilot)
        await pilot.press(*names)

    return press


async def dead(app: ConsoleApp, pilot: Pilot[str]) -> None:
    await until(pilot, lambda: app.live.engine.reach == "gone")


async def orbit(app: ConsoleApp, pilot: Pilot[str]) -> None:
    """Opened where it does not stand by itself."""
    await until(pilot, lambda: app.live.orbit.ahead is not None)
    if not app.live.pane("orbit").display:
        await pilot.press("o")


STATES: dict[str, tuple[int, str, dict, Act]] = {
    "live": (20, "", {}, nothing),
    "searching": (2, "", {"state": "SEARCH", "ra": None, "dec": None}, nothing),
    "coasting": (night.MISSED, "", {"state": "COAST"}, nothing),
    "lost": (night.MISSED, "LOST", {"state": "LOST", "ra": None, "dec": None}, nothing),
    "engine-dead": (20, "", {}, dead),
    "read-only": (20, "", {}, keys("a")),
    "help": (20, "", {}, keys("f1")),
    "not-armed": (20, "", {"state": "IDLE", "holder": "nobody"}, keys("a")),
    "go-to": (20, "", {}, keys("g")),
    "tune": (20, "", {}, keys("t", "down", "right")),
    "mark": (20, "", {}, keys("z", "m", "left", "enter", "right", "right")),
    "log": (20, "", {}, keys("l")),
    "orbit": (20, "", {}, orbit),
    "tracks": (20, "", {"next_aim": AIM}, keys("6", "down")),
}
TELLERS = {"orbit": orbit_told, "tracks": eight_told}


@pytest.fixture(scope="module")
def night_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The night of a state, written once for all sizes, and once for states that share it."""

    @cache
    def written(tell: Callable[..., Path], frames: int, after: str) -> Path:
        return tell(tmp_path_factory.mktemp("snapshots") / "night", frames, after=after)

    def of(state: str) -> Path:
        frames, after, _, _ = STATES[state]
        return written(TELLERS.get(state, told), frames, after)

    return of


@pytest.mark.parametrize(
    "size", plain_first(2, zip(SIZES)), ids=lambda size: f"{size[0]}x{size[1]}"
)
@pytest.mark.parametrize("state", STATES)
def test_the_screen_looks_as_it_was_agreed(
    night_of: Callable[[str], Path], impatient_seat: None, state: str, size: tuple[int, int]
):
    if state == "tracks" and size != SIZES[0]:
        pytest.skip("the list is held where there is the least room")
    frames, _, status, act = STATES[state]
    wire = FakeWire(night_of(state))
    wire.status |= {**status, "frame": frames, "now_utc_ns": night.t_of(frames) + 7 * 10**9}
    wire.status["exposing_until_utc_ns"] = night.t_of(frames) + 9 * 10**9
    wire.status["next_limit_utc_ns"] = wire.status["now_utc_ns"] + 52 * 60 * 10**9
    wire.outcomes["arm"] = Outcome(ok=False, message="not yet", data={"checks": [FAILED]})
    seen = ""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        nonlocal seen
        # The first outlook may be that of the log alone, before the engine has answered.
        now = wire.status["now_utc_ns"]
        await until(pilot, lambda: has_outlook(app) and app.live.outlook.t_utc_ns == now)
        if has_tuning_column(*size):
            await until(pilot, lambda: app.live.tune.figures[0] is not None)
        if state == "engine-dead":
            wire.is_gone = True
        await act(app, pilot)
        if state == "not-armed":
            await until(pilot, lambda: app.screen is not app.live)
        if state == "tune":
            await until(pilot, lambda: app.live.tune.figures[1] is not None)
        await pilot.pause(0.05)
        seen = screen_text(app)

    play(wire, scene, size, frames=frames, read_only=state == "read-only")
    expect_as_agreed(seen, f"{state}_{size[0]}x{size[1]}")


def _outlook_utc_ns(app: ConsoleApp) -> int | None:
    return None if app.live.outlook is None else app.live.outlook.t_utc_ns
