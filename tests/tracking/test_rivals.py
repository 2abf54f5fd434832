"""Who else is in the field: nobody takes a track from what is followed, nor does it stand alone.

Truth is SGP4's; a neighbour and a rival are put beside it here, streaks with noise, some unseen,
and a shutter whose lateness all streaks of a frame share.
"""

import dataclasses
import functools
import math
from dataclasses import dataclass

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import follow_settings
from rsoconsole.pipeline.cycle.track_assignment import TrackAssignment
from rsoconsole.records import (
    FloatArray,
    FrameTaken,
    HiddenBy,
    Measurement,
    Missed,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import Following, FollowSettings, FrameInput, TangentPlane, follow
from rsoconsole.tracking._takeover import rival_odds
from rsoconsole.tracking.association.following import Rival
from rsoconsole.words import text
from tests.tiers import plain_first
from tests.tracking.test_bank import CADENCE_S, places_of
from tests.truth.seen_satellites import DAYTONA, T0_UTC_NS

FRAMES, EXPOSURE_S = 40, 10.0
NEAR_ARCSEC = 72.0
"""0.02 deg: the closest of a slot."""


@functools.cache
def config() -> Config:
    site = {
        "latitude_deg": DAYTONA.latitude_deg,
        "longitude_deg": DAYTONA.longitude_deg,
        "elevation_m": DAYTONA.elevation_m,
    }
    return Config.model_validate({"site": site})


@functools.cache
def every_day() -> FollowSettings:
    frame = FrameTaken(
        frame_id=0,
        name="",
        t_start_utc_ns=T0_UTC_NS,
        exposure_s=EXPOSURE_S,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    return follow_settings(config(), frame)


def instant(k: int) -> int:
    return T0_UTC_NS + round(k * CADENCE_S * 1e9)


@dataclass(frozen=True, kw_only=True)
class True_:  # noqa: N801
    """Where the one followed is at a frame, and how it moves (east, north, arcsec/s)."""

    ra_deg: float
    dec_deg: float
    rate: FloatArray


@functools.cache
def truth() -> tuple[True_, ...]:
    places = places_of("geostationary", (0.0,) * FRAMES)
    return tuple(
        True_(
            ra_deg=float(places.ra_icrs_deg[k]),
            dec_deg=float(places.dec_icrs_deg[k]),
            rate=3600.0
            * np.array(
                [
                    places.ra_rate_deg_s[k] * math.cos(math.radians(places.dec_icrs_deg[k])),
                    places.dec_rate_deg_s[k],
                ]
            ),
        )
        for k in range(FRAMES)
    )


def streak(  # noqa: PLR0917 -- of whom, where it is, how it moves
    k: int,
    name: str,
    random: np.random.Generator,
    away: FloatArray,
    rate: FloatArray,
    late_s: float,
) -> Measurement:
    """So far from the one followed (arcsec), moving so."""
    along = rate / np.linalg.norm(rate)
    cov = 0.6**2 * np.outer(along, along) + 0.2**2 * np.eye(2)
    place = away + rate * late_s + random.multivariate_normal(np.zeros(2), cov)
    plane = TangentPlane.at(truth()[k].ra_deg, truth()[k].dec_deg)
    half = 0.5 * EXPOSURE_S * rate
    ra, dec = plane.direction_of(*place)
    return Measurement(
        measurement_id=f"{k}-{name}",
        frame_id=k,
        t_mid_utc_ns=instant(k),
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])),
        x_px=0.0,
        y_px=0.0,
        # Two to four times as bright: anyone who goes by confidence takes the other one.
        confidence=0.95 if name == "ours" else 0.999,
        source="network",
        ends_icrs_deg=(plane.direction_of(*(place - half)), plane.direction_of(*(place + half))),
    )


def seen(k: int, *measurements: Measurement, absence: Missed | None = None) -> FrameInput:
    return FrameInput(
        frame_id=k,
        t_mid_utc_ns=instant(k),
        exposure_s=EXPOSURE_S,
        measurements=tuple(sorted(measurements, key=lambda m: -m.confidence)),
        absence=absence or Missed(kind="no detection"),
    )


def taken_of(following: Following, k: int) -> str | None:
    """Whose streak the lead took in a frame."""
    taken = following.lead_measured
    return taken.measurement_id.split("-")[1] if taken and taken.frame_id == k else None


