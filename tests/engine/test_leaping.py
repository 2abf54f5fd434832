"""The engine that stares and leaps: caught, followed to the end, given up, and left alone."""

import numpy as np
import pytest

from rsoconsole.cli.judge.summary import leap_figures
from rsoconsole.records import Event, FrameTaken, LeapDone, LowPass, ParameterChange, SlewCommand
from rsoconsole.sky import altaz_to_icrs, icrs_to_altaz, iso_to_utc_ns, separation_deg
from tests.makers import NS, T0_UTC_NS
from tests.rigs import engine_rig
from tests.rigs.engine_rig import SITE, Rig
from tests.rigs.leap_rig import config_with, leap_rig, orbit_over


def run(r: Rig, frames: int) -> Rig:
    r.engine.arm()
    r.engine.run(frames=frames)
    return r


def words(r: Rig) -> list[str]:
    return [event.text for event in r.memory.of(Event)]


def leaps(r: Rig) -> list[SlewCommand]:
    return [slew for slew in r.memory.of(SlewCommand) if slew.reason == "leap"]


def met(r: Rig) -> int:
    return sum(text.startswith("leap ") and " met:" in text for text in words(r))


@pytest.fixture(scope="module")
def followed() -> Rig:
    """A satellite at 600 km that goes north-east, and some frames after it has set.

    Here alone its track has an orbit too, as on every night.
    """
    return run(leap_rig(orbit_over(heading_deg=50.0), config_with(orbit={"online": True})), 75)


@pytest.mark.slow("follows a whole pass, for eight other tests too")
def test_it_is_caught_in_a_stare_and_met_at_leap_after_leap(followed) -> None:
    said = words(followed)
    assert any(text.startswith("stares for low satellites") for text in said)
    begun = next(n for n, text in enumerate(said) if text.startswith("a low satellite,"))
    assert said[begun + 1].startswith("up to ")
    planned = int(said[begun + 1].split()[2])
    assert planned > 15
    assert met(followed) >= 0.9 * planned
    assert met(followed) >= 0.95 * len(leaps(followed))


def test_both_ends_are_in_the_frame_of_every_leap(followed) -> None:
    first = leaps(followed)[0].frame_id + 1
    count = len(leaps(followed))
    of_leaps = [is_in for frame, is_in in followed.reducer.in_frame if frame >= first][:count]
    assert np.mean(of_leaps) >= 0.97
    lengths = [each.exposure_s for each in followed.memory.of(FrameTaken) if each.frame_id >= first]
    assert max(lengths) <= 1.0


def test_it_ends_at_the_limit_with_an_orbit_and_its_next_pass(followed) -> None:
    last = leaps(followed)[-1]
    altitude, _ = icrs_to_altaz(SITE, last.ra_icrs_deg, last.dec_icrs_deg, last.t_aim_utc_ns)
    assert 15.0 <= altitude < 22.0
    said = words(followed)
    orbit = next(text for text in said if text.startswith("its orbit: "))
    assert float(orbit.split()[2]) == pytest.approx(600.0, abs=25.0)
    expected = next(text for text in said if text.startswith("its next pass: "))
    rise_ns = iso_to_utc_ns(expected.split()[3])
    sigma_s = float(expected.split("± ")[1].split()[0])
    truth = altitudes(followed, rise_ns)
    assert np.min(np.abs(truth - 15.0)) < 0.2  # rises about then, within three sigma
    assert 0.0 < sigma_s < 5.0


def altitudes(r: Rig, about_ns: int) -> np.ndarray:
    from rsoconsole.sky import astrometric_places

    t = about_ns + (np.arange(-12, 13) * NS).astype(np.int64)
    places = astrometric_places(r.reducer.orbit.states, SITE, t)
    return np.asarray(icrs_to_altaz(SITE, places.ra_icrs_deg, places.dec_icrs_deg, t)[0])


def test_what_a_leap_took_is_told_by_part(followed) -> None:
    told = next(text for text in words(followed) if "a leap took" in text)
    parts = (part.rsplit(" ", 1) for part in told.split("s: ")[-1].split(", "))
    figures = {name: float(value) for name, value in parts}
    assert set(figures) == {"slew", "settle", "shutter", "exposure", "read-out", "wait"}
    assert figures["settle"] == 1.0
    # The camera reads out on the way to the next place.
    assert figures["read-out"] == 0.0
    assert figures["shutter"] + figures["wait"] <= 0.5


