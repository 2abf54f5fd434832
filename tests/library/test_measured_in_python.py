"""``rso.measure`` and ``rso.track``: directions as they are, tracks as the telescope's own."""

import json
from datetime import datetime

import numpy as np
import pandas as pd
import pytest
from astropy import units as u
from astropy.coordinates import EarthLocation, SkyCoord
from astropy.io import fits
from astropy.table import QTable, Table, vstack
from astropy.time import Time

import rsoconsole as rso
from rsoconsole.base import FrameError, InputError
from rsoconsole.config import Config
from rsoconsole.pipeline import ProcessedFrame, open_reducer, process_files
from rsoconsole.records import TrackState
from tests.drawn.plate_fields import SHARED
from tests.nights.samples import SAMPLE

FRAMES = [SAMPLE / "frames" / f"{number:06d}.fits.fz" for number in (9, 13)]
SITE = EarthLocation.from_geodetic(lon=-81.05 * u.deg, lat=29.19 * u.deg, height=10 * u.m)
TRIPLE = (29.19, -81.05, 10.0)
TWO_SIGMA = 2.0
needs_shared = pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")


@pytest.fixture(scope="module")
def measured() -> QTable:
    return rso.measure(FRAMES, site=SITE)


@pytest.fixture(scope="module")
def night() -> QTable:
    """All that the sample's engine measured."""
    table = rso.open_session(SAMPLE).measurements
    table.meta.clear()
    return table


def test_measurements_are_those_of_the_night_they_were_taken_in(measured, night):
    assert list(measured["frame"]) == [path.name for path in FRAMES]
    for row, frame in zip(measured, (9, 13), strict=True):
        then = night[night["frame_id"] == frame]
        assert abs((row["t_mid_utc"] - then["t_mid_utc"][0]).to_value("s")) < 1e-6
        # The night's stars were compared with the frame before, which is not kept.
        off = row["direction"].separation(then["direction"][0])
        assert off < TWO_SIGMA * row["sigma_ra_arcsec"]


def test_errors_are_told_in_both_ways(measured):
    ee, en = measured["cov_ee_arcsec2"], measured["cov_en_arcsec2"]
    assert u.allclose(measured["sigma_ra_arcsec"] ** 2, ee)
    both = measured["sigma_ra_arcsec"] * measured["sigma_dec_arcsec"]
    assert u.allclose(measured["correlation"] * both, en)
    assert np.all(measured["sigma_ra_arcsec"] < 5 * u.arcsec)


def test_frames_without_a_streak_are_in_the_tables_meta(measured):
    empty = np.random.default_rng(3).normal(1000.0, 10.0, (480, 640)).astype(np.float32)
    t = Time("2026-01-01T00:00:00", scale="utc")
    table = rso.measure([empty, empty], t_start=[t, t + 30 * u.s], exposure=2 * u.s, site=TRIPLE)
    assert len(table) == 0
    assert [each["detections"] for each in table.meta["frames"]] == [0, 0]
    assert table.meta["frames"][1]["t_mid_utc"].startswith("2026-01-01T00:00:31.000")
    assert [each["is_solved"] for each in measured.meta["frames"]] == [True, True]


def test_an_array_is_measured_with_what_is_said_of_it(measured):
    with fits.open(FRAMES[0]) as hdus:
        pixels, header = hdus[1].data.astype(np.uint16), hdus[1].header
    start = Time(header["DATE-OBS"], scale="utc").tai
    table = rso.measure(
        pixels,
        t_start=start,
        exposure=header["EXPTIME"] * u.s,
        pointing=measured["direction"][0],
        scale=2.5 * u.arcsec,
        site=TRIPLE,
    )
    off = table["direction"][0].separation(measured["direction"][0])
    assert off < TWO_SIGMA * table["sigma_ra_arcsec"][0]
    assert abs((table["t_mid_utc"][0] - measured["t_mid_utc"][0]).to_value("s")) < 1e-6


@pytest.mark.parametrize(
    ("said", "error", "words"),
    [
        ({}, FrameError, r"has no time \(DATE-OBS, or t_start=\) and no length"),
        ({"exposure": 2.0}, FrameError, "has no time"),
        ({"t_start": Time("2026-01-01T00:00:00")}, FrameError, "no length of the exposure"),
        ({"t_start": datetime(2026, 1, 1)}, InputError, "t_start: .* has no time zone"),  # noqa: DTZ001
        ({"t_start": [Time("2026-01-01")] * 3}, InputError, "3 times for 1 frames"),
        ({"site": (-110.0, 30.0, 0.0)}, InputError, "latitude comes first"),
    ],
)
def test_what_a_measurement_needs_is_asked_for(said, error, words):
    blank = np.random.default_rng(3).normal(1000.0, 10.0, (480, 640))
    with pytest.raises(error, match=words):
        rso.measure(blank, **said)


