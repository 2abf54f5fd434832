"""Each command of the pages that runs a telescope, real or simulated, or shows one: run as printed.

A night goes by orders alone, in one house with one engine; consoles, demos and reviews have a
terminal of their own. Without it, each verb is tried with an engine's stand-in
(``test_cli_telescope.py``), a whole night in ``test_demo.py``.
"""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import ControlError, SessionError
from rsoconsole.control import AskStatus, ControlClient, Sender
from rsoconsole.records import Event, SlewCommand
from rsoconsole.session import SessionReader
from rsoconsole.simulator import scenario_named
from rsoconsole.sky import separation_deg
from rsoconsole.words import NS_PER_S
from tests.pages.command_house import PATIENCE_S, PROGRAM, House, Recipes, a_house, seen
from tests.pages.command_sky import SPEED, engine_toml, observatory
from tests.pages.command_things import BELT, TARGET, TARGET_NAME, Things, gps_over_warsaw, pass_over
from tests.pages.json_page import expect_documented
from tests.rigs.terminal import READS_S, Terminal

RECIPES = Recipes()
pytestmark = [
    pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not installed"),
    pytest.mark.timeout(900),
    pytest.mark.nightly("starts engines, and consoles in terminals"),
]
VEGA_RA_DEG, VEGA_DEC_DEG = 279.2347, 38.7837
A_STARS_WAY_DEG = 0.5
"""Between where a star stands and where the mount believes to look: precession of 23 years."""


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    with a_house(tmp_path) as own:
        yield own


# ---- a night by orders -------------------------------------------------------------------------


def status_of(house: House) -> dict[str, Any]:
    """What the engine says of itself, over the socket."""
    client = ControlClient(house.socket, sender=Sender(name="test"))
    return dict(client.send(AskStatus()).data)


