"""The orbit of what is followed, while it is followed: through losses, beside a failing filter."""

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.engine.aim.guide import Guide, PredictedPath
from rsoconsole.orbits import (
    KnownOrbit,
    PerturbedPropagator,
    orbit_from_record,
    osculating_elements,
    predict,
)
from rsoconsole.pipeline import FrameObservations, OnlineOrbit, Orbits, StarHistory, fold_frame
from rsoconsole.pipeline.cycle.predictor_scores import PredictorScores, Score
from rsoconsole.pipeline.orbits._naming import TrackIdentifier
from rsoconsole.pipeline.orbits.orbit_online import RefinedOrbit
from rsoconsole.records import (
    Detections,
    Event,
    FollowedAgain,
    FrameTaken,
    Identified,
    Measurement,
    NotFollowed,
    OrbitEstimate,
    TrackState,
)
from rsoconsole.sky import SkyPlaces, iso_to_utc_ns, separation_deg
from rsoconsole.tracking import REFUSED, Following
from tests.truth.orbit_cases import state_of
from tests.truth.orbit_truth import DAYTONA, Flight

T0_UTC_NS = iso_to_utc_ns("2023-06-22T04:00:00Z")
CADENCE_S = 30
SITE = {
    "latitude_deg": DAYTONA.latitude_deg,
    "longitude_deg": DAYTONA.longitude_deg,
    "elevation_m": DAYTONA.elevation_m,
}
GEO = (42_166.0, 3e-4, 0.05)
INCLINED = (42_166.0, 2e-2, 55.0)
MEO = (26_560.0, 5e-3, 55.0)


def config(**sections: Any) -> Config:
    return Config.model_validate({"site": SITE, **sections})


def flight(
    a_km: float,
    e: float,
    i_deg: float,
    *,
    ahead_deg: float = 0.0,
    t0_utc_ns: int = T0_UTC_NS,
) -> Flight:
    """Crosses the site's meridian as it begins, on its way up where it is inclined."""
    import erfa

    from rsoconsole.sky import jd_ut1

    sidereal = erfa.era00(*jd_ut1(t0_utc_ns)) + math.radians(DAYTONA.longitude_deg)
    up = math.radians(min(i_deg, 30.0))
    argument = math.asin(math.sin(up) / math.sin(math.radians(i_deg))) if i_deg > 1.0 else 0.0
    east = math.atan2(math.cos(math.radians(i_deg)) * math.sin(argument), math.cos(argument))
    node = float(sidereal) + math.radians(ahead_deg) - east
    start = state_of(a_km, e, math.radians(i_deg), (node, 0.0, argument))
    return Flight(t0_utc_ns=t0_utc_ns, start=np.concatenate(start)[None])


@dataclass
class Watched:
    """A telescope that sees what it is told, its filter, and the orbit beside it."""

    config: Config
    sigma_arcsec: float = 0.5
    slant_deg: float | None = None
    """Of streaks with errors of 2 arcsec along and 0.3 across; None: round ones."""
    bad_frames: tuple[int, ...] = ()
    following: Following = field(default_factory=Following)
    log: list[Any] = field(default_factory=list)
    refined: list[RefinedOrbit] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.orbit = OnlineOrbit(self.config)
        self.random = np.random.default_rng(7)
        self.stars = StarHistory()
        self.frame_id = 0

    def see(self, places: SkyPlaces, hidden: Iterable[int] = ()) -> None:
        """One frame at each of the places; nothing is seen in the hidden ones."""
        hidden = set(hidden)
        for n, t_utc_ns in enumerate(places.t_utc_ns):
            self.frame_id += 1
            measured = () if n in hidden else (self.measure(places, n),)
            taken = FrameTaken(
                frame_id=self.frame_id,
                name="",
                t_start_utc_ns=int(t_utc_ns) - 5 * 10**9,
                exposure_s=10.0,
                width_px=4656,
                height_px=3520,
                pointing_ra_icrs_deg=None,
                pointing_dec_icrs_deg=None,
            )
            empty = Detections(frame_id=self.frame_id, width_px=4656, height_px=3520, detections=())
            shown = FrameObservations(
                taken=taken,
                detections=empty,
                solution=None,
                measurements=measured,
                orbits={self.last.track_id: self.last} if self.refined else {},
            )
            folded = fold_frame(self.following, self.stars, shown, self.config)
            self.following, self.stars = folded.following, folded.stars
            for record in (*measured, *folded.records):
                self.receive(record)
            self.refined += self.orbit.refine()

    def receive(self, record: Any) -> None:
        self.log.append(record)
        self.orbit.receive(record)

    def measure(self, places: SkyPlaces, n: int) -> Measurement:
        measured = measured_at(places, n, self.frame_id, self.random, self.sigma_arcsec)
        if self.frame_id in self.bad_frames:
            return dataclasses.replace(measured, cov_sky_arcsec2=(1.0, 1.0, 1.0))
        if self.slant_deg is None:
            return measured
        c, s = math.cos(math.radians(self.slant_deg)), math.sin(math.radians(self.slant_deg))
        turned = np.array([[c, -s], [s, c]]) @ np.diag([2.0, 0.3])
        east, north = turned @ self.random.normal(0.0, 1.0, 2) / 3600.0
        dec = float(places.dec_icrs_deg[n]) + north
        (ee, en), (_, nn) = turned @ turned.T
        return dataclasses.replace(
            measured,
            ra_icrs_deg=float(places.ra_icrs_deg[n]) + east / math.cos(math.radians(dec)),
            dec_icrs_deg=dec,
            cov_sky_arcsec2=(float(ee), float(en), float(nn)),
        )

    @property
    def last(self) -> OrbitEstimate:
        return self.refined[-1].estimate

    @property
    def words(self) -> list[str]:
        return [event.text for each in self.refined for event in each.events]


