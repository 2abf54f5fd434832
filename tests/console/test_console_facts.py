"""Where things stand, in figures: what is said, and what is left out where there is no room."""

import dataclasses
from typing import Any

import pytest

from rsoconsole.console.night.engine_view import EngineView, read_engine_view
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.night import FrameRow, NightView
from rsoconsole.pipeline import SkyOutlook
from rsoconsole.records import CycleTiming, SlewCommand
from rsoconsole.sky.limits.refusals import beyond_bound_refusal
from tests.makers import NS, T0_UTC_NS
from tests.nights.made_up_night import state_of

NOW = T0_UTC_NS
HOUR = 3600 * NS
SKY = SkyOutlook(
    t_utc_ns=NOW,
    sun_altitude_deg=-31.0,
    sun_azimuth_deg=10.0,
    dark_utc_ns=(NOW - 2 * HOUR, NOW + 5 * HOUR),
    moon_altitude_deg=12.0,
    moon_azimuth_deg=90.0,
    moon_lit=0.62,
    moon_away_deg=87.0,
    margins_deg=(("altitude", 3.0), ("hour angle", 97.0)),
)


def engine(**status: Any) -> EngineView:
    values = {"state": "TRACK", "holder": "autonomy", "now_utc_ns": NOW, "ra": 10.0, "dec": 0.0}
    return read_engine_view(values | status)


def words(
    night: NightView | None = None,
    *,
    size: tuple[int, int] = (120, 5),
    outlook: SkyOutlook | None = SKY,
    **status: Any,
) -> str:
    lines = figure_lines(night or NightView(), engine(**status), outlook, *size)
    assert len(lines) <= size[1]
    assert all(sum(len(text) for text, _ in line) <= size[0] for line in lines)
    return "\n".join("".join(text for text, _ in line) for line in lines)


def inked(night: NightView | None = None, **status: Any) -> set[str]:
    lines = figure_lines(night or NightView(), engine(**status), SKY, 200, 20)
    return {text.strip() for line in lines for text, ink in line if ink == "warn"}


def test_what_the_telescope_does_now_has_a_countdown():
    assert "exposing, 7 s left" in words(exposing_until_utc_ns=NOW + 7 * NS)
    waiting = words(is_slewing=True, next_start_utc_ns=NOW + 12 * NS)
    assert "slewing  next exposure in 12 s" in waiting
    assert "exposure" not in words()


def test_what_comes_is_told_the_soonest_first_with_clock_and_time_left():
    refusal = beyond_bound_refusal("altitude", 15.0, 15.0)
    sky = dataclasses.replace(
        SKY, target_limit=(NOW + 3 * HOUR, refusal), eclipse_utc_ns=NOW + 42 * 60 * NS
    )
    said = words(outlook=sky, size=(160, 5))
    places = [said.index(what) for what in ("eclipse", "altitude limit", "dawn", "Moon", "Sun")]
    assert places == sorted(places)
    assert "(42m00)" in said
    assert "(3h00)" in said
    assert "Moon 62% +12°, 87° away" in said


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"eclipse_utc_ns": NOW}, "in eclipse"),
        ({"dark_utc_ns": None}, "it does not get dark"),
        ({"dark_utc_ns": (NOW + HOUR, NOW + 9 * HOUR)}, "dark "),
        ({"moon_altitude_deg": -3.0}, "Moon down"),
    ],
)
def test_what_is_so_already_is_said_plainly(changes, said):
    assert said in words(outlook=dataclasses.replace(SKY, **changes))


def test_a_near_limit_and_what_is_not_well_are_inked():
    health = [
        {"name": "disk", "ok": False, "text": "4 GB, 2 h"},
        {"name": "clock", "ok": True, "text": "NTP ±0.2 ms"},
    ]
    assert inked(health=health, next_limit="pier", next_limit_utc_ns=NOW + 540 * NS) == {
        "altitude 3°",
        "disk 4 GB, 2 h",
        "limit if tracking: pier in 9 min",
    }


