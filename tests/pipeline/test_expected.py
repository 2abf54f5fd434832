"""Who should be in the field by the catalogue and is not followed."""

import time
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline import Orbits
from rsoconsole.pipeline.orbits.expected import EVERY, UntrackedObjects
from rsoconsole.records import (
    Event,
    ExpectedMembers,
    Identified,
    Miss,
    Missed,
    Record,
    Site,
    Solution,
    TrackLost,
    Wcs,
)
from tests.nights.eight_tracks import name_of
from tests.nights.pair_nights import (
    BEGIN_UTC_NS,
    NS,
    directions,
    frame_taken,
    geostationary,
    track_records,
)
from tests.truth.regimes import TLES

pytestmark = pytest.mark.skipif(not TLES.exists(), reason="the element files are not installed")
SITE = Site(latitude_deg=45.0, longitude_deg=10.0, elevation_m=200.0)
CONFIG = Config.model_validate(
    {
        "site": {"latitude_deg": 45.0, "longitude_deg": 10.0, "elevation_m": 200.0},
        "catalogue": {"tle_files": [str(TLES / "geo_all_20230622.tle")]},
    }
)
ASTRA = ("ASTRA 1KR", "ASTRA 1L", "ASTRA 1M", "ASTRA 1N")
SCALE_DEG = 1.264 / 3600.0


def astra():
    found = [next(e for e in geostationary() if e.name == name) for name in ASTRA]
    assert len({e.norad_id for e in found}) == 4
    return found


def frame(n: int, followed, *, aim: int = 0, t_utc_ns: int | None = None) -> list[Record]:
    """One frame with its middle at one of them; ``followed``: numbers of those with a track."""
    t = BEGIN_UTC_NS + n * 30 * NS if t_utc_ns is None else t_utc_ns
    ra_deg, dec_deg = directions(astra(), SITE, np.array([t]))
    wcs = Wcs(
        crpix_x_px=2327.5,
        crpix_y_px=1759.5,
        crval_ra_deg=float(ra_deg[aim, 0]),
        crval_dec_deg=float(dec_deg[aim, 0]),
        cd=(-SCALE_DEG, 0.0, 0.0, SCALE_DEG),
    )
    solved = Solution(
        frame_id=n,
        wcs=wcs,
        ra_icrs_deg=wcs.crval_ra_deg,
        dec_icrs_deg=wcs.crval_dec_deg,
        scale_arcsec_px=1.264,
        rotation_deg=0.0,
        is_flipped=False,
        matched=50,
        rms_arcsec=0.4,
        path="refit",
        ms=3.0,
    )
    records: list[Record] = [frame_taken(n, t), solved]
    for k in followed:
        place = (float(ra_deg[k, 0]), float(dec_deg[k, 0]))
        records += track_records(n, k + 1, t, place, (15.041 / 3600.0, 0.0), np.eye(2))
    return records


def named(k: int, verdict: str = "identified") -> Identified:
    entry = astra()[k]
    told = name_of(3, k + 1, entry.name)
    match = replace(told.matches[0], norad_id=entry.norad_id)
    return replace(told, verdict=verdict, matches=(match,))


def looked(records, config: Config = CONFIG) -> tuple[Record, ...]:
    expected = UntrackedObjects(config, geostationary)
    for record in records:
        expected.receive(record)
    return expected.derive_frame_records()


def unseen_names(told) -> set[str]:
    [members] = [each for each in told if isinstance(each, ExpectedMembers)]
    return {each.name for each in members.unseen}


def test_a_member_of_the_slot_without_a_track_is_told_with_its_place():
    told = looked([*(named(k) for k in (0, 1, 2)), *frame(5, (0, 1, 2))])
    [members] = told
    missing = next(each for each in members.unseen if each.name == "ASTRA 1N")
    assert not unseen_names(told) & set(ASTRA[:3])
    assert missing.is_usable
    assert missing.is_lit
    assert abs(missing.tle_age_days) < 3.0
    ra_deg, dec_deg = directions(astra(), SITE, np.array([members.t_utc_ns]))
    one_pixel = 1.0
    x_px = 2327.5 - (ra_deg[3, 0] - ra_deg[0, 0]) * np.cos(np.radians(dec_deg[0, 0])) / SCALE_DEG
    assert missing.x_px == pytest.approx(x_px, abs=one_pixel)
    y_px = 1759.5 + (dec_deg[3, 0] - dec_deg[0, 0]) / SCALE_DEG
    assert missing.y_px == pytest.approx(y_px, abs=one_pixel)
    assert members.in_frame >= 4
    assert members.compared > 1000