def measured_at(
    places: SkyPlaces,
    n: int,
    frame_id: int,
    random: np.random.Generator,
    sigma_arcsec: float,
) -> Measurement:
    """A streak of ten seconds at the n-th place, with noise."""
    east, north = random.normal(0.0, sigma_arcsec / 3600.0, 2)
    dec = float(places.dec_icrs_deg[n]) + north
    ra = float(places.ra_icrs_deg[n]) + east / math.cos(math.radians(dec))
    d_ra, d_dec = (5.0 * float(r[n]) for r in (places.ra_rate_deg_s, places.dec_rate_deg_s))
    return Measurement(
        measurement_id=f"{frame_id}-0",
        frame_id=frame_id,
        t_mid_utc_ns=int(places.t_utc_ns[n]),
        ra_icrs_deg=ra % 360.0,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(sigma_arcsec**2, 0.0, sigma_arcsec**2),
        x_px=0.0,
        y_px=0.0,
        confidence=0.95,
        source="network",
        ends_icrs_deg=(((ra - d_ra) % 360.0, dec - d_dec), ((ra + d_ra) % 360.0, dec + d_dec)),
    )


def every_frame(one: Flight, frames: int, since_s: float = 0.0) -> SkyPlaces:
    return one.places(since_s + np.arange(frames) * float(CADENCE_S))[0]


def test_a_geostationary_satellite_has_an_orbit_from_its_third_direction_on_that_covers_the_truth():
    true = flight(*GEO)
    watched = Watched(config())
    watched.see(every_frame(true, 60), hidden=(20, 21, 40))
    assert [each.estimate.observations for each in watched.refined] == list(range(3, 58))
    assert watched.last.label == "constrained by prior"
    known_orbit = orbit_from_record(watched.last)
    day = true.places(np.array([86_400.0]))[0]
    ahead = predict(known_orbit, DAYTONA, day.t_utc_ns)
    off = separation_deg(
        float(ahead.places.ra_icrs_deg[0]),
        float(ahead.places.dec_icrs_deg[0]),
        float(day.ra_icrs_deg[0]),
        float(day.dec_icrs_deg[0]),
    )
    assert off * 3600.0 < 3.0 * float(ahead.sigma_arcsec[0])
    truth = osculating_elements(true.start[0][:3], true.start[0][3:])
    assert abs(watched.last.a_km - truth.a_km) < 3.0 * watched.last.sigma_a_km + 3.0
    # What it predicted is judged as the filter's predictions are.
    nis = [each.estimate.nis for each in watched.refined[5:]]
    told = [value for value in nis if value is not None]
    assert len(told) == len(nis)
    assert 1.0 < np.mean(told) < 3.2