@pytest.mark.parametrize("size", [(80, 3), (80, 8), (160, 12)])
def test_a_weak_supply_and_a_hot_processor_are_alarms_in_words(size):
    health = [
        {"name": "mount", "ok": True, "text": "tracking"},
        {"name": "clock", "ok": False, "text": "not synchronised"},
        {"name": "power", "ok": False, "text": "UNDER-VOLTAGE"},
        {"name": "CPU", "ok": False, "text": "84 °C, hot, throttled"},
    ]
    lines = figure_lines(NightView(), engine(health=health), SKY, *size)
    told = {text.strip(): ink for line in lines for text, ink in line}
    assert told["power UNDER-VOLTAGE"] == "alarm"
    assert told["CPU 84 °C, hot, throttled"] == "alarm"
    assert told.get("clock not synchronised", "warn") == "warn"


@pytest.mark.parametrize("size", [(80, 3), (120, 5), (120, 12)])
def test_a_slew_is_said_once(size: tuple[int, int]):
    mount = {"mount_ra": 10.0, "mount_dec": 0.0, "mount_t_utc_ns": NOW}
    said = words(size=size, ra=None, dec=None, is_slewing=True, slew_left_s=41.0, **mount)
    assert said.count("slewing, 41 s left") == 1


@pytest.mark.parametrize("track_id", [None, 1])
def test_an_aim_is_said_where_it_led_to_the_track_whatever_its_words(track_id: int | None):
    aim = SlewCommand(
        frame_id=4,
        ra_icrs_deg=10.0,
        dec_icrs_deg=0.0,
        t_aim_utc_ns=NOW,
        reason="in other words",
        track_id=track_id,
    )
    said = words(NightView(track=state_of(4, 10.0, 0.0, "updated"), slew=aim))
    assert ("aim: in other words" in said) == (track_id is not None)


def test_stars_that_grow_are_called_focus_or_seeing():
    def night(widths: list[float]) -> NightView:
        rows = (
            FrameRow(frame_id=n, facts={"star_fwhm_px": width}) for n, width in enumerate(widths)
        )
        return NightView(rows=tuple(rows))

    assert "FWHM 2.9 px" in words(night([3.0, 2.9, 2.9, 3.1, 2.8, 2.9]))
    assert "focus or seeing" not in words(night([3.0, 2.9, 2.9, 9.0, 2.8, 2.9]))
    assert inked(night([2.9] * 6 + [3.6] * 6)) >= {"FWHM 3.6 px, was 2.9: focus or seeing"}
    assert "stars" not in words()


def test_a_sky_without_its_stars_is_told_by_the_solver():
    def night(solved: list[bool | None]) -> NightView:
        rows = (FrameRow(frame_id=n, is_solved=each) for n, each in enumerate(solved))
        return NightView(rows=tuple(rows))

    assert "solver 8 of 9" in words(night([False] * 5 + [True] * 9 + [False, None]))
    assert inked(night([True] * 5 + [False] * 6)) >= {"solver 4 of 10"}
    assert "solver" not in words(night([None]))


def test_a_small_terminal_keeps_what_is_wrong_and_leaves_out_what_is_well():
    health = [
        {"name": "disk", "ok": False, "text": "4 GB, 2 h"},
        {"name": "clock", "ok": True, "text": "NTP ±0.2 ms"},
    ]
    timing = CycleTiming(frame_id=1, stage_ms={"total": 180.0, "read": 30.0})
    said = words(NightView(timing=timing), size=(80, 3), health=health)
    assert "disk 4 GB" in said
    assert "clock" not in said
    assert "cycle" not in said
    assert "dawn" in said


@pytest.mark.parametrize("size", [(58, 14), (40, 10), (120, 5), (80, 3), (40, 3), (20, 1)])
def test_it_fits_every_place_it_is_given(size):
    health = [{"name": "mount", "ok": True, "text": "tracking"}] * 6
    said = words(size=size, health=health, next_limit="pier", next_limit_utc_ns=NOW + 3120 * NS)
    assert "α 00:40:00.0" in said or size[0] < 40


def test_a_column_of_its_own_has_a_word_for_every_group():
    said = words(size=(58, 14), health=[{"name": "mount", "ok": True, "text": "tracking"}])
    heads = [line.split()[0] for line in said.splitlines() if line[1:2] != " "]
    assert heads == ["where", "motion", "next", "limits", "cycle", "machine"]
