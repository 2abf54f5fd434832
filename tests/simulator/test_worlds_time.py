"""What clocks and shutters do, measured along the streak: an error of time is one of place."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsoconsole.records import Site
from rsoconsole.simulator import SensorModel
from rsoconsole.simulator.camera.truth import TrueExposureTiming
from rsoconsole.simulator.sky.passes import ExposureGeometry, satellite_passes
from rsoconsole.sky import SkyPlaces, pixel_to_sky, tan_wcs
from tests.rigs.world_rig import (
    NS,
    RATE_ARCSEC_S,
    SCALE_ARCSEC_PX,
    STRIP,
    expose,
    mean_centre,
    streak_middle_px,
)

PX_PER_S = RATE_ARCSEC_S / SCALE_ARCSEC_PX
A_TENTH_PX = 0.1


def shown(monkeypatch, world=None, **more):
    return expose(monkeypatch, world, stars=False, satellite_mag=8.5, **more)


def late_s(monkeypatch, world, **more):
    """By how much later than a plain frame's the satellite is seen, by its place in the pixels."""
    plain = shown(monkeypatch, **more)
    frame = shown(monkeypatch, world, **more)
    # It moves towards smaller columns.
    return (streak_middle_px(plain) - streak_middle_px(frame)) / PX_PER_S, plain, frame


@pytest.mark.parametrize(
    ("world", "seconds"),
    [
        ({"shutter": {"latency_s": 0.5}}, 0.5),
        ({"shutter": {"bias_s": -0.3}}, -0.3),
        ({"clock": {"offset_s": 1.5}}, 1.5),
        ({"clock": {"drift_ppm": 10_000.0}}, 0.6),
    ],
)
def test_the_satellite_is_where_it_was_when_the_shutter_was_really_open(
    monkeypatch, world, seconds
):
    found_s, plain, frame = late_s(monkeypatch, world)
    assert found_s == pytest.approx(seconds, abs=0.02)
    before, after = plain.truth.satellites[0], frame.truth.satellites[0]
    known_s = 0.5 if "latency_s" in world.get("shutter", {}) else 0.0
    # The truth is told for the instant that the operator names: the known latency and no more.
    named_s = (after.ra_icrs_deg - before.ra_icrs_deg) / before.ra_rate_deg_s
    assert named_s == pytest.approx(known_s, abs=1e-3)
    assert frame.truth.t_place_utc_ns - plain.truth.t_place_utc_ns == round(known_s * NS)
    assert frame.truth.t_open_utc_ns - plain.truth.t_open_utc_ns == pytest.approx(
        seconds * NS, abs=0.06 * NS
    )


def test_a_wrong_clock_moves_no_star(monkeypatch):
    plain = mean_centre(expose(monkeypatch))
    wrong = mean_centre(expose(monkeypatch, {"clock": {"offset_s": 20.0}}))
    assert wrong == pytest.approx(plain, abs=0.05)


def test_scatter_is_the_sigma_of_the_opening_from_frame_to_frame(monkeypatch):
    seconds = np.arange(0.0, 60.0, 2.0)

    def spread_s(world):
        middles = [
            streak_middle_px(shown(monkeypatch, world, second=s, exposure_s=4.0, optics=STRIP))
            for s in seconds
        ]
        return np.std(middles) / PX_PER_S

    assert spread_s({"shutter": {"scatter_s": 0.4}}) == pytest.approx(0.4, rel=0.3)
    assert spread_s({}) < 0.05


def test_a_header_in_whole_seconds_is_early_by_what_was_cut(monkeypatch):
    frame = shown(monkeypatch, {"shutter": {"round_s": 1.0}}, second=60.7)
    plain = shown(monkeypatch, second=60.7)
    assert plain.truth.t_start_utc_ns - frame.truth.t_start_utc_ns == 0.7 * NS
    assert streak_middle_px(frame) == pytest.approx(streak_middle_px(plain), abs=A_TENTH_PX)
    moved_deg = plain.truth.satellites[0].ra_icrs_deg - frame.truth.satellites[0].ra_icrs_deg
    assert moved_deg * 3600.0 == pytest.approx(0.7 * 15.04, abs=0.1)


def test_a_rolling_shutter_sees_each_row_at_its_own_time(monkeypatch):
    # The streak lies on row 160: 160 ms after the first row.
    found_s, *_ = late_s(monkeypatch, {"shutter": {"line_time_us": 1000.0}})
    assert found_s == pytest.approx(0.1595, abs=0.015)


class StraightSatellite:
    """Crosses the plate at a steady rate in pixels; no orbit."""

    element_set = SimpleNamespace(name="STRAIGHT", norad_id=1)

    def __init__(self, plate, start_px, rate_px_s, t0_utc_ns):
        self._plate, self._start, self._rate, self._t0 = plate, start_px, rate_px_s, t0_utc_ns

    def astrometric_place(self, _site, t_utc_ns):
        since = (np.asarray(t_utc_ns) - self._t0) / NS
        x, y = (at + rate * since for at, rate in zip(self._start, self._rate, strict=True))
        ra, dec = pixel_to_sky(self._plate, x, y)
        zero = np.zeros(len(since))
        there = np.tile([42_000.0, 0.0, 0.0], (len(since), 1))
        return SkyPlaces(
            t_utc_ns=np.asarray(t_utc_ns),
            ra_icrs_deg=ra,
            dec_icrs_deg=dec,
            range_km=zero + 36_000.0,
            ra_rate_deg_s=zero,
            dec_rate_deg_s=zero,
            position_gcrs_km=there,
            site_gcrs_km=there,
        )

    @staticmethod
    def magnitude(places):
        return np.full(len(places.ra_icrs_deg), 10.0)


def test_a_rolling_shutter_draws_out_what_runs_with_it_exactly():
    """y = y0 + v (s + y L) has the solution (y0 + v s) / (1 - v L)."""
    sensor = SensorModel(width_px=900, height_px=3000)
    plate = tan_wcs(
        150.0,
        -5.0,
        scale_arcsec_px=1.264,
        rotation_deg=0.0,
        is_flipped=False,
        width_px=900,
        height_px=3000,
    )
    t0, rate_px_s, line_time_s = 1_687_500_000 * NS, 1800.0, 25e-6
    satellite = StraightSatellite(plate, (400.0, 300.0), (20.0, rate_px_s), t0)
    sight = ExposureGeometry(
        site=Site(latitude_deg=29.0, longitude_deg=-81.0, elevation_m=0.0),
        sensor=sensor,
        wcs=plate,
        t_start_utc_ns=t0,
        exposure_s=1.0,
        true=TrueExposureTiming(t_open_utc_ns=t0, line_time_s=line_time_s),
    )
    [seen] = satellite_passes([(satellite, lambda t: np.zeros(len(t)))], sight)
    s = np.linspace(0.0, 1.0, len(seen.streak.y_px))
    expected = (300.0 + rate_px_s * s) / (1.0 - rate_px_s * line_time_s)
    assert seen.streak.y_px == pytest.approx(expected, abs=0.001)
    # Each pixel keeps its light: the longer streak has seen the satellite for longer.
    plain = float(sensor.electrons(10.0, 1.0))
    assert seen.streak.electrons == pytest.approx(plain / (1.0 - rate_px_s * line_time_s), rel=1e-3)