def test_the_same_log_gives_the_same_orbits():
    watched = Watched(config())
    watched.see(every_frame(flight(*GEO), 20), hidden=(9,))
    again = OnlineOrbit(config())
    told = []
    for record in watched.log:
        again.receive(record)
        if isinstance(record, TrackState) and record.kind != "predicted":
            told += [refined.estimate for refined in again.refine()]
    assert told == [each.estimate for each in watched.refined]


@pytest.mark.parametrize("elements", [INCLINED, MEO], ids=["inclined", "navigation satellite"])
def test_where_the_filter_fails_the_orbit_takes_over_and_knows_where_it_is(elements):
    """Half an hour without a measurement: a line on the sky leads astray, an orbit does not."""
    true = flight(*elements)
    watched = Watched(config(filter={"max_coast_s": 3600, "preset": "tuned"}))
    watched.see(every_frame(true, 40))
    # The filter alone would have stood still at the fourth measurement; nothing was lost.
    assert watched.last.observations == 40
    assert any(isinstance(r, TrackState) and r.foretold_by == "orbit" for r in watched.log)
    assert watched.orbit.is_lead_orbit_preferred
    said = [each for each in watched.words if each.startswith("aims by the orbit from now on: ")]
    by_orbit = [
        each
        for each in watched.log
        if isinstance(each, TrackState) and each.kind == "updated" and each.foretold_by == "orbit"
    ]
    figures = [each.filter_nis for each in by_orbit if each.filter_nis is not None]
    assert figures
    assert min(figures) > watched.config.filter.gate_nis
    assert any(f"NIS {figures[0]:.1f} by that, gate 11.8" in each for each in said)
    later = true.places(np.array([40 * CADENCE_S + 1800.0]))[0]
    t = int(later.t_utc_ns[0])
    truth = (float(later.ra_icrs_deg[0]), float(later.dec_icrs_deg[0]))
    by_orbit = Guide(watched.orbit, watched.config).track_direction(t)
    assert by_orbit is not None
    from rsoconsole.pipeline import follow_direction

    track = watched.following.track
    assert track is not None
    by_filter = follow_direction(track, t, watched.config.filter)
    assert separation_deg(*by_orbit, *truth) * 60.0 < 1.0
    assert separation_deg(*by_filter, *truth) > 10.0 * separation_deg(*by_orbit, *truth)


LOW = (6_900.0, 1e-3, 51.6)


@pytest.mark.parametrize("elements", [GEO, INCLINED, MEO, LOW])
def test_between_the_places_of_a_way_one_may_interpolate(elements):
    start = flight(*elements).start[0]
    orbit = KnownOrbit(
        epoch_utc_ns=T0_UTC_NS,
        r_km=start[:3],
        v_km_s=start[3:],
        covariance=np.diag([1e-4] * 3 + [1e-10] * 3),
        forces=PerturbedPropagator(epoch_utc_ns=T0_UTC_NS),
    )
    way = PredictedPath.of(orbit, DAYTONA, T0_UTC_NS - 200 * 10**9)
    t = T0_UTC_NS - 200 * 10**9 + np.random.default_rng(3).integers(0, 890 * 10**9, 50)
    exact = predict(orbit, DAYTONA, t)
    for n, at in enumerate(t):
        (ra, dec), (east, north), sigma_deg = way.at(int(at))
        place = (float(exact.places.ra_icrs_deg[n]), float(exact.places.dec_icrs_deg[n]))
        # A low satellite in the zenith turns within seconds.
        assert separation_deg(ra, dec, *place) * 3600.0 < (20.0 if elements is LOW else 0.01)
        cos_dec = math.cos(math.radians(dec))
        assert east == pytest.approx(exact.places.ra_rate_deg_s[n] * cos_dec * 3600.0, rel=0.01)
        assert north == pytest.approx(exact.places.dec_rate_deg_s[n] * 3600.0, rel=0.01, abs=1.0)
        assert sigma_deg * 3600.0 == pytest.approx(exact.sigma_arcsec[n], rel=0.1)
    assert way.contains(int(t.max()))
    assert not way.contains(T0_UTC_NS + 3600 * 10**9)


