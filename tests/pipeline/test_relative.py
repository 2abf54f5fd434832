"""How two satellites move to each other: figures against SGP4, warnings, what is on record."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline.orbits._pairs import PAIRS_OF_MANY, TrackPairs
from rsoconsole.records import (
    Event,
    FollowedAgain,
    Miss,
    Missed,
    PairMotion,
    PairMotions,
    TrackLost,
)
from rsoconsole.session import SessionReader, SessionWriter
from rsoconsole.tracking.association.relative import closest_approaches
from tests.nights.pair_nights import (
    BEGIN_UTC_NS,
    NS,
    PairNight,
    directions,
    frame_taken,
    random_nights,
    track_records,
)
from tests.truth.regimes import TLES

NIGHTS = 160
NO_WARNING = Config.model_validate({"alert": {"separation_arcsec": 0.0}})
needs_elements = pytest.mark.skipif(not TLES.exists(), reason="the element files are not installed")


def pairs_after(records, config: Config = NO_WARNING) -> TrackPairs:
    pairs = TrackPairs(config)
    for record in records:
        pairs.receive(record)
    return pairs


def motion_of(night: PairNight) -> PairMotion:
    [told] = [
        each
        for each in pairs_after(night.records).derive_frame_records()
        if isinstance(each, PairMotions)
    ]
    [motion] = told.pairs
    return motion


def way_arcsec(ra_deg, dec_deg, other_ra_deg, other_dec_deg) -> np.ndarray:
    """(N, 2) from neighbours to neighbours, east and north at the middle between them."""
    level = np.cos(np.radians((dec_deg + other_dec_deg) / 2.0))
    east_deg = (other_ra_deg - ra_deg + 180.0) % 360.0 - 180.0
    return 3600.0 * np.stack([east_deg * level, other_dec_deg - dec_deg], axis=-1)


def truth_of(night: PairNight, motion: PairMotion) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Way and rate (arcsec/min) now, and when (s from now) and how near they are next."""
    since_s = np.arange(0.0, motion.horizon_s + 1.0, 180.0)
    t = motion.t_utc_ns + (since_s * NS).astype(np.int64)
    ra_deg, dec_deg = directions(night.entries, night.site, t)
    ways = way_arcsec(ra_deg[0], dec_deg[0], ra_deg[1], dec_deg[1])
    ra_deg, dec_deg = directions(night.entries, night.site, t[:1] + np.array([-30, 30]) * NS)
    beside = way_arcsec(ra_deg[0], dec_deg[0], ra_deg[1], dec_deg[1])
    rate = beside[1] - beside[0]
    at_s, nearest = closest_approaches(since_s, ways[None])
    return ways[0], rate, float(at_s[0]), float(nearest[0])


@pytest.fixture(scope="module")
def judged() -> list[tuple[PairMotion, tuple]]:
    nights = random_nights(np.random.default_rng(20230622), NIGHTS)
    found = [(night, motion_of(night)) for night in nights]
    return [(motion, truth_of(night, motion)) for night, motion in found]


def shares(off_in_sigmas) -> tuple[float, float]:
    """Within one sigma and within two, as of a normal error: 68 % and 95 %."""
    off = np.abs(np.array(off_in_sigmas))
    return float(np.mean(off < 1.0)), float(np.mean(off < 1.96))


def is_nominal(within_one: float, within_two: float) -> bool:
    """As near to 68 % and 95 % as some hundred pairs tell, three sigma, with a little room."""
    return 0.58 < within_one < 0.80 and within_two > 0.90


@pytest.mark.nightly("statistics over many nights")
@needs_elements
def test_ways_and_rates_of_real_pairs_are_as_sure_as_is_said(judged):
    ways, rates = [], []
    for m, (way, rate, _, _) in judged:
        ways += [
            (m.east_arcsec - way[0]) / m.sigma_east_arcsec,
            (m.north_arcsec - way[1]) / m.sigma_north_arcsec,
        ]
        rates += [
            (m.rate_east_arcsec_min - rate[0]) / m.sigma_rate_east_arcsec_min,
            (m.rate_north_arcsec_min - rate[1]) / m.sigma_rate_north_arcsec_min,
        ]
    assert is_nominal(*shares(ways)), shares(ways)
    assert is_nominal(*shares(rates)), shares(rates)
    # The judge can see errors that are stated at half their size.
    assert not is_nominal(*shares(2.0 * np.array(ways)))