def test_a_leap_that_waits_for_its_frame_says_what_that_costs() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"at_close": False}))
    r.reducer.blind = set(range(20, 60))  # it is given up then
    run(r, 26)
    told = next(text for text in words(r) if "a leap took" in text)
    spent_s = 0.4 + r.engine.config.indi.simulated_latency_s
    assert float(told.split("read-out ")[1].split(",")[0]) == pytest.approx(spent_s, abs=0.1)
    assert float(told.split("wait ")[1]) <= 0.5


def test_afterwards_it_stares_where_it_stared_before(followed) -> None:
    frames = followed.memory.of(FrameTaken)
    stare = followed.memory.of(SlewCommand)[-1]
    assert stare.reason == "stare"
    first_ns, last_ns = frames[0].t_start_utc_ns, stare.t_aim_utc_ns
    before = icrs_to_altaz(SITE, *engine_rig.START_DEG, first_ns)
    after = icrs_to_altaz(SITE, stare.ra_icrs_deg, stare.dec_icrs_deg, last_ns)
    assert separation_deg(before[1], before[0], after[1], after[0]) < 0.2


def test_exposures_are_on_record_as_what_they_are(followed) -> None:
    changes = [c for c in followed.memory.of(ParameterChange) if c.by == "the leaps"]
    assert changes
    assert all(c.name == "exposure.exposure_s" for c in changes)


def test_the_slews_of_the_night_are_learned(followed) -> None:
    motion = followed.engine.leaping.telescope().motion
    assert motion.slews > 15
    assert motion.slew_s((5.0, 0.0)) == pytest.approx(2.0 * np.sqrt(5.0 / 2.0), abs=0.3)


@pytest.mark.parametrize("heading_deg", [2.0, 358.0])
def test_across_the_poles_either_sense_is_tried(heading_deg) -> None:
    """Half of them begin in the wrong one: the first leap is missed, a later one met."""
    r = run(leap_rig(orbit_over(heading_deg)), 20)
    assert met(r) >= 10


def test_a_sense_that_leads_below_the_limit_does_not_end_it() -> None:
    """It climbs out of the lowest part of the sky: the other sense would set at once."""
    low = altaz_to_icrs(SITE, 19.0, 180.0, T0_UTC_NS)
    r = leap_rig(orbit_over(358.0, through_deg=low))
    r.mount.at_deg = low
    run(r, 18)
    assert met(r) >= 8


def test_what_goes_into_the_earths_shadow_is_told_so() -> None:
    """Southward, some 50 s after it was caught; one leap finds it gone."""
    r = leap_rig(orbit_over(178.0))
    r.reducer.is_eclipsed = True
    run(r, 30)
    said = words(r)
    assert any(text.startswith("it has gone into the Earth's shadow: ") for text in said)
    assert not any("leap missed" in text for text in said)
    assert met(r) >= 6
    rest = next(text for text in said if text.startswith("by its orbit up to "))
    assert rest.endswith("; then: the shadow of the Earth")


def test_the_rest_of_a_pass_is_planned_again_by_its_orbit(followed) -> None:
    """One streak tells badly how long it lasts; six tell it to a leap in ten."""
    said = words(followed)
    (at, rest), *_ = [
        (n, text) for n, text in enumerate(said) if text.startswith("by its orbit up to ")
    ]
    more = int(rest.split()[5])
    left = sum(" met:" in text for text in said[at:])
    assert left == pytest.approx(more, rel=0.1)
    assert "; then: altitude" in rest


def test_what_looks_like_an_aircraft_on_its_way_is_met_and_begins_nothing() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.like_aircraft = set(range(14, 60))  # it has begun by then
    run(r, 24)
    assert met(r) >= 15
    assert not any("leap missed" in text for text in words(r))
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.like_aircraft = set(range(60))
    run(r, 20)
    assert not any(text.startswith("leap ") for text in words(r))


def test_a_first_streak_that_was_a_flash_leads_on_all_the_same() -> None:
    """A tenth of its light was not there: it is faster than that says."""
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.first_shows = 0.9
    run(r, 24)
    assert met(r) >= 17
    assert sum("leap missed" in text for text in words(r)) <= 1


def test_a_first_streak_that_the_next_contradicts_is_not_clung_to() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.first_turned_deg = 7.0
    run(r, 28)
    assert [(each.streaks, each.ended) for each in r.memory.of(LowPass)[:1]] == [
        (1, "its next streak says otherwise")
    ]
    assert r.memory.of(LeapDone)[0].result == "another streak"
    assert met(r) >= 20