def test_with_the_papers_preset_and_where_it_is_forbidden_the_filter_guides():
    for settings in ({"filter": {"preset": "paper"}}, {"orbit": {"guide": "never"}}):
        watched = Watched(config(**settings))
        watched.see(every_frame(flight(*MEO), 30))
        assert not watched.orbit.is_lead_orbit_preferred
        assert not any(each.estimate.is_guide for each in watched.refined)
        guide, soon = Guide(watched.orbit, watched.config), int(watched.last.epoch_utc_ns + 900e9)
        assert guide.track_direction(soon) is None
        assert guide.lost_track_direction(soon) is None
        assert guide.last_track_direction(soon) is None


def test_what_was_lost_is_waited_for_by_its_orbit_and_known_again_when_it_comes():
    true = flight(*INCLINED)
    watched = Watched(config(filter={"max_coast_s": 120}))
    watched.see(every_frame(true, 80), hidden=range(40, 60))
    lost = 60 * CADENCE_S
    place = every_frame(true, 1, lost)
    assert any("it is what was followed before" in words for words in watched.words)
    assert watched.last.observations == 60
    assert watched.last.arc_s == pytest.approx(79 * CADENCE_S)
    # Of what was seen before the loss alone.
    alone = Watched(config())
    alone.see(every_frame(true, 40))
    at = Guide(alone.orbit, alone.config).lost_track_direction(int(place.t_utc_ns[0]))
    assert at is not None
    truth = (float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0]))
    assert separation_deg(*at, *truth) * 3600.0 < 30.0
    wait_s = 60.0 * alone.config.orbit.wait_min + 1.0
    assert (
        Guide(alone.orbit, alone.config).lost_track_direction(int(place.t_utc_ns[0] + wait_s * 1e9))
        is None
    )


def test_streaks_that_no_track_took_are_its_orbits_once_that_knows_them():
    """Three of its own before the lock, each with a neighbour's 0.02 degrees beside it."""
    true = flight(*INCLINED)
    watched = Watched(config())
    for n in (0, 3, 6):
        early = every_frame(true, 1, since_s=n * CADENCE_S)
        own = measured_at(early, 0, 1000 + n, watched.random, 0.5)
        beside = dataclasses.replace(
            own, measurement_id=f"{own.measurement_id}b", dec_icrs_deg=own.dec_icrs_deg + 0.02
        )
        watched.receive(own)
        watched.receive(beside)
    watched.see(every_frame(true, 60, since_s=9 * CADENCE_S))
    assert watched.last.observations == 63
    assert watched.last.arc_s == pytest.approx((59 + 9) * CADENCE_S)
    told = [words for words in watched.words if "that no track took" in words]
    assert told
    assert sum(int(words.split()[0]) for words in told) == 3


def test_a_streak_that_the_operator_refused_is_no_orbits():
    true = flight(*INCLINED)
    watched = Watched(config())
    early = every_frame(true, 1)
    own = measured_at(early, 0, 1000, watched.random, 0.5)
    watched.receive(own)
    watched.receive(NotFollowed(frame_id=1000, measurement=own, reason=REFUSED))
    watched.see(every_frame(true, 30, since_s=3 * CADENCE_S))
    assert watched.last.observations == 30


def test_another_satellite_gets_an_orbit_of_its_own():
    watched = Watched(config(filter={"max_coast_s": 60}))
    watched.see(every_frame(flight(*GEO), 30))
    watched.see(every_frame(flight(*GEO, ahead_deg=3.0), 10, since_s=3600.0), hidden=range(5))
    other = every_frame(flight(*GEO, ahead_deg=3.0), 20, since_s=4200.0)
    watched.see(other)
    assert not any("followed before" in words for words in watched.words)
    assert watched.last.observations < 30


def test_a_neighbour_that_was_taken_for_what_was_followed_before_is_parted_from_it():
    """Five minutes each, four hours apart, a tenth of a degree: a dozen directions are no proof."""
    watched = Watched(config(filter={"max_coast_s": 60}), sigma_arcsec=2.0)
    watched.see(every_frame(flight(*GEO), 10))
    neighbour = flight(42_166.2, 2e-4, 0.03, ahead_deg=0.1)
    begin_s = 10 * CADENCE_S + 240 * 60.0
    watched.see(every_frame(neighbour, 1, since_s=begin_s - 60.0), hidden=(0,))
    watched.see(every_frame(neighbour, 60, since_s=begin_s))
    assert watched.last.observations == 60
    joined = [words for words in watched.words if "what was followed before" in words]
    assert not joined or joined[-1] == "it is not what was followed before, after all"


