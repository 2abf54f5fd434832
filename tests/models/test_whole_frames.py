"""The frames that the detector is calibrated and measured on: what they promise to be."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.frames import HARD, KINDS, TrueFrame, draw
from rsoconsole.instruments import read_frame
from rsoconsole.simulator import Scene, SensorModel
from rsoconsole.simulator.camera.rendering import expected_electrons
from rsoconsole.sky import separation_deg
from rsoconsole.words import utc_ns_to_iso

SATSIM = Path(__file__).resolve().parents[3] / "shared" / "data" / "simulated"
SMALL = SensorModel(width_px=640, height_px=480)
NO_STARS = {"star_x_px": np.zeros(0), "star_y_px": np.zeros(0), "star_electrons": np.zeros(0)}


def test_a_frame_is_the_same_however_often_it_is_drawn_and_shared_by_no_split():
    once, again = draw("test", "satellites", 3, SMALL), draw("test", "satellites", 3, SMALL)
    assert np.array_equal(once.frame.pixels, again.frame.pixels)
    assert once.trails == again.trails
    for other in (
        draw("calibrate", "satellites", 3, SMALL),
        draw("test", "clouds", 3, SMALL),
        draw("test", "satellites", 4, SMALL),
    ):
        assert not np.array_equal(once.frame.pixels, other.frame.pixels)


def test_the_splits_share_neither_sky_nor_year_nor_sensor(monkeypatch):
    exposed: dict[str, list[tuple[float, float, int, int]]] = {"calibrate": [], "test": []}
    split = "calibrate"
    seen = Scene.field_content

    def noted(scene, wcs, t_utc_ns, exposure_s):
        place = wcs.crval_ra_deg, wcs.crval_dec_deg
        exposed[split].append((*place, t_utc_ns, scene.sensor.seed))
        return seen(scene, wcs, t_utc_ns, exposure_s)

    monkeypatch.setattr(Scene, "field_content", noted)
    tiny = SensorModel(width_px=64, height_px=64)
    for split in exposed:
        for kind in KINDS:
            for number in range(12):
                draw(split, kind, number, tiny)
    full = SensorModel()
    across_deg = math.hypot(full.width_px, full.height_px) * full.scale_arcsec_px / 3600.0
    for ra, dec, t_utc_ns, sensor in exposed["calibrate"]:
        for other_ra, other_dec, other_t, other_sensor in exposed["test"]:
            assert separation_deg(ra, dec, other_ra, other_dec) > across_deg
            assert utc_ns_to_iso(t_utc_ns)[:4] != utc_ns_to_iso(other_t)[:4]
            assert sensor != other_sensor


@pytest.mark.parametrize("kind", ["satellites", "clouds"])
def test_the_stated_signal_to_noise_is_that_of_a_pixel_on_the_ridge(kind):
    for number in range(6):
        true = draw("calibrate", kind, number, SMALL)
        sensor = replace(true.sensor, prnu=0.0, hot_fraction=0.0)
        plain = replace(true.content, streaks=(), **NO_STARS)
        sky_e = expected_electrons(sensor, plain)
        for streak, trail in zip(true.content.streaks, true.trails, strict=True):
            light = expected_electrons(sensor, replace(plain, streaks=(streak,))) - sky_e
            x, y = trail.middle_px
            if trail.is_cut or trail.length_px < 30 or not (20 < x < 620 and 20 < y < 460):
                continue
            noise = np.sqrt(sky_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0)
            near = np.s_[round(y) - 8 : round(y) + 9, round(x) - 8 : round(x) + 9]
            four_percent = 0.04
            brightest = float((light / noise)[near].max())
            assert brightest == pytest.approx(trail.peak_snr, rel=four_percent)


def _ridge_snr(pixels: np.ndarray, ends: tuple[float, float, float, float]) -> float:
    """Mean excess of the pixels on a line over the spread of those about it, stars left out."""
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    cos, sin = (x_b - x_a) / length, (y_b - y_a) / length
    y, x = np.mgrid[0 : pixels.shape[0], 0 : pixels.shape[1]]
    u, v = (x - x_a) * cos + (y - y_a) * sin, (y - y_a) * cos - (x - x_a) * sin
    inside = (u > 8) & (u < length - 8)
    sky = pixels[inside & (np.abs(v) > 12) & (np.abs(v) < 40)].astype(float)
    for _ in range(4):
        sky = sky[np.abs(sky - sky.mean()) < 3.0 * sky.std()]
    ridge = pixels[inside & (np.abs(v) < 0.25)].astype(float)
    ridge = ridge[np.abs(ridge - np.median(ridge)) < 5.0 * sky.std()]
    return float((ridge.mean() - sky.mean()) / sky.std())


@pytest.mark.nightly("many independent frames")
@pytest.mark.shared_data
@pytest.mark.skipif(not SATSIM.exists(), reason=f"{SATSIM} is not here")
def test_signal_to_noise_means_here_what_the_independent_frames_mean_by_it():
    """One estimate on pixels alone, against SatSim's ``snr_peak_pixel`` and against ours."""
    twelve_percent = 0.12
    for sequence in ("geo_single", "geo_pair_dim"):
        frame = json.loads((SATSIM / sequence / "truth.json").read_text())["frames"][0]
        pixels = read_frame(SATSIM / sequence / frame["file"], 1).pixels
        for true in frame["objects"]:
            x0, y0 = int(true["x"]) - 110, int(true["y"]) - 110
            at = [true["x_start"] - x0, true["y_start"] - y0]
            at += [true["x_end"] - x0, true["y_end"] - y0]
            measured = _ridge_snr(pixels[y0 : y0 + 220, x0 : x0 + 220], tuple(at))
            assert measured == pytest.approx(true["snr_peak_pixel"], rel=twelve_percent)
    compared = 0
    for number in range(8):
        ours = draw("calibrate", "satellites", number, SMALL)
        for trail in ours.trails:
            if trail.peak_snr > 4.0 and trail.length_px > 60.0:
                ends = trail.x_a_px, trail.y_a_px, trail.x_b_px, trail.y_b_px
                measured = _ridge_snr(ours.frame.pixels, ends)
                assert measured == pytest.approx(trail.peak_snr, rel=twelve_percent)
                compared += 1
    assert compared >= 5