def test_a_track_without_a_name_may_be_any_that_stands_by():
    assert "ASTRA 1N" not in unseen_names(looked(frame(5, (3,))))
    # One that no catalogued object explains is none of them.
    unknown = replace(named(3, "unknown"), matches=())
    assert "ASTRA 1N" in unseen_names(looked([unknown, *frame(5, (3,))]))


def test_one_of_two_that_fit_alike_is_not_missed():
    both = replace(
        named(3, "ambiguous"),
        matches=tuple(replace(named(k).matches[0], probability=0.5) for k in (3, 2)),
    )
    assert not unseen_names(looked([both, *frame(5, (3,))])) & {"ASTRA 1N", "ASTRA 1M"}


def test_a_lost_track_is_of_nobody():
    lost = Missed(kind="nothing fits", lost=TrackLost(kind="coasted", coasted_min=120.0))
    gone = Miss(frame_id=5, reason=lost, track_id=4)
    assert "ASTRA 1N" in unseen_names(looked([named(3), *frame(5, (3,)), gone]))


def test_a_streak_that_the_edge_would_cut_is_not_in_the_usable_field():
    frame_taken_, solved, *_ = frame(5, ())
    at_edge = replace(solved.wcs, crpix_x_px=20.0)  # a streak is 118 px long
    [members] = looked([frame_taken_, replace(solved, wcs=at_edge)])
    lead = next(each for each in members.unseen if each.name == ASTRA[0])
    assert not lead.is_usable
    beyond = replace(solved.wcs, crpix_x_px=-20.0)
    assert ASTRA[0] not in unseen_names(looked([frame_taken_, replace(solved, wcs=beyond)]))


def test_in_the_shadow_of_the_earth_nobody_is_said_to_be_missing():
    midnight = BEGIN_UTC_NS + 92 * 86_400 * NS - 84 * 60 * NS  # at 19 E, 21 September
    told = looked(frame(5, (), t_utc_ns=midnight))
    [members] = [each for each in told if isinstance(each, ExpectedMembers)]
    dark = [each for each in members.unseen if each.name in ASTRA]
    assert dark
    assert not any(each.is_lit for each in dark)


def test_a_missing_member_is_said_once_after_some_looks():
    expected = UntrackedObjects(CONFIG, geostationary)
    words, looks = [], 0
    for n in range(1, 8 * EVERY):
        for record in (named(0), *frame(n, (0,))):
            expected.receive(record)
        told = expected.derive_frame_records()
        looks += any(isinstance(each, ExpectedMembers) for each in told)
        words += [each.text for each in told if isinstance(each, Event)]
    assert looks == 8  # the first frame, then every fourth one
    about = [each for each in words if "ASTRA 1N" in each]
    assert len(about) == 1
    assert about[0].startswith("expected, not seen: ASTRA 1N (")


def test_a_frame_without_a_plate_or_a_catalogue_expects_nobody():
    assert looked([each for each in frame(5, ()) if not isinstance(each, Solution)]) == ()
    nobody = UntrackedObjects(CONFIG, tuple)
    for record in frame(5, ()):
        nobody.receive(record)
    assert nobody.derive_frame_records() == ()


def test_a_catalogue_that_cannot_be_read_is_said_once_and_stops_nothing(tmp_path):
    (tmp_path / "broken.tle").write_text("1 2 3\n", encoding="utf-8")
    config = Config.model_validate({"catalogue": {"tle_files": [str(tmp_path / "broken.tle")]}})
    orbits = Orbits(config)
    told: list[Record] = []
    for n in (1, 2, 3):
        for record in frame(n, (0, 1)):
            orbits.receive(record)
        told += orbits.derive_frame_records()
    words = [each.text for each in told if isinstance(each, Event) and "expected" in each.text]
    assert len(words) == 1


def test_a_look_at_the_catalogue_costs_the_loop_little():
    """1,665 sets: on a quiet machine 5 ms, every fourth frame."""
    expected = UntrackedObjects(CONFIG, geostationary)
    spent = []
    for n in range(1, 4 * EVERY):
        for record in frame(n, (0,)):
            expected.receive(record)
        began = time.process_time()
        expected.derive_frame_records()
        spent.append(time.process_time() - began)
    assert np.mean(spent[1:]) < 0.015