def test_a_join_that_was_wrong_is_undone(monkeypatch):
    watched = Watched(config(filter={"max_coast_s": 60}))
    said = iter([0.995, 0.8, 0.3])
    monkeypatch.setattr(OnlineOrbit, "_same", lambda *_: next(said, 0.0))
    watched.see(every_frame(flight(*GEO), 20))
    watched.see(every_frame(flight(*GEO), 50, since_s=1200.0), hidden=range(10))
    assert [words for words in watched.words if "before" in words] == [
        "it is what was followed before: probability 99.5 %",
        "it is not what was followed before, after all",
    ]
    assert watched.last.observations == 40


def test_the_order_behind_the_first_frame_of_another_track_is_the_filters():
    watched = Watched(config())
    watched.see(every_frame(flight(*MEO), 30))
    assert watched.orbit.is_lead_orbit_preferred
    track = watched.following.track
    assert track is not None
    # The engine orders the next exposure before the orbit hears of the frame.
    watched.orbit.receive(dataclasses.replace(track, kind="initial", frame_id=31, nis=None))
    assert not watched.orbit.is_lead_orbit_preferred
    assert Guide(watched.orbit, watched.config).track_direction(T0_UTC_NS + 910 * 10**9) is None


def test_a_measurement_that_is_no_direction_is_left_out_and_told_once():
    watched = Watched(config())
    watched.bad_frames = (12, 15)
    watched.see(every_frame(flight(*GEO), 25))
    assert watched.last.frame_id == 25
    assert watched.last.observations == 23
    assert sum("left out of the orbit" in words for words in watched.words) == 1


def test_a_slanting_streak_gives_neither_of_them_a_lead():
    """Correlated errors are as wide for the filter as they are for the orbit."""
    leads = []
    for angle_deg in (0.0, 45.0):
        watched = Watched(config(), slant_deg=angle_deg)
        watched.see(every_frame(flight(*GEO), 30))
        assert watched.orbit._lead is not None
        told = list(watched.orbit._lead.scores._scores)
        leads.append(np.mean([theirs.log_size - ours.log_size for ours, theirs in told]))
    # What each has learnt of its noise differs by chance.
    assert leads[1] == pytest.approx(leads[0], abs=0.5)


def test_the_operators_word_on_a_frame_changes_the_orbit():
    watched = Watched(config())
    places = every_frame(flight(*GEO), 20)
    watched.see(places)
    before = watched.last
    # He refuses the tenth: its frame is followed again, without it.
    frame_id = 10
    predicted = next(
        r
        for r in watched.log
        if isinstance(r, TrackState) and (r.frame_id, r.kind) == (frame_id, "predicted")
    )
    watched.receive(FollowedAgain(frame_id=frame_id))
    watched.receive(predicted)
    [refined] = watched.orbit.refine()
    assert refined.estimate.observations == before.observations - 1
    assert refined.estimate.nis is None, "nothing new was predicted"


def test_a_clock_that_was_set_ends_what_was_known():
    watched = Watched(config())
    watched.see(every_frame(flight(*GEO), 10))
    watched.orbit.forget()
    assert watched.orbit.lead_orbit is None
    assert watched.orbit.refine() == ()


def test_an_orbit_is_not_asked_for_where_it_is_not_wanted():
    watched = Watched(config(orbit={"online": False}))
    watched.see(every_frame(flight(*GEO), 10))
    assert not watched.refined


def test_who_foretells_better_is_no_matter_of_chance_or_of_big_words():
    sharp, vague = Score(nis=2.0, log_size=0.0), Score(nis=0.1, log_size=8.0)
    rivals = PredictorScores()
    leads = []
    for _ in range(8):
        rivals.add_scores(sharp, vague)
        leads.append(rivals.is_orbit_ahead)
    assert leads == [False] * 4 + [True] * 4
    wrong = Score(nis=40.0, log_size=-80.0)
    for _ in range(8):
        rivals.add_scores(wrong, vague)
    assert not rivals.is_orbit_ahead, "an orbit that is sure and wrong is not believed"
    alike = PredictorScores()
    for _ in range(20):
        alike.add_scores(sharp, Score(nis=2.2, log_size=0.0))
        assert not alike.is_orbit_ahead