def test_a_few_blind_frames_cost_leaps_and_not_the_satellite() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.blind = {14, 15, 20}
    r.reducer.unsolved = {24}
    run(r, 31)
    said = words(r)
    assert any("leap missed (2 of 4)" in text for text in said)
    assert not any(text.startswith("given up") for text in said)
    assert met(r) >= 20


def test_what_is_not_seen_again_is_given_up() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.blind = set(range(12, 60))
    run(r, 24)
    assert any(text.startswith("given up") for text in words(r))
    assert r.memory.of(SlewCommand)[-1].reason == "stare"


def test_a_hold_keeps_the_mount_where_it_is() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=14)
    before = len(r.mount.slews)
    assert r.engine.leaping.track is not None
    engine_rig.told(engine_rig.command_handler_of(r), "hold", {})
    r.engine.run(frames=20)
    assert len(r.mount.slews) <= before + 1


def test_disarmed_it_leaps_no_more() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=14)
    engine_rig.told(engine_rig.command_handler_of(r), "disarm", {})
    r.engine.run(frames=14)
    engine_rig.end_when_idle(r)
    r.engine.run(None)
    assert r.engine.leaping.track is None
    # The night's own exposure is there again, for the next look and for moves by hand.
    assert r.engine.config.exposure.exposure_s == config_with().exposure.exposure_s
    by = [each.by for each in r.memory.of(ParameterChange)]
    assert by[-1] == "the end of the leaps"


def test_without_the_setting_nothing_leaps() -> None:
    r = run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"enabled": False})), 8)
    assert not leaps(r)


def test_leaps_begin_and_end_with_a_setting_that_the_console_can_change() -> None:
    """Ended, they leave the night its own exposure; begun again, they stare once more."""
    r = leap_rig(
        orbit_over(heading_deg=50.0), config_with(exposure={"exposure_s": 1.5, "automatic": False})
    )
    command_handler = engine_rig.command_handler_of(r)
    r.engine.arm()
    r.engine.run(frames=16)
    assert r.engine.config.exposure.exposure_s < 1.0
    off = engine_rig.told(command_handler, "set", {"name": "leap.enabled", "value": "false"})
    assert off.ok, off.message
    r.engine.run(frames=18)
    assert r.engine.config.exposure.exposure_s == 1.5
    assert r.engine.leaping.track is None
    count = len(leaps(r))
    r.engine.run(frames=20)
    assert len(leaps(r)) == count


def test_a_number_without_elements_is_said_and_the_telescope_stares() -> None:
    r = run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"pass_norad": 25544})), 12)
    said = words(r)
    assert sum(text.startswith("nothing is waited for: no elements of 25544") for text in said) == 1
    assert met(r) >= 1


def test_a_stare_longer_than_a_second_is_judged_until_its_end_and_not_refused() -> None:
    """The limits were asked for a second after the order, before such an exposure is half over."""
    r = run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"stare_exposure_s": 2.0})), 6)
    assert not any("stares where it stands" in text for text in words(r))


def test_what_the_operator_sets_holds_where_the_leaps_end() -> None:
    r = leap_rig(
        orbit_over(heading_deg=50.0), config_with(exposure={"exposure_s": 1.5, "automatic": False})
    )
    r.engine.arm()
    r.engine.run(frames=14)
    command_handler = engine_rig.command_handler_of(r)
    assert engine_rig.told(command_handler, "set", {"name": "exposure.exposure_s", "value": 3.0}).ok
    r.engine.run(frames=18)
    assert engine_rig.told(command_handler, "set", {"name": "leap.enabled", "value": "false"}).ok
    r.engine.run(frames=22)
    assert r.engine.config.exposure.exposure_s == 3.0


def test_a_pass_is_on_record_with_its_orbit_and_when_it_comes_again(followed) -> None:
    r = followed
    [found] = r.memory.of(LowPass)
    done = r.memory.of(LeapDone)
    assert found.begun_frame_id == done[0].begun_frame_id
    assert found.streaks == met(r) + 1
    assert found.planned_leaps > 15
    assert "altitude" in found.ended
    assert found.a_km == pytest.approx(6978.0, abs=25.0)
    assert np.shape(found.covariance) == (6, 6)
    assert found.across_rms_arcsec is not None
    assert found.across_rms_arcsec < 3.0
    assert any(text.startswith("its next pass") for text in words(r)) == (
        found.t_next_rise_utc_ns is not None
    )
    figures = leap_figures(done, [found])
    assert figures is not None
    assert figures["met"] == met(r)
    assert figures["passes"][0]["leaps_met"] == met(r)