@pytest.mark.nightly("statistics over many nights")
@needs_elements
def test_separation_and_position_angle_of_real_pairs_are_as_sure_as_is_said(judged):
    separations, angles, changes = [], [], []
    for m, (way, rate, _, _) in judged:
        apart = float(np.hypot(*way))
        separations.append((m.separation_arcsec - apart) / m.sigma_separation_arcsec)
        angle = np.degrees(np.arctan2(way[0], way[1]))
        off = (m.position_angle_deg - angle + 180.0) % 360.0 - 180.0
        angles.append(off / m.sigma_position_angle_deg)
        changes.append(
            (m.separation_rate_arcsec_min - float(way @ rate) / apart)
            / m.sigma_separation_rate_arcsec_min
        )
    for each in (separations, angles, changes):
        assert is_nominal(*shares(each)), shares(each)


@pytest.mark.nightly("statistics over many nights")
@needs_elements
def test_the_next_closest_approach_of_real_pairs_is_as_sure_as_is_said(judged):
    within_68 = [m.closest_low_arcsec <= t[3] <= m.closest_high_arcsec for m, t in judged]
    within_95 = [m.closest_lowest_arcsec <= t[3] <= m.closest_highest_arcsec for m, t in judged]
    assert is_nominal(np.mean(within_68), np.mean(within_95))
    ahead = [(m, t) for m, t in judged if m.closest == "ahead" and m.sigma_closest_s < 1800.0]
    assert len(ahead) > 20
    off = [
        ((m.closest_utc_ns - m.t_utc_ns) / NS - t[2]) / max(m.sigma_closest_s, 1.0)
        for m, t in ahead
    ]
    assert 0.5 < shares(off)[0] < 0.9
    assert shares(off)[1] > 0.85


@pytest.mark.nightly("statistics over many nights")
@needs_elements
def test_what_both_share_is_no_error_of_the_difference(judged):
    """A plate that is 5 arcsec off in each frame, and streaks that err by 3 at most."""
    assert np.median([m.sigma_separation_arcsec for m, _ in judged]) < 2.0


def crossing(frames: int, *, rate=6.0, nearest=12.0, at_min=40.0) -> list:
    """Two without errors: a straight path, frame by frame a minute apart."""
    records = []
    for n in range(1, frames + 1):
        t = BEGIN_UTC_NS + n * 60 * NS
        records.append(list(frame_of(n, t, (rate * (n - at_min), nearest))))
    return records


def frame_of(n: int, t: int, way_arcsec_: tuple[float, float], **more):
    east, north = way_arcsec_
    yield frame_taken(n, t)
    ra = 100.0 + 15.041 / 3600.0 * 60.0 * n
    cov = 0.04 * np.eye(2)
    rate = (15.041 / 3600.0, 0.0)
    yield from track_records(n, 1, t, (ra, 0.0), rate, cov)
    # Relative to the middle between both, at the equator.
    yield from track_records(n, 2, t, (ra + east / 3600.0, north / 3600.0), rate, cov, **more)


def after_each(frames, config: Config) -> list[tuple[PairMotion | None, list[Event]]]:
    pairs, found = TrackPairs(config), []
    for records in frames:
        for record in records:
            pairs.receive(record)
        told = pairs.derive_frame_records()
        motions = [m for each in told if isinstance(each, PairMotions) for m in each.pairs]
        found.append(
            (motions[0] if motions else None, [each for each in told if isinstance(each, Event)])
        )
    return found


def test_a_straight_path_is_measured_and_its_nearest_place_found():
    motion, _ = after_each(crossing(20), NO_WARNING)[-1]
    assert motion is not None
    assert motion.separation_arcsec == pytest.approx(np.hypot(120.0, 12.0), abs=1.0)
    assert motion.position_angle_deg == pytest.approx(270.0 + np.degrees(0.1), abs=0.5)
    assert motion.separation_rate_arcsec_min == pytest.approx(-6.0, abs=0.2)
    assert motion.closest == "ahead"
    assert (motion.closest_utc_ns - motion.t_utc_ns) / NS == pytest.approx(1200.0, abs=60.0)
    assert motion.closest_lowest_arcsec < 12.0 < motion.closest_highest_arcsec
    assert motion.closest_arcsec == pytest.approx(12.0, abs=6.0)


def test_an_approach_is_warned_of_once_and_ends_when_it_has_passed():
    config = Config.model_validate({"alert": {"separation_arcsec": 30.0}})
    told = after_each(crossing(60), config)
    words = [(n, each) for n, (_, events) in enumerate(told, 1) for each in events]
    assert [each.level for _, each in words] == ["warning", "info"]
    (first, warning), (last, end) = words
    assert first < 36
    assert "apart, least " in warning.text
    assert "tracks 1 2" in warning.text
    assert warning.topic == end.topic == "approach"
    assert last > 44
    assert "passed, nearest 1" in end.text
    assert [m is not None and m.is_close for m, _ in told] == [
        first <= n < last for n in range(1, 61)
    ]