def test_one_time_is_not_taken_for_many_frames():
    blank = np.random.default_rng(3).normal(1000.0, 10.0, (480, 640))
    with pytest.raises(InputError, match="one time for 2 frames"):
        rso.measure([blank, blank], t_start=Time("2026-01-01"), exposure=1.0)


# -- tracks ------------------------------------------------------------------------------------


def test_a_track_is_that_of_process(measured, tmp_path):
    config = Config.model_validate({"site": dict(zip(_SITE, TRIPLE, strict=True))})
    with open_reducer(config) as (reducer, _):
        done = list(process_files(FRAMES, reducer, config))
    assert all(isinstance(each, ProcessedFrame) for each in done)
    recorded = [r for each in done for r in each.records if isinstance(r, TrackState)]
    tracks = rso.track(measured, config=config, site=TRIPLE)
    assert [r for r in tracks.records if isinstance(r, TrackState)] == recorded
    assert recorded
    measured.write(tmp_path / "measured.ecsv")
    again = rso.track(QTable.read(tmp_path / "measured.ecsv"), config=config, site=TRIPLE)
    assert again.records == tracks.records


_SITE = ("latitude_deg", "longitude_deg", "elevation_m")


def test_the_nights_own_measurements_give_the_nights_track_again(night):
    """Thirty directions over sixteen minutes, followed by an engine with a mount."""
    tracks = rso.track(night, site=SITE, exposure=10 * u.s)
    recorded = rso.open_session(SAMPLE).tracks[1].measurements
    assert len(tracks[1]) >= len(recorded) - 4
    directions = tracks[1].measurements["direction"]
    last = SkyCoord(recorded[-1].ra_icrs_deg, recorded[-1].dec_icrs_deg, unit="deg")
    assert directions.separation(last).arcsec.min() < 1e-6
    assert tracks[1].residual_rms < 4 * u.arcsec
    assert 0.2 < tracks[1].nis_mean < 4.0
    assert tracks[1].orbit is not None
    assert tracks[1].orbit.label == "constrained by prior"


def test_an_exported_table_says_all_that_a_track_needs(tmp_path):
    path = tmp_path / "night.ecsv"
    rso.open_session(SAMPLE).export("ecsv", path)
    tracks = rso.track(QTable.read(path))
    assert len(tracks[1]) >= 27
    assert tracks[1].site.latitude_deg == 29.19
    tracks[1].measurements.write(tmp_path / "track.ecsv")
    by_file, by_table = rso.orbit(tmp_path / "track.ecsv"), rso.orbit(tracks[1])
    assert by_file.a.to_value("km") == pytest.approx(by_table.a.to_value("km"), rel=1e-9)


def two_objects(count: int = 8, step_s: float = 30.0) -> QTable:
    """Straight ways at constant rates, one east along the equator, one north; 0.5 arcsec errors."""
    rng = np.random.default_rng(4)
    s = np.arange(count) * step_s
    noise = rng.normal(0.0, 0.5 / 3600.0, (4, count))
    ra = np.concatenate([10.0 + 15.0 * s / 3600.0 + noise[0], 10.3 + noise[1]])
    dec = np.concatenate([noise[2], 0.2 + 30.0 * s / 3600.0 + noise[3]])
    t = Time("2026-01-01T04:00:00", scale="utc") + np.concatenate([s, s]) * u.s
    table = QTable({"time": t, "ra": ra * u.deg, "dec": dec * u.deg})
    table["sigma"] = 0.5 * u.arcsec
    return table


def test_two_objects_in_one_table_are_two_tracks():
    tracks = rso.track(two_objects(), site=SITE)
    assert list(tracks) == [1, 2]
    for track in tracks.values():
        assert len(track) == 8
        directions = track.measurements["direction"]
        is_east = abs(directions[-1].dec - directions[0].dec) < 0.1 * u.deg
        assert np.all((abs(directions.dec.deg) < 0.01) == is_east)  # none of the other's
    assert "Track 1" in repr(tracks[1])


