"""What is up now: against skyfield with the same elements, in a list from which one is gone to."""

import asyncio
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Static

from rsoconsole.config import Config, LimitsConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.ask import UNREAD, GotoDialog
from rsoconsole.console.dialogs.up_list import VisibleSatellitesDialog
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.control import Outcome
from rsoconsole.orbits import parse_element_sets
from rsoconsole.pipeline import visible_satellites
from rsoconsole.session import element_ledger_path, replace_session_rows
from rsoconsole.sky import iso_to_utc_ns
from tests.orbits.test_element_fit import row
from tests.rigs.seat_rig import PREVIEW, FakeWire, can_answer, play, until
from tests.truth.lit_sphere import lambert_mag, sphere_by_skyfield

NOW = iso_to_utc_ns("2023-06-22T05:30:00Z")
LOW = """ISS (ZARYA)
1 25544U 98067A   23173.20000000  .00010000  00000-0  18000-3 0  9990
2 25544  51.6400 300.0000 0005000  60.0000 300.0000 15.50000000402000
"""
SITE = Config().site.to_site()
LIMITS = LimitsConfig(min_altitude_deg=15.0)


def with_checksums(text: str) -> str:
    from rsoconsole.orbits.elements.elements import checksum

    return "\n".join(
        line[:68] + str(checksum(line)) if line[:2] in {"1 ", "2 "} else line
        for line in text.splitlines()
    )


def altitudes_by_skyfield(minutes: Sequence[float]) -> np.ndarray:
    from skyfield.api import EarthSatellite, load, wgs84

    one, two = with_checksums(LOW).splitlines()[1:3]
    timescale = load.timescale(builtin=True)
    satellite = EarthSatellite(one, two, "", timescale)
    site = wgs84.latlon(SITE.latitude_deg, SITE.longitude_deg, SITE.elevation_m)
    instants = timescale.utc(2023, 6, 22, 5, 30 + np.asarray(minutes))
    return np.asarray((satellite - site).at(instants).altaz()[0].degrees)


def pass_begins() -> int:
    """The minute in which the low satellite comes up over 15 degrees."""
    is_up = altitudes_by_skyfield(range(1500)) >= 15.0
    return int(np.flatnonzero(~is_up[:-1] & is_up[1:])[0]) + 1


def test_a_low_satellite_is_up_for_minutes_as_skyfield_has_them():
    entries = parse_element_sets(with_checksums(LOW)).entries
    begins = pass_begins()
    t_utc_ns = NOW + begins * 60 * 10**9
    (up,) = visible_satellites(entries, SITE, t_utc_ns, LIMITS)
    a_hundredth_deg, five_seconds_min = 0.02, 5.0 / 60.0
    assert up.alt_deg == pytest.approx(altitudes_by_skyfield([begins])[0], abs=a_hundredth_deg)
    assert up.minutes_left is not None
    assert 1.0 < up.minutes_left < 10.0
    sets = begins + up.minutes_left
    before, after = altitudes_by_skyfield([sets - five_seconds_min, sets + five_seconds_min])
    assert before > 15.0 > after
    assert up.rate_arcsec_s > 500.0
    later = visible_satellites(entries, SITE, t_utc_ns + 20 * 60 * 10**9, LIMITS)
    assert later == ()


def test_the_belt_stays_up_is_sorted_and_a_wall_hides_some_of_it():
    from rsoconsole.pipeline import read_catalogue
    from rsoconsole.simulator import elements_path

    entries = read_catalogue([elements_path()]).entries
    found = visible_satellites(entries, SITE, NOW, LIMITS)
    assert len(found) > 5
    assert [up.alt_deg for up in found] == sorted((up.alt_deg for up in found), reverse=True)
    intelsat = next(up for up in found if up.norad_id == 36097)
    assert intelsat.minutes_left is None
    assert (intelsat.alt_deg, intelsat.az_deg) == pytest.approx((38.06, 123.82), abs=0.05)
    wall = LimitsConfig(min_altitude_deg=15.0, horizon=((0, 0), (120, 45), (130, 45), (140, 0)))
    assert 36097 not in {up.norad_id for up in visible_satellites(entries, SITE, NOW, wall)}
    assert visible_satellites((), SITE, NOW, LIMITS) == ()