def night(company: str, scatter_s: float, seed: int) -> tuple[int, int, int]:
    """Frames in which ours was seen after lock, in which it was taken, in which another was."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, 2.0 * math.pi)
    heading = np.array([math.cos(angle), math.sin(angle)])
    quick = random.uniform(0.6, 1.6)
    following, locked, there, took, wrong = Following(), "", 0, 0, 0
    for k in range(FRAMES):
        rate, late_s = truth()[k].rate, random.normal(0.0, scatter_s)
        shown = []
        if k < 2 or random.random() < 0.9:
            shown.append(streak(k, "ours", random, np.zeros(2), rate, late_s))
        if company == "neighbour" and random.random() < 0.9:
            drift = np.array([-heading[1], heading[0]]) * k * CADENCE_S / 60.0
            shown.append(streak(k, "other", random, NEAR_ARCSEC * heading + drift, rate, late_s))
        if company == "rival":
            other = quick * float(np.linalg.norm(rate)) * heading
            away = (other - rate) * CADENCE_S * (k - FRAMES / 2) + 15.0
            if np.hypot(*away) < 2500.0:
                shown.append(streak(k, "other", random, away, other, late_s))
        following, _ = follow(following, seen(k, *shown), every_day())
        taken = taken_of(following, k)
        locked = locked or taken or ""
        if not locked:
            continue
        there += any(m.measurement_id == f"{k}-{locked}" for m in shown)
        took += taken == locked
        wrong += taken not in {locked, None}
    return there, took, wrong


@pytest.mark.parametrize(
    "nights", [3, pytest.param(12, marks=pytest.mark.nightly("statistics over many nights"))]
)
@pytest.mark.parametrize("scatter_s", plain_first(1, [0.2, 0.015, 1.0]))
@pytest.mark.parametrize("company", ["nobody", "neighbour", "rival"])
def test_nobody_steals_the_track_and_it_holds(company: str, scatter_s: float, nights: int) -> None:
    there = took = 0
    for seed in range(nights):
        one, other, wrong = night(company, scatter_s, seed)
        there, took = there + one, took + other
        assert wrong <= 3, (company, scatter_s, seed)
    assert took / there >= 0.95


def test_a_track_begun_with_two_objects_is_begun_again_with_one() -> None:
    """In the first frame one of two neighbours is seen, in the second the other."""
    random = np.random.default_rng(1)
    following, told, taken, replaced = Following(), [], TrackAssignment(), []
    for k in range(12):
        rate = truth()[k].rate
        ours = streak(k, "ours", random, np.zeros(2), rate, 0.0)
        other = streak(k, "other", random, np.array([70.0, 20.0]), rate, 0.0)
        shown = {0: (ours,), 1: (other,)}.get(k, (ours,))
        following, records = follow(following, seen(k, *shown), every_day())
        told += [text(r.reason) for r in records if isinstance(r, StateChange)]
        replaced += [r.replaces for r in records if isinstance(r, TrackState) and r.replaces]
        for record in (*shown, *records):
            taken.receive(record)
        if told[-1].startswith("re-acquired"):
            # The orbit hears of it at once: the track that was given up leads nothing.
            assert [each.track_id for each in taken.live_tracks()] == [2]
    assert following.state == "TRACK"
    assert taken_of(following, 11) == "ours"
    again = [each for each in told if each.startswith("re-acquired")]
    assert len(again) == 1
    assert "arcsec from the prediction: 3 frames agree" in again[0]
    assert following.track_id == 2
    assert replaced == [1]  # on record once, with its first state


def test_a_track_begun_with_two_of_three_is_begun_again_with_one_of_them() -> None:
    """What stood beside the second of two streaks of two objects is no neighbour of either."""
    random = np.random.default_rng(2)
    places = {"a": (0.0, 0.0), "b": (70.0, 20.0), "c": (-160.0, 60.0)}
    following = Following()
    for k in range(12):
        rate = truth()[k].rate
        names = {0: "a", 1: "bc"}.get(k, "abc")
        shown = [streak(k, n, random, np.array(places[n]), rate, 0.0) for n in names]
        following, _ = follow(following, seen(k, *shown), every_day())
    assert following.state == "TRACK"
    assert following.track is not None
    assert following.track.innovations >= 4


def test_after_a_burn_it_is_re_acquired_and_the_record_says_by_how_much() -> None:
    random = np.random.default_rng(2)
    following, told, taken = Following(), [], []
    for k in range(30):
        rate, away = truth()[k].rate, np.zeros(2)
        if k >= 15:
            away = np.array([20.0, 40.0]) + np.array([0.1, 0.6]) * CADENCE_S * (k - 15)
            rate = rate + np.array([0.1, 0.6])
        ours = streak(k, "ours", random, away, rate, 0.0)
        following, records = follow(following, seen(k, ours), every_day())
        taken.append(taken_of(following, k))
        told += [text(r.reason) for r in records if isinstance(r, StateChange)]
    assert taken[1:15] == ["ours"] * 14
    assert taken[20:] == ["ours"] * 10
    assert sum(each.startswith("re-acquired") for each in told) <= 1


def hidden_and_another(absence: Missed | None, frames: int) -> Following:
    """Ours is gone after frame 20; another of the same motion stands beside from then on."""
    random = np.random.default_rng(3)
    following = Following()
    for k in range(20 + frames):
        if k < 20:
            shown = streak(k, "ours", random, np.zeros(2), truth()[k].rate, 0.0)
        else:
            shown = streak(k, "other", random, np.array([400.0, 300.0]), truth()[k].rate, 0.0)
        following, _ = follow(following, seen(k, shown, absence=absence), every_day())
    return following


def test_what_is_hidden_is_not_replaced_by_who_stands_beside() -> None:
    shadow = Missed(kind="nothing fits", hidden_by=(HiddenBy(kind="shadow"),))
    after = hidden_and_another(shadow, 15)
    assert after.state == "COAST"
    assert after.track_id == 1


def test_what_is_not_hidden_and_stays_away_is() -> None:
    """Fifteen frames without it and with another: by then nobody believes the first one."""
    after = hidden_and_another(None, 15)
    assert after.state == "TRACK"
    assert after.track_id == 2


def test_what_is_unseen_for_a_night_is_weighed_without_an_overflow() -> None:
    random = np.random.default_rng(4)
    three = tuple(
        streak(k, "other", random, np.array([400.0, 0.0]), truth()[k].rate, 0.0) for k in range(3)
    )
    following = Following()
    for k in range(3):
        shown = streak(k, "ours", random, np.zeros(2), truth()[k].rate, 0.0)
        following, _ = follow(following, seen(k, shown), every_day())
    assert following.track is not None
    rival = Rival(measurements=three)
    assert rival_odds(rival, following.track, 10_000) == rival_odds(rival, following.track, 10)
    assert rival_odds(rival, following.track, 0) < rival_odds(rival, following.track, 3)


def test_frames_that_say_nothing_are_no_evidence_against_it() -> None:
    """Not solved, hidden: with another satellite beside nobody takes over."""
    after = hidden_and_another(Missed(kind="not solved"), 15)
    assert after.track_id == 1


def test_the_most_confident_one_is_followed_where_that_is_asked_for() -> None:
    """The paper's rule with the adaptive filter: a brighter streak beside the prediction."""
    settings = dataclasses.replace(every_day(), choice="most confident")
    random, following = np.random.default_rng(3), Following()
    for k in range(8):
        shown = [streak(k, "ours", random, np.zeros(2), truth()[k].rate, 0.0)]
        if k == 7:
            away = np.array([300.0, 0.0])
            shown.append(streak(k, "bright", random, away, truth()[k].rate, 0.0))
        following, _ = follow(following, seen(k, *shown), settings)
    assert taken_of(following, 7) == "bright"


def test_a_neighbour_that_the_operator_chooses_is_another_track() -> None:
    random, following = np.random.default_rng(3), Following()
    for k in range(21):
        shown = [streak(k, "ours", random, np.zeros(2), truth()[k].rate, 0.0)]
        sight = seen(k, *shown)
        if k == 20:
            other = streak(k, "other", random, np.array([72.0, 0.0]), truth()[k].rate, 0.0)
            sight = dataclasses.replace(
                sight, measurements=(*sight.measurements, other), chosen=other
            )
        following, _ = follow(following, sight, every_day())
    assert following.state == "ACQUIRE"
    assert following.candidates == (other,)