def test_what_the_edge_hides_is_no_part_of_the_truth():
    width, height = SMALL.width_px, SMALL.height_px
    cut = whole = 0
    for number in range(25):
        for trail in draw("test", "satellites", number, SMALL).trails:
            ends = (trail.x_a_px, trail.y_a_px), (trail.x_b_px, trail.y_b_px)
            on_rim = [min(x + 0.5, y + 0.5, width - 0.5 - x, height - 0.5 - y) for x, y in ends]
            assert min(on_rim) > -1e-6
            assert trail.is_cut == (min(on_rim) < 1e-6)
            cut, whole = cut + trail.is_cut, whole + (not trail.is_cut)
    assert cut >= 3
    assert whole >= 10


def _of_kind(kind: str) -> list[TrueFrame]:
    return [draw("calibrate", kind, number, SMALL) for number in range(3)]


def test_hard_frames_hold_no_satellite():
    for kind in (*HARD, "empty"):
        assert all(true.trails == () for true in _of_kind(kind))


def test_wind_draws_every_star_out_alike_and_keeps_its_light():
    for number in range(3):
        still = draw("calibrate", "jitter", number, replace(SMALL, width_px=800))
        x, y = still.content.star_x_px, still.content.star_y_px
        points = np.flatnonzero(np.diff(still.content.star_electrons))[0] + 1
        assert points >= 4
        paths = np.stack([x, y]).reshape(2, -1, points)
        about = paths - paths.mean(axis=2, keepdims=True)
        assert np.abs(about - about[:, :1]).max() < 1e-6
        reach = np.hypot(np.ptp(about[0, 0]), np.ptp(about[1, 0]))
        assert 2.0 < reach < 45.0


def test_heavy_cosmic_rays_come_by_the_hundred():
    full_frame = 4656 * 3520 / (SMALL.width_px * SMALL.height_px)
    for true in _of_kind("rays"):
        assert 190 <= true.content.cosmic_rays * full_frame <= 910