def until(house: House, is_so: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
    """Wait for a status."""
    ends_s = time.monotonic() + PATIENCE_S
    status: dict[str, Any] = {}
    while time.monotonic() < ends_s:
        try:
            status = status_of(house)
            if is_so(status):
                return status
        except ControlError:
            pass
        time.sleep(0.25)
    raise AssertionError(f"no sign of {what}: {status}")


def until_said(said: Callable[[], str], words: str) -> str:
    """Wait for what a command says; what it has said."""
    ends_s = time.monotonic() + PATIENCE_S
    while words not in said():
        assert time.monotonic() < ends_s, f"no sign of {words!r}: {said()}"
        assert "it has ended" not in said(), said()
        time.sleep(0.05)
    return said()


BY_ORDERS = (
    "rsoconsole doctor",
    "rsoconsole doctor --json",
    "rsoconsole engine",
    "rsoconsole status",
    "rsoconsole arm",
    "rsoconsole disarm",
    "rsoconsole arm --override disk",
    "rsoconsole set detector.tau 0.2",
    "rsoconsole set NAME VALUE",
    "rsoconsole status --json",
    "rsoconsole status --prometheus --out /var/lib/node_exporter/rsoconsole.prom",
    "rsoconsole keep 3",
    "rsoconsole keep TRACK",
    "rsoconsole drop TRACK",
    "rsoconsole drop 3",
    "rsoconsole hold",
    "rsoconsole resume",
    'rsoconsole goto "alt 50 az 180"',
    "rsoconsole goto TARGET",
    "rsoconsole console",
    "rsoconsole stop",
    "rsoconsole park",
    "rsoconsole unpark",
    "rsoconsole quit",
)


def test_a_night_goes_by_the_orders_as_printed(house: House) -> None:
    with observatory() as sky:
        house.configure(engine_toml(sky))
        expect_ready(house)
        with house.running("rsoconsole engine") as said:
            until_said(said, "it waits for 'rsoconsole arm'")
            assert house.run("rsoconsole status").stdout.startswith("IDLE · nobody has the mount")
            arm_and_disarm(house)
            tune(house)
            choose_tracks(house)
            look_on(house)
            take_over(house)
            end(house)
    assert house.ran >= set(BY_ORDERS)


def expect_ready(house: House) -> None:
    """The doctor finds nothing wrong but, on a machine without one, the synchronised clock."""
    is_synchronised = os.access("/run/systemd/timesync/synchronized", os.F_OK) or _kernel_says_so()
    code = 0 if is_synchronised else 1
    rows = house.run("rsoconsole doctor --json", expect=code).objects
    for row in rows:
        expect_documented("doctor", row)
    assert {r["check"] for r in rows if r["ok"] is False} == (set() if not code else {"clock"})
    by_name = {row["check"]: row for row in rows}
    for name in ("network", "index files", "INDI server", "mount site", "sessions folder"):
        assert by_name[name]["ok"], by_name[name]
    said = house.run("rsoconsole doctor", expect=code).stdout
    assert "ok   INDI server" in said


def _kernel_says_so() -> bool:
    from rsoconsole.engine.doctor.doctor_system import read_clock

    return read_clock().is_synchronised is True


def arm_and_disarm(house: House) -> None:
    house.run("rsoconsole arm")
    until(house, lambda s: s["holder"] == "autonomy", "an armed engine")
    house.run("rsoconsole disarm")
    until(house, lambda s: s["holder"] == "nobody", "a disarmed engine")
    house.run("rsoconsole arm --override disk")
    until(house, lambda s: s["holder"] == "autonomy", "an armed engine again")


def tune(house: House) -> None:
    house.run("rsoconsole set detector.tau 0.2")
    house.run("rsoconsole set NAME VALUE", {"NAME": "filter.r_multiplier", "VALUE": "1.5"})
    reader = SessionReader(Path(status_of(house)["session"]))
    until(house, lambda _: len(list(reader.view_rows("parameters"))) >= 2, "both on record")
    changed = {row["name"]: row["after"] for row in reader.view_rows("parameters")}
    assert changed["detector.tau"] == 0.2
    assert changed["filter.r_multiplier"] == 1.5


def choose_tracks(house: House) -> None:
    """Three satellites are followed: two are kept, two dropped."""

    def followed(status: dict[str, Any]) -> dict[int, dict[str, Any]]:
        return {each["track_id"]: each for each in status["tracks"]}

    until(house, lambda s: {1, 2, 3} <= set(followed(s)), "three tracks")
    found = house.run("rsoconsole status --json").object
    assert {1, 2, 3} <= set(followed(found))
    house.run("rsoconsole status --prometheus --out /var/lib/node_exporter/rsoconsole.prom")
    figures = (house.inside("/var/lib/node_exporter") / "rsoconsole.prom").read_text()
    assert "rsoconsole_up 1" in figures.splitlines()
    assert f"rsoconsole_tracks {len(found['tracks'])}" in figures.splitlines()
    house.run("rsoconsole keep 3")
    house.run("rsoconsole keep TRACK", {"TRACK": "1"})
    until(house, lambda s: all(followed(s)[n]["is_kept"] for n in (1, 3)), "two kept tracks")
    house.run("rsoconsole drop TRACK", {"TRACK": "2"})
    house.run("rsoconsole drop 3")
    until(house, lambda s: set(followed(s)) == {1}, "the others ended for good")


def look_on(house: House) -> None:
    house.run("rsoconsole hold")
    until(house, lambda s: s["is_held"], "held slews")
    house.run("rsoconsole resume")
    until(house, lambda s: not s["is_held"], "slews again")
    with house.seat("rsoconsole console") as seat:
        seen(seat, lambda: seat.shows("AUTO has the mount", "x STOP"), "the night")
        seen(seat, lambda: seat.shows("TRACK"), "what is followed")
        seat.press("q")
        seen(seat, lambda: seat.shows("leave the console", "the engine keeps running"), "a choice")
        time.sleep(READS_S)
        seat.press("l")
    assert status_of(house)["holder"] == "autonomy", "leaving changes nothing"


def take_over(house: House) -> None:
    said = house.run('rsoconsole goto "alt 50 az 180"').stdout
    assert "understood: altitude and azimuth" in said
    until(
        house,
        lambda s: (
            s["holder"] == "operator"
            and not s["is_slewing"]
            and abs(s["mount_alt_deg"] - 50.0) < 1.0
            and abs(s["mount_az_deg"] - 180.0) < 1.5
        ),
        "an arrival in the south",
    )
    said = house.run("rsoconsole goto TARGET", {"TARGET": "Vega"}).stdout
    assert "understood: Vega" in said
    until(
        house,
        lambda s: (
            not s["is_slewing"]
            and separation_deg(s["mount_ra"], s["mount_dec"], VEGA_RA_DEG, VEGA_DEC_DEG)
            < A_STARS_WAY_DEG
        ),
        "an arrival at Vega",
    )
    house.run("rsoconsole resume")
    until(house, lambda s: s["holder"] == "autonomy", "the mount handed back")


def end(house: House) -> None:
    said = house.run("rsoconsole stop").stdout
    answered, measured = said.splitlines()
    assert answered.startswith("STOP ABORT answered in ")
    assert measured.startswith("STOP the mount tracks, measured in ")
    status = until(house, lambda s: s["holder"] == "nobody", "a stopped engine")
    assert status["last_stop"]["motion"] == "tracks"
    house.run("rsoconsole park")
    until(house, lambda s: s["is_parked"], "a parked mount")
    house.run("rsoconsole unpark")
    until(house, lambda s: not s["is_parked"], "a free mount")
    assert "ends" in house.run("rsoconsole quit").stdout


# ---- engines that are armed at once, or wait for a pass ----------------------------------------

NIGHT_UTC_NS = scenario_named("ses-10").t_start_utc_ns
ARMED = (
    "rsoconsole engine --config ~/.config/rsoconsole/config.toml --arm",
    "rsoconsole engine --arm --pass 25544 --tle active.tle",
    "rsoconsole engine --pass NORAD --tle FILE",
)


def test_engines_that_are_armed_at_once_or_wait_for_a_pass(house: House) -> None:
    with observatory(2.0 * SPEED) as sky:
        house.configure(engine_toml(sky))
        with house.running(ARMED[0]):
            until(house, lambda s: s["holder"] == "autonomy", "an armed engine")
            until(house, lambda s: s["frame"] >= 2, "a search")
            house.run("rsoconsole quit")
        (house.here / "active.tle").write_text(pass_over(NIGHT_UTC_NS), encoding="ascii")
        with house.running(ARMED[2], {"NORAD": "25544", "FILE": "active.tle"}) as said:
            until_said(said, "it waits for 'rsoconsole arm'")
            status = status_of(house)
            config = SessionReader(Path(status["session"])).config()
            assert (config.leap.enabled, config.leap.pass_norad) == (True, 25544)
            house.run("rsoconsole quit")
        # It is above the lowest altitude for seven minutes on either side of that: to be there in
        # time the engine has 40 s on the wall's clock.
        soon = pass_over(status["now_utc_ns"] + 22 * 60 * NS_PER_S)
        (house.here / "active.tle").write_text(soon, encoding="ascii")
        with house.running(ARMED[1]):
            status = until(house, lambda s: s["holder"] == "autonomy", "an armed engine")
            reader = SessionReader(Path(status["session"]))

            def goes_there() -> bool:
                orders = [r for _, _, r in reader.records(kinds=(SlewCommand,))]
                return any(order.reason == "await" for order in orders)

            until(house, lambda _: goes_there(), "a slew to where it comes by")
            words = [r.text for _, _, r in reader.records(kinds=(Event,))]
            assert any(text.startswith("waits for ISS (ZARYA), which comes by") for text in words)
            house.run("rsoconsole quit")
    assert house.ran >= set(ARMED)


# ---- demos and reviews -------------------------------------------------------------------------


@pytest.mark.parametrize("command", RECIPES)
def test_it_runs_as_printed(command: str, house: House) -> None:
    RECIPES[command](house, command)
    assert command in house.ran


@RECIPES.of("rsoconsole demo --headless --scenario intelsat-14 --frames 40 --json")
def demo_headless(house: House, command: str) -> None:
    found = house.run(command).object
    expect_documented("demo", found)
    assert (found["frames"], found["target"]) == (40, TARGET_NAME)
    assert found["identified"]["norad_id"] == TARGET
    assert found["states"]["TRACK"] >= 20
    assert found["prediction_rms_arcsec"] < 6.0


@RECIPES.of("rsoconsole demo", "rsoconsole demo --world random --seed 7")
def demo(house: House, command: str) -> None:
    with house.seat(command) as seat:
        begun(house, seat)
        session = leave(house, seat)
    is_imperfect = (session / "world.toml").exists()
    assert is_imperfect is ("--world" in command)
    assert SessionReader(session).read_meta()["title"].startswith("intelsat-14 seed")


@RECIPES.of("rsoconsole demo --target 26407 --tle gps.tle --site 52.2,21.0,110")
def demo_of_a_navigation_satellite(house: House, command: str) -> None:
    (house.here / "gps.tle").write_text(gps_over_warsaw(), encoding="ascii")
    with house.seat(command) as seat:
        seen(seat, lambda: seat.shows("from +52.20 +21.00"), "what is to be seen")
        begun(house, seat)
        session = leave(house, seat)
    assert SessionReader(session).config().site.latitude_deg == 52.2


@RECIPES.of("rsoconsole demo --target NAME --tle FILE")
def demo_of_a_name(house: House, command: str) -> None:
    (house.here / "catalogue.tle").write_bytes(BELT.read_bytes())
    with house.seat(command, {"NAME": "'ses 6'", "FILE": "catalogue.tle"}) as seat:
        seen(seat, lambda: seat.shows("SES 6 from +29.19 -81.05"), "what is to be seen")
        begun(house, seat)
        leave(house, seat)


def begun(house: House, seat: Terminal) -> None:
    """The console shows a night that goes on."""

    def has_frames() -> bool:
        try:
            return SessionReader(Path(status_of(house)["session"])).counts().frames > 0
        except (ControlError, SessionError):
            return False

    seen(seat, lambda: seat.shows("x STOP"), "a console")
    seen(seat, has_frames, "a frame")


def leave(house: House, seat: Terminal) -> Path:
    """Out of the console, with the engine's end; the session."""
    session = Path(status_of(house)["session"])
    seat.press("q")
    seen(seat, lambda: seat.shows("leave the console", "Stop the engine"), "a choice")
    time.sleep(READS_S)
    seat.press("s")
    seen(seat, lambda: seat.shows(f"session {session}"), "the figures")
    assert SessionReader(session).counts().frames >= 1
    return session


@RECIPES.of("rsoconsole review sessions/intelsat-14 --at 12")
def review_at(house: House, command: str) -> None:
    Things(house.folder).put_session(house.here / "sessions" / "intelsat-14")
    with house.seat(command) as seat:
        seen(seat, lambda: seat.shows("frame 12 of 36"), "frame 12")
        seat.press("q")


@RECIPES.of("rsoconsole review SESSION")
def review(house: House, command: str) -> None:
    Things(house.folder).put_session(house.here / "sessions" / "intelsat-14")
    with house.seat(command, {"SESSION": "sessions/intelsat-14"}) as seat:
        seen(seat, lambda: seat.shows("frame 1 of 36"), "the night")
        seat.press("q")


@RECIPES.of("rsoconsole review --sample")
def review_sample(house: House, command: str) -> None:
    with house.seat(command) as seat:
        seen(seat, lambda: seat.shows("of 36"), "the sample")
        seat.press("q")
    (copied,) = (house.data / "sessions").iterdir()
    assert SessionReader(copied).counts().frames == 36
