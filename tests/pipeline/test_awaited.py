"""A pass that is waited for: early or late by tens of seconds, it is caught, named and followed."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.base import OrbitError
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.engine.leaps import awaiting
from rsoconsole.orbits import KnownOrbit
from rsoconsole.orbits.motion.forces import ZonalPropagator
from rsoconsole.pipeline import (
    AwaitedPass,
    awaited_pass,
    expected_position,
    measured_pass_offset,
    next_awaited_pass,
)
from rsoconsole.records import Event, SlewCommand
from rsoconsole.simulator import elements_path
from rsoconsole.sky import Limits, icrs_to_altaz, separation_deg
from rsoconsole.words import NS_PER_S
from tests.rigs.engine_rig import Rig
from tests.rigs.leap_rig import config_with, leap_rig, orbit_over
from tests.tiers import plain_first
from tests.truth.low_passes import SITE, are_there, in_true_sense, low_passes, streak_of

MAX_S = 30.0
HELD = Limits(
    SITE, Config().limits.model_copy(update={"max_hour_angle_deg": 180.0}), Config().mount
)
BY_DAY = ("Sun", "twilight")
needs_passes = pytest.mark.skipif(not are_there(), reason="no element sets beside the project")


def waited_for(one, sigma_s=10.0) -> AwaitedPass:
    found = waited_on(one, one.rise_utc_ns - 600 * NS_PER_S, sigma_s)
    assert found is not None
    return found


def waited_on(one, now_utc_ns, sigma_s=10.0) -> AwaitedPass | None:
    return awaited_pass(
        str(one.norad_id),
        one.satellite.position_gcrs,
        SITE,
        up_utc_ns=(one.rise_utc_ns, one.set_utc_ns),
        sigma_s=sigma_s,
        held=HELD,
        now_utc_ns=now_utc_ns,
        lifted=BY_DAY,
    )


def late_by(one, late_s):
    """The same satellite on the same orbit, so much later than its elements say."""
    late_ns = round(late_s * NS_PER_S)

    class Late:
        def astrometric_place(self, site, t_utc_ns):
            from rsoconsole.sky import astrometric_places

            def states(t):
                return one.satellite.position_gcrs(t - late_ns)

            return astrometric_places(states, site, t_utc_ns)

    return replace(one, satellite=Late())


@pytest.mark.shared_data
@needs_passes
@pytest.mark.parametrize("late_s", [-20.0, 0.0, 20.0])
def test_early_or_late_it_comes_through_the_middle_of_the_field(late_s) -> None:
    """20 passes; within 10 arcmin of where it is stared at, however late."""
    told = 0
    for one in low_passes(30)[:20]:
        try:
            awaited = waited_for(one)
        except AssertionError:
            continue  # in shadow all the time
        told += 1
        stare = awaited.stare
        at = stare.t_through_utc_ns + round(late_s * NS_PER_S)
        assert stare.from_utc_ns <= at <= stare.until_utc_ns
        place = expected_position(awaited, SITE, at, late_s)
        off_deg = separation_deg(*place.direction_deg, *stare.direction_deg(SITE, at))
        assert off_deg < 10.0 / 60.0
    assert told >= 10


@pytest.mark.shared_data
@needs_passes
@pytest.mark.parametrize("late_s", [-25.0, -3.0, 0.4, 18.0])
def test_the_first_streak_says_how_late_it_is_and_how_far_across(late_s) -> None:
    random = np.random.default_rng(8)
    told = 0
    for one in low_passes(30)[:12]:
        try:
            awaited = waited_for(one)
        except AssertionError:
            continue
        late = late_by(one, late_s)
        t = awaited.stare.t_through_utc_ns + round(late_s * NS_PER_S)
        drawn = streak_of(late, t, random)
        found = measured_pass_offset(awaited, SITE, drawn)
        assert found is not None
        assert found[0].late_s == pytest.approx(late_s, abs=0.1)
        assert abs(found[0].across_arcmin) < 0.5
        assert found[1].ra_icrs_deg == pytest.approx(in_true_sense(late, drawn).ra_icrs_deg)
        told += 1
    assert told >= 6


@pytest.mark.shared_data
@needs_passes
def test_what_goes_another_way_is_not_the_one_that_is_waited_for() -> None:
    one = next(each for each in low_passes(30) if _is_awaited(each))
    awaited = waited_for(one)
    drawn = streak_of(one, awaited.stare.t_through_utc_ns, np.random.default_rng(2))
    ra, dec = drawn.ra_icrs_deg, drawn.dec_icrs_deg
    middle = (float(np.mean(ra)), float(np.mean(dec)))
    east = (ra - middle[0]) * np.cos(np.radians(middle[1]))
    north = dec - middle[1]
    turned = replace(
        drawn,
        ra_icrs_deg=middle[0] - north / np.cos(np.radians(middle[1])),
        dec_icrs_deg=middle[1] + east,
    )
    assert measured_pass_offset(awaited, SITE, drawn) is not None
    assert measured_pass_offset(awaited, SITE, turned) is None


def _is_awaited(one) -> bool:
    try:
        waited_for(one)
    except AssertionError:
        return False
    return True


@pytest.mark.shared_data
@needs_passes
def test_the_next_pass_of_a_catalogued_one_is_found_where_it_may_be_looked_at() -> None:
    one = low_passes(30)[3]
    entry = one.satellite.element_set
    limits = Config().limits
    found = next_awaited_pass(
        entry,
        SITE,
        one.rise_utc_ns - 3_600 * NS_PER_S,
        limits=limits,
        held=HELD,
        late_sigma_s=10.0,
        lifted=BY_DAY,
    )
    assert found is not None
    for t in (found.stare.from_utc_ns, found.stare.t_through_utc_ns, found.stare.until_utc_ns):
        altitude, _ = icrs_to_altaz(SITE, *found.stare.direction_deg(SITE, t), t)
        assert altitude >= limits.min_altitude_deg


# --- the engine


def words(r: Rig) -> list[str]:
    return [event.text for event in r.memory.of(Event)]


@pytest.mark.parametrize(
    "late_s",
    plain_first(1, [-20.0, 20.0, 0.0], "simulates one more night"),
)
def test_elements_that_are_20_s_wrong_are_found_and_it_is_followed(late_s, monkeypatch) -> None:
    true = orbit_over(heading_deg=50.0, after_s=400.0)
    epoch_ns = true.epoch_utc_ns
    told = KnownOrbit(
        epoch_utc_ns=epoch_ns - round(late_s * NS_PER_S),
        r_km=true.r_km,
        v_km_s=true.v_km_s,
        covariance=true.covariance,
        forces=ZonalPropagator(epoch_utc_ns=epoch_ns - round(late_s * NS_PER_S)),
    )
    config = config_with(leap={"pass_norad": 1, "late_sigma_s": 10.0})
    r = leap_rig(true, config)
    monkeypatch.setattr(awaiting, "load_awaited_elements", lambda _config: None)

    def next_pass(_entry, site, now_utc_ns, *, held, lifted, **_):
        return awaited_pass(
            "it",
            told.states,
            site,
            up_utc_ns=(told.epoch_utc_ns - 60 * NS_PER_S, told.epoch_utc_ns + 100 * NS_PER_S),
            sigma_s=10.0,
            held=held,
            now_utc_ns=now_utc_ns,
            lifted=lifted,
        )

    monkeypatch.setattr(awaiting, "next_awaited_pass", next_pass)
    r.engine.arm()
    r.engine.run(frames=50)
    said = words(r)
    assert any(text.startswith("waits for it, which comes by at") for text in said)
    begun = next(text for text in said if text.startswith("it comes "))
    figure = float(begun.split()[2]) * (1.0 if " late" in begun else -1.0)
    assert figure == pytest.approx(late_s, abs=0.2)
    assert sum(text.startswith("leap ") and " met:" in text for text in said) >= 12
    slews = r.memory.of(SlewCommand)
    assert any(slew.reason == "await" for slew in slews)


@pytest.mark.nightly("one more night")
def test_the_next_pass_of_what_was_leapt_after_is_waited_for_where_asked() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"waits": True}))
    r.engine.arm()
    r.engine.run(frames=75)
    said = words(r)
    ended = next(n for n, text in enumerate(said) if text.startswith("its next pass: "))
    waits = [text for text in said[ended:] if text.startswith("waits for it, which comes by at")]
    assert len(waits) == 1
    rise = said[ended].split()[3][:16]
    assert waits[0].split()[7][:13] == rise[:13]


def test_a_number_without_elements_is_refused_before_anything_moves(tmp_path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("")
    belt = str(elements_path())
    said = CliRunner().invoke(
        app, ["engine", "--pass", "25544", "--tle", belt, "--config", str(config)]
    )
    assert isinstance(said.exception, OrbitError)
    assert "no elements of 25544 in" in str(said.exception)


def lit_pass():
    """The first of them that the Sun shines on where it may be waited for."""
    for one in low_passes(30):
        with contextlib.suppress(AssertionError):
            return one, waited_for(one)
    raise AssertionError("none is lit")


@pytest.mark.shared_data
@needs_passes
def test_a_window_that_has_begun_is_not_waited_for_again() -> None:
    """The telescope is there before it may come, however late in the window it is asked for."""
    one, awaited = lit_pass()
    stare = awaited.stare
    for now_ns in (stare.from_utc_ns + 1, stare.t_through_utc_ns, stare.until_utc_ns + NS_PER_S):
        later = waited_on(one, now_ns)
        assert later is None or later.stare.from_utc_ns >= now_ns


@pytest.mark.shared_data
@needs_passes
def test_a_streak_like_its_own_hours_before_is_another_one() -> None:
    one, awaited = lit_pass()
    own = streak_of(one, awaited.stare.t_through_utc_ns, np.random.default_rng(3))
    assert measured_pass_offset(awaited, SITE, own) is not None
    hours_ns = 3 * 3600 * NS_PER_S
    before = replace(
        own,
        t_open_utc_ns=own.t_open_utc_ns - hours_ns,
        t_close_utc_ns=own.t_close_utc_ns - hours_ns,
    )
    assert measured_pass_offset(awaited, SITE, before) is None
