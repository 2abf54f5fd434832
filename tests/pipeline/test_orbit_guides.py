"""The whole loop after a satellite that no straight line follows: found, lost in shadow, found."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline import Reduction, direction_at, replay
from rsoconsole.pipeline.tuning._propose_likelihood import innovations, replayed_tracks
from rsoconsole.records import (
    Event,
    Frame,
    Identified,
    Measurement,
    OrbitEstimate,
    SlewCommand,
    StateChange,
    TrackState,
)
from rsoconsole.sky import hour_angle_icrs_deg, icrs_of_hour_angle, separation_deg
from rsoconsole.tracking import Following
from tests.makers import NS, T0_UTC_NS, geo_measurement
from tests.pipeline.test_orbit_online import INCLINED, SITE, TLE, flight, measured_at
from tests.rigs.engine_rig import Rig, rig
from tests.rigs.rewritten import rewrite_log
from tests.truth.orbit_truth import Flight

HIDDEN = range(24, 64)
"""Twenty minutes: the filter gives up before they are over."""
FIELD_DEG = 0.6


def night(frames: int, **sections: Any) -> Rig:
    """The telescope stands where the satellite comes by, and sees it only within its field."""
    config = Config.model_validate(
        {
            "site": SITE,
            "search": {"pattern": "stay", "recentre": "every"},
            "filter": {"max_coast_s": 300, "preset": "tuned"},
            **sections,
        }
    )
    it = rig(set(), config)
    true = flight(*INCLINED, t0_utc_ns=T0_UTC_NS)
    start = true.places(np.array([20.0]))[0]
    it.mount.at_deg = (float(start.ra_icrs_deg[0]), float(start.dec_icrs_deg[0]))
    it.engine.cycle._reducer = Looking(it, true)
    it.engine.arm()
    it.engine.run(frames=frames)
    return it


class Looking:
    """Sees the satellite where it is, if the telescope looks there and it is not in shadow."""

    def __init__(self, it: Rig, true: Flight) -> None:
        self.plain, self.it, self.true = it.reducer, it, true
        self.random = np.random.default_rng(5)
        self.off_deg: list[float] = []

    def configure(self, config: Config) -> None:
        self.plain.configure(config)

    def forget_plate(self) -> None:
        pass

    def reduce(self, frame: Frame) -> Reduction:
        assert frame.t_mid_utc_ns is not None
        places = self.true.places(np.array([(frame.t_mid_utc_ns - T0_UTC_NS) / NS]))[0]
        here = (float(places.ra_icrs_deg[0]), float(places.dec_icrs_deg[0]))
        self.off_deg.append(separation_deg(*here, *self.it.mount.at_deg))
        plain = self.plain.reduce(frame)
        if self.off_deg[-1] > FIELD_DEG or frame.frame_id in HIDDEN:
            return plain
        measured = measured_at(places, 0, frame.frame_id, self.random, 0.5)
        measured = dataclasses.replace(measured, t_mid_utc_ns=frame.t_mid_utc_ns)
        return dataclasses.replace(plain, measurements=(measured,))


@pytest.fixture(scope="module")
def whole() -> Rig:
    """A night with a loss in it, to look at."""
    return night(80, catalogue={"tle_files": [str(TLE)]})


@pytest.mark.slow("a night of eighty frames")
def test_a_satellite_on_an_inclined_orbit_is_followed_through_a_loss(whole):
    it = whole
    states = [change.after for change in it.memory.of(StateChange)]
    assert states == ["SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST", "SEARCH", "ACQUIRE", "TRACK"]
    slews = it.memory.of(SlewCommand)
    assert {"orbit", "where its orbit says"} <= {slew.reason for slew in slews}
    # Also while nothing was seen the telescope looked at it.
    looking = it.engine.cycle._reducer
    assert max(looking.off_deg[10:]) < 0.05
    # Two tracks, each begun by two measurements, are one orbit.
    begun = [r for r in it.memory.of(TrackState) if r.kind == "initial"]
    updated = [r for r in it.memory.of(TrackState) if r.kind == "updated"]
    assert len(begun) == 2
    assert it.memory.of(OrbitEstimate)[-1].observations == 2 * len(begun) + len(updated)
    said = [event.text for event in it.memory.of(Event)]
    assert any("it is what was followed before" in words for words in said)
    assert it.memory.of(Identified)[-1].verdict == "unknown"


TRIED = (
    *(("filter.q_multiplier", value) for value in (1.1, 100.0)),
    ("filter.r_multiplier", 1.2),
    ("detector.tau", 0.99),
)


def test_a_replay_hands_over_as_the_night_did_and_another_night_has_no_orbit_of_that_one(whole):
    it = whole
    config = it.engine.config
    replayed = list(replay(it.memory.records, config))
    assert all(each.is_as_recorded for each in replayed)
    handed = [r for each in replayed for r in each.records if is_by_orbit(r)]
    assert len(handed) >= 2
    log = tuple((T0_UTC_NS, record) for record in it.memory.records)
    assert rewrite_log(log, config).log == log
    for name, value in TRIED:
        other = rewrite_log(log, config, changes={name: value})
        first = next(each.taken.frame_id for each in other.frames if not each.is_as_recorded)
        records = [record for _, record in other.log]
        assert all(r.frame_id < first for r in records if isinstance(r, OrbitEstimate))
        assert all(r.frame_id <= first for r in records if is_by_orbit(r))
        said = [r for r in records if isinstance(r, Event) and "orbit" in r.text]
        assert all(event.frame_id is not None and event.frame_id < first for event in said)
        again = list(replay(records, other.config))
        assert all(each.is_as_recorded for each in again), (name, value)


def test_what_is_looked_for_again_is_looked_for_by_its_orbit():
    it = night(40, filter={"max_coast_s": 3600})
    engine, at = it.engine, it.clock.t_utc_ns + 2400 * NS
    true = it.engine.cycle._reducer.true.places(np.array([(at - T0_UTC_NS) / NS]))[0]
    it.clock.t_utc_ns = at
    place = (float(true.ra_icrs_deg[0]), float(true.dec_icrs_deg[0]))
    assert separation_deg(*engine.seeking.direction(), *place) < 0.1
    by_filter = direction_at(engine.last_track, at)
    assert separation_deg(*by_filter, *place) > 0.5


@pytest.mark.nightly("one more night")
def test_with_the_papers_preset_a_lost_one_is_searched_for_as_ever():
    ours, never = (
        night(48, filter={"preset": "paper", "max_coast_s": 300}, orbit={"guide": guide})
        for guide in ("when better", "never")
    )
    assert ours.memory.of(SlewCommand) == never.memory.of(SlewCommand)
    assert len(ours.memory.of(OrbitEstimate)) == len(never.memory.of(OrbitEstimate))


def test_a_proposal_knows_where_the_filter_was_begun_again():
    it = night(24)
    frames = list(replay(it.memory.records, it.engine.config))
    by_orbit = [r for each in frames for r in each.records if is_by_orbit(r)]
    assert by_orbit
    found = innovations(replayed_tracks(frames), {})
    assert found is not None
    recorded = [
        r.nis
        for each in frames
        for r in each.records
        if isinstance(r, TrackState) and r.nis is not None and not is_by_orbit(r)
    ]
    assert list(found.nis) == pytest.approx(recorded)


def test_a_stranger_seen_while_a_lost_one_is_waited_for_is_waited_for_where_it_was_seen():
    it = night(42)
    planner, engine = it.engine.planner, it.engine
    assert planner._is_waiting
    here = it.mount.at_deg
    report = it.mount.report()
    now_ns = it.clock.t_utc_ns
    lost = engine.guide.lost_track_direction(now_ns)
    assert lost is not None
    stranger = measured_place(lost[0] + 0.3, lost[1] + 0.2, now_ns)
    assert not engine.guide.may_be_lost_object(stranger)
    plan = planner.plan(Following(state="ACQUIRE", candidates=(stranger,)), now_ns)
    assert plan.slew is not None
    assert plan.slew.reason == "wait for a second frame"
    same = icrs_of_hour_angle(
        engine.config.site.to_site(),
        hour_angle_icrs_deg(engine.config.site.to_site(), *here, report.t_utc_ns),
        plan.slew.dec_icrs_deg,
        plan.t_mid_utc_ns,
    )
    assert separation_deg(plan.slew.ra_icrs_deg, plan.slew.dec_icrs_deg, *same) < 0.3
    itself = measured_place(lost[0] + 0.001, lost[1], now_ns)
    planner._search.return_to_round()
    plan = planner.plan(Following(state="ACQUIRE", candidates=(itself,)), now_ns)
    assert plan.slew is not None
    assert plan.slew.reason == "where its orbit says"


def measured_place(ra_deg: float, dec_deg: float, t_utc_ns: int) -> Measurement:
    return dataclasses.replace(
        geo_measurement(2), ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg, t_mid_utc_ns=t_utc_ns
    )


def is_by_orbit(record: Any) -> bool:
    return isinstance(record, TrackState) and record.foretold_by == "orbit"


def test_without_the_orbit_it_is_gone():
    it = night(70, orbit={"guide": "never"})
    states = [change.after for change in it.memory.of(StateChange)]
    assert states[-1] != "TRACK"
    looking = it.engine.cycle._reducer
    assert looking.off_deg[-1] > FIELD_DEG