@pytest.mark.parametrize(
    ("by_orbit_arcsec", "is_close"), [(1.0, True), (0.95, True), (0.5, False), (2.0, False)]
)
def test_what_promises_the_same_but_for_a_tenth_is_close(by_orbit_arcsec: float, is_close: bool):
    rivals = PredictorScores()
    assert not rivals.has_similar_sigmas
    for _ in range(6):
        by_filter = Score(nis=2.0, log_size=0.0)
        rivals.add_scores(Score(nis=2.0, log_size=4.0 * math.log(by_orbit_arcsec)), by_filter)
    assert rivals.has_similar_sigmas is is_close
    rivals.add_filter_failure(41.26, 11.83)
    assert not rivals.has_similar_sigmas
    assert rivals.words.endswith("the filter's prediction: NIS 41.3 by that, gate 11.8")


def recorded(settings: Config, places: SkyPlaces) -> list[Any]:
    watched = Watched(settings)
    watched.see(places)
    return put_on_record(settings, watched.log)


def put_on_record(settings: Config, log: Iterable[Any]) -> list[Any]:
    told: list[Any] = []
    orbits = Orbits(settings)
    for record in log:
        told.append(record)
        orbits.receive(record)
        if isinstance(record, TrackState) and record.kind != "predicted":
            told += orbits.derive_frame_records()
    return told


TLE = Path(__file__).parents[2] / "rsoconsole" / "simulator" / "data" / "belt_20230622.tle"


def test_what_is_followed_is_named_on_record_and_asked_for_more_rarely_as_it_goes_on():
    from rsoconsole.orbits import Satellite, parse_elements

    elements = next(e for e in parse_elements(TLE.read_text(), "belt") if e.norad_id == 36_097)
    t0 = iso_to_utc_ns("2023-06-23T05:00:00Z")
    t = t0 + np.arange(40) * CADENCE_S * 10**9
    places = Satellite(elements).astrometric_place(DAYTONA, t)
    records = recorded(config(catalogue={"tle_files": [str(TLE)]}), places)
    named = [each for each in records if isinstance(each, Identified)]
    assert [each.observations for each in named] == [3, 4, 6, 9, 14, 21, 32]
    assert {each.verdict for each in named} == {"identified"}
    best, runner_up, *_ = named[-1].matches
    assert (best.norad_id, best.name) == (36_097, "INTELSAT 14")
    assert best.separation_arcsec < 1.0
    assert runner_up.separation_arcsec > 3600.0
    # It moves as SGP4 has it: another hand than the orbit's forces.
    assert [e for e in records if isinstance(e, OrbitEstimate)][-1].label == "constrained by prior"


def test_a_catalogue_that_cannot_be_read_is_told_once_and_costs_no_orbit(tmp_path):
    settings = config(catalogue={"tle_files": [str(tmp_path / "gone.tle")]})
    records = recorded(settings, every_frame(flight(*GEO), 12))
    said = [e.text for e in records if isinstance(e, Event) and e.level == "warning"]
    assert len(said) == 1
    assert "gone.tle does not exist" in said[0]
    assert sum(isinstance(each, OrbitEstimate) for each in records) == 10


def test_an_orbit_that_breaks_is_told_once_and_the_night_goes_on(monkeypatch):
    def breaks(*_: Any, **__: Any) -> None:
        raise FloatingPointError("boom")

    places = every_frame(flight(*GEO), 12)
    watched = Watched(config())
    watched.see(places)
    monkeypatch.setattr("rsoconsole.pipeline.orbits.orbit_online.determine_orbit", breaks)
    records = put_on_record(config(), watched.log)
    said = [e.text for e in records if isinstance(e, Event)]
    assert said == ["its orbit could not be refined (boom): see the log"]


def test_new_files_are_asked_at_once(tmp_path):
    naming = TrackIdentifier(config())
    watched = Watched(config())
    watched.see(every_frame(flight(*GEO), 12))
    seen = watched.orbit.lead_directions
    assert seen is not None
    assert naming.identify_due_tracks(1, {1: seen}, {1}) == ()
    naming.configure(config(catalogue={"tle_files": [str(TLE)]}))
    (found,) = naming.identify_due_tracks(1, {1: seen}, {1})
    assert found.verdict == "unknown"