def test_a_warning_ends_with_its_track():
    config = Config.model_validate({"alert": {"separation_arcsec": 30.0}})
    pairs = pairs_after([record for frame in crossing(38) for record in frame], config)
    assert len([each for each in pairs.derive_frame_records() if isinstance(each, Event)]) == 1
    coasting = list(frame_of(39, BEGIN_UTC_NS + 39 * 60 * NS, (6.0, 12.0), is_seen=False))
    for record in (*coasting, Miss(frame_id=39, reason=Missed(kind="nothing fits"), track_id=2)):
        pairs.receive(record)
    assert not [each for each in pairs.derive_frame_records() if isinstance(each, Event)]
    assert pairs.last[0].is_close
    lost = Missed(kind="nothing fits", lost=TrackLost(kind="left the frame"))
    for record in (*replaced(coasting, 40), Miss(frame_id=40, reason=lost, track_id=2)):
        pairs.receive(record)
    [end] = pairs.derive_frame_records()
    assert isinstance(end, Event)
    assert end.text == "tracks 1 2: warning over, track 2 ended"
    assert pairs.last == ()


def replaced(records, frame_id: int):
    return [replace(each, frame_id=frame_id) for each in records]


def test_no_warning_where_none_is_wanted_and_none_of_a_pair_that_stays_apart():
    assert not any(events for _, events in after_each(crossing(60), NO_WARNING))
    config = Config.model_validate({"alert": {"separation_arcsec": 30.0}})
    apart = crossing(60, nearest=120.0)
    assert not any(events for _, events in after_each(apart, config))


def test_a_frame_that_is_followed_again_counts_as_it_was_followed_last():
    frames = crossing(12)
    wrong = list(frame_of(8, BEGIN_UTC_NS + 8 * 60 * NS, (500.0, 500.0)))
    right = pairs_after([r for frame in frames for r in frame])
    ruled = pairs_after(
        [r for n, frame in enumerate(frames, 1) for r in (wrong if n == 8 else frame)]
    )
    assert ruled.derive_frame_records() != right.derive_frame_records()
    for n in range(8, 13):
        ruled.receive(FollowedAgain(frame_id=n))
        for record in frames[n - 1][1:]:
            ruled.receive(record)
    assert ruled.derive_frame_records() == right.derive_frame_records()


def test_of_many_pairs_each_has_its_turn_and_the_near_ones_more_often():
    """Twelve tracks on a line, 180 arcsec apart: 66 pairs."""
    pairs, told = TrackPairs(NO_WARNING), []
    for n in range(1, 81):
        t = BEGIN_UTC_NS + n * 30 * NS
        pairs.receive(frame_taken(n, t))
        for track in range(1, 13):
            place = (100.0 + 0.125 * n + 0.05 * track, 0.0)
            for record in track_records(n, track, t, place, (15.04 / 3600, 0.0), np.eye(2)):
                pairs.receive(record)
        told += [each for each in pairs.derive_frame_records() if isinstance(each, PairMotions)]
    assert max(len(each.pairs) for each in told) == PAIRS_OF_MANY
    assert len(pairs.last) == 66
    times = Counter((m.track_id, m.other_track_id) for each in told[11:] for m in each.pairs)
    assert len(times) == 66
    near = [times[n, n + 1] for n in range(1, 12)]
    far = [count for (one, other), count in times.items() if other - one > 2]
    assert sum(near) / len(near) > 2.0 * sum(far) / len(far)
    assert min(near) >= max(far)


def test_pairs_go_on_record_and_back(tmp_path: Path):
    told = pairs_after([r for frame in crossing(12) for r in frame]).derive_frame_records()
    writer = SessionWriter.create(tmp_path / "pairs", Config(), {"title": "pairs"})
    for record in told:
        writer.append(record, BEGIN_UTC_NS)
    writer.close()
    reader = SessionReader(tmp_path / "pairs")
    assert [r for _, _, r in reader.records() if isinstance(r, PairMotions)] == list(told)
    [row] = reader.view_rows("pairs")
    [motion] = told[0].pairs
    assert (row["track_id"], row["other_track_id"], row["path"]) == (1, 2, motion.path)
    assert row["separation_arcsec"] == pytest.approx(motion.separation_arcsec)
    assert row["closest_highest_arcsec"] >= row["closest_arcsec"] >= row["closest_lowest_arcsec"]