def test_tables_of_every_make_are_the_same_to_it():
    table = two_objects(4)[:4]
    sky = QTable({"obstime": table["time"].tai, "place": SkyCoord(table["ra"], table["dec"])})
    sky["sigma"] = table["sigma"].to("deg")
    frame = pd.DataFrame(
        {
            "time": pd.to_datetime(table["time"].isot).tz_localize("UTC"),
            "ra_deg": table["ra"].value,
            "dec_deg": table["dec"].value,
            "sigma_arcsec": table["sigma"].value,
        }
    )
    plain = Table({"time": table["time"], "ra": table["ra"].value, "dec": table["dec"].value})
    plain["ra"].unit = plain["dec"].unit = "deg"
    expected = rso.track(table, site=SITE)[1].states
    for other, said in ((sky, {}), (frame, {}), (plain, {"sigma": 0.5}), (vstack([sky]), {})):
        states = rso.track(other, site=SITE, **said)[1].states
        assert u.allclose(states["ra_icrs_deg"], expected["ra_icrs_deg"], rtol=1e-12)
        assert np.allclose(states["covariance"], expected["covariance"], rtol=1e-6)


def _without(name):
    def change(table):
        table.remove_column(name)

    return change


def _set(name, value):
    def change(table):
        table[name] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_without("time"), "has no times: a Time column"),
        (_without("ra"), "has no directions: a SkyCoord column, or ra and dec"),
        (_without("sigma"), "states no errors: add a column 'sigma'"),
        (_set("ra", np.arange(8.0)), "column 'ra' has no unit: table"),
        (_set("ra", np.arange(8.0) * u.m), "column 'ra' is in m: give it in deg"),
        (_set("dec", np.full(8, np.nan) * u.deg), "column 'dec' is NaN"),
        (_set("dec", np.full(8, 91.0) * u.deg), "is the unit right"),
        (_set("sigma", np.zeros(8) * u.arcsec), "sigma: every one must be above 0"),
        (_set("sigma", np.ones(8)), "column 'sigma' has no unit"),
        (_set("correlation", np.full(8, 1.5)), "correlation"),
        (_set("confidence", ["high"] * 8), "column 'confidence' holds what is no float"),
        (_set("ends_icrs_deg", ["here"] * 8), "row [0-9]: the ends of its streak"),
        (_set("time", ["2026-01-01T00:00:00"] * 8), "has no time scale"),
        (_set("time", [datetime(2026, 1, 1)] * 8), "has no time zone"),  # noqa: DTZ001
    ],
)
def test_a_table_that_lacks_something_is_told_what(change, words):
    table = two_objects(4)
    change(table)
    with pytest.raises(InputError, match=words):
        rso.track(table, site=SITE)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (two_objects(4)[:0], "has no rows"),
        ([1, 2, 3], "list is no table of measurements"),
        (None, "NoneType is no table"),
    ],
)
def test_what_is_no_table_is_refused(table, words):
    with pytest.raises(InputError, match=words):
        rso.track(table, site=SITE)


def test_without_a_site_it_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="where this was seen from"):
        rso.track(two_objects())


def test_what_was_not_taken_is_told(night):
    tracks = rso.track(two_objects(), site=SITE)
    assert tracks.table("misses").colnames
    with pytest.raises(InputError, match="no table 'nothing'; there are measurements"):
        tracks.table("nothing")
    assert rso.track(two_objects()[:1], site=SITE) == {}


@pytest.mark.nightly("many independent frames")
@needs_shared
@pytest.mark.shared_data
def test_satsims_satellite_is_measured_where_satsim_put_it():
    """Another simulator's frames of full size: three exposures, one satellite."""
    folder = SHARED / "simulated" / "geo_single"
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    files = [folder / frame["file"] for frame in truth["frames"]]
    table = rso.measure(files, site=TRIPLE)
    assert len(table) == len(files)
    for row, frame in zip(table, truth["frames"], strict=True):
        (true,) = frame["objects"]
        there = SkyCoord(true["ra"], true["dec"], unit="deg")
        assert abs((row["t_mid_utc"] - Time(frame["date_mid"], scale="utc")).to_value("s")) < 0.02
        assert row["direction"].separation(there).arcsec < 1.0
    tracks = rso.track(table)
    assert list(tracks) == [1]
    assert len(tracks[1]) == len(files)