def test_one_is_found_by_typing_and_gone_to_by_the_plan_of_every_go_to(wire: FakeWire):
    from rsoconsole.simulator import elements_path

    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)
    wire.status["now_utc_ns"] = NOW

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        config = Config.model_validate({"catalogue": {"tle_files": [elements_path()]}})
        app.live.night = dataclasses.replace(app.live.night, config=config)
        await pilot.press("5")
        await until(pilot, lambda: isinstance(app.screen, VisibleSatellitesDialog))
        rows = app.screen.query_one("#rows", LinesPane)
        await until(pilot, lambda: "INTELSAT 14" in rows.text)
        assert "by altitude" in rows.text
        await pilot.press(*"intelsat 14")
        await until(pilot, lambda: "SES" not in rows.text)
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, GotoDialog))
        assert app.screen.query_one(Input).value == "36097"
        said = app.screen.query_one("#understood", Static)
        await until(pilot, lambda: "INTELSAT 14 (36097)" in str(said.render()))
        await until(pilot, lambda: "enter goes there" in str(said.render()))
        assert "goto" not in wire.verbs
        await can_answer(app, pilot)
        await pilot.press("enter")
        await until(pilot, lambda: "goto" in wire.verbs)

    play(wire, scene)


def test_one_whose_brightness_is_known_has_its_magnitude(
    wire: FakeWire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from rsoconsole.pipeline import read_catalogue
    from rsoconsole.simulator import elements_path

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    light = {"standard_mag": 4.6, "standard_mag_sigma": 0.2}
    kept = dataclasses.replace(row(36097, 1.0), **light)
    replace_session_rows([], [kept], element_ledger_path())
    wire.status["now_utc_ns"] = NOW
    entries = read_catalogue([elements_path()]).entries
    (entry,) = (each for each in entries if each.norad_id == 36097)
    seen = sphere_by_skyfield(entry.record, SITE, NOW)
    truth = lambert_mag(4.6, seen.range_km[0], seen.phase_deg[0])

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        config = Config.model_validate({"catalogue": {"tle_files": [elements_path()]}})
        app.live.night = dataclasses.replace(app.live.night, config=config)
        await pilot.press("5")
        await until(pilot, lambda: isinstance(app.screen, VisibleSatellitesDialog))
        rows = app.screen.query_one("#rows", LinesPane)
        await until(pilot, lambda: "INTELSAT 14" in rows.text)
        lines = [line for line in rows.text.splitlines() if "mag" in line]
        assert len(lines) == 1
        assert "36097" in lines[0]
        assert float(lines[0].split("mag")[1].split()[0]) == pytest.approx(truth, abs=0.06)

    play(wire, scene)


@pytest.mark.parametrize("key", ["g", "5"])
def test_what_is_asked_before_the_night_is_read_waits_for_its_settings(wire: FakeWire, key: str):
    from rsoconsole.simulator import elements_path

    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)
    wire.status["now_utc_ns"] = NOW

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        read = app.live.night
        config = Config.model_validate({"catalogue": {"tle_files": [elements_path()]}})
        app.live.night = dataclasses.replace(read, config=None, is_read=False)
        await pilot.press(key)
        await until(pilot, lambda: isinstance(app.screen, GotoDialog | VisibleSatellitesDialog))
        await pilot.press(*"intelsat 14")
        shown = "#understood" if key == "g" else "#rows"
        said = lambda: str(app.screen.query_one(shown).render())  # noqa: E731
        if key == "g":
            await until(pilot, lambda: UNREAD in said())
        await asyncio.sleep(1.0)
        assert "no star known" not in said()
        assert "no element files" not in said()
        app.live.night = dataclasses.replace(read, config=config)
        await until(pilot, lambda: "INTELSAT 14" in said())

    play(wire, scene)


def test_without_element_files_it_says_where_to_name_them(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("5")
        await until(pilot, lambda: isinstance(app.screen, VisibleSatellitesDialog))
        rows = app.screen.query_one("#rows", LinesPane)
        await until(pilot, lambda: "catalogue.tle_files" in rows.text)

    play(wire, scene)


def test_what_cannot_be_computed_is_said_and_in_the_log(wire: FakeWire, monkeypatch, caplog):
    from rsoconsole.simulator import elements_path

    def broken(*_: object) -> None:
        raise ZeroDivisionError("no such night")

    monkeypatch.setattr("rsoconsole.pipeline.visibility.passes.visible_satellites", broken)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        config = Config.model_validate({"catalogue": {"tle_files": [elements_path()]}})
        app.live.night = dataclasses.replace(app.live.night, config=config)
        await pilot.press("5")
        await until(pilot, lambda: isinstance(app.screen, VisibleSatellitesDialog))
        rows = app.screen.query_one("#rows", LinesPane)
        await until(pilot, lambda: "it cannot be computed" in rows.text)

    play(wire, scene)
    assert "no such night" in caplog.text
