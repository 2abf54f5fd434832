"""Fields on pictures of the real sky: which may be used, whose are for judging, what is true."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from astropy.io import fits

from models import backgrounds
from models.backgrounds import BACKGROUNDS, Plane
from models.dataset import (
    SHARDS,
    draw_real_shard,
    read_shard,
    real_shards,
    shard_path,
    write_shard,
)
from models.fields import Conditions
from models.real_fields import draw_on
from rsoconsole.simulator import FieldContent, SensorModel, frame_rng, render, straight_streak

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


def sky(seed, side=480, fwhm_px=2.4, streaks=()):
    """A star field of another making, float32 ADU."""
    rng = frame_rng(seed)
    sensor = SensorModel(width_px=side, height_px=side, vignetting_corner=0, hot_fraction=0)
    content = FieldContent(
        fwhm_px=fwhm_px,
        star_x_px=rng.uniform(0, side, 150),
        star_y_px=rng.uniform(0, side, 150),
        star_electrons=np.geomspace(2e3, 2e5, 150),
        streaks=tuple(streaks),
    )
    return render(sensor, content, rng).astype(np.float32)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """One camera to learn from, one to judge with, and a picture that nobody knows."""
    monkeypatch.setattr("models.dataset.FIELDS_PER_SHARD", 3)
    there = tmp_path / "pictures" / "deep"
    there.mkdir(parents=True)
    for number, name in enumerate(
        ("huntsman_science_0.fits", "pocs_unsolved.fits", "mystery.fits")
    ):
        fits.PrimaryHDU(sky(number).astype(np.uint16)).writeto(there / name)
    (there / "notes.txt").write_text("no picture")
    backgrounds.planes.cache_clear()
    return tmp_path / "pictures"


def test_only_licences_that_allow_it_and_no_camera_on_both_sides():
    assert {each.licence for each in BACKGROUNDS} <= {"MIT", "BSD-3-Clause", "GPL-3.0"}
    assert len({each.name for each in BACKGROUNDS}) == len(BACKGROUNDS)
    learnt, judged = (
        {each.camera for each in BACKGROUNDS if each.split == split} for split in backgrounds.SPLITS
    )
    assert learnt
    assert judged
    assert not learnt & judged


def test_what_is_not_known_is_named_and_skipped(folder, capsys):
    assert real_shards(folder) == {"real-train": 24, "real-test": 8}
    said = capsys.readouterr().out
    assert "real-train: Huntsman lens\n" in said
    assert "real-test: POCS\n" in said
    assert "not in models/backgrounds.py, skipped: mystery.fits" in said


def test_training_needs_no_pictures_but_a_folder_without_any_is_a_mistake(tmp_path):
    assert real_shards(None) == {}
    with pytest.raises(SystemExit, match=r"no known background in .*models/backgrounds\.py"):
        real_shards(tmp_path)


def test_a_split_whose_cameras_are_not_there_gets_no_shards(folder):
    (folder / "deep" / "pocs_unsolved.fits").unlink()
    assert set(real_shards(folder)) == {"real-train"}


def test_a_shard_on_pictures_is_the_same_from_the_same_seed_and_survives_the_disk(folder, tmp_path):
    write_shard(tmp_path, 9, "real-train", 0, folder)
    stored = read_shard(shard_path(tmp_path, "real-train", 0))
    again = draw_real_shard(9, "real-train", 0, folder)
    other = draw_real_shard(9, "real-train", 1, folder)
    for one, same, another in zip(stored, again, other, strict=True):
        assert np.array_equal(one.values, same.values)
        assert not np.array_equal(one.values, another.values)
        assert len(one.streaks) == len(same.streaks)
        for a, b in zip(one.streaks, same.streaks, strict=True):
            assert a.integrated_snr == pytest.approx(b.integrated_snr, rel=1e-5)


def test_pictures_change_nothing_about_the_drawn_shards(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("models.dataset.BLOCKS", (2,))
    assert set(SHARDS) == {"train", "calibrate", "test"}
    with_them, without = tmp_path / "with", tmp_path / "without"
    for there in (with_them, without):
        there.mkdir()
    write_shard(with_them, 9, "real-test", 0, folder)
    write_shard(with_them, 9, "train", 0, folder)
    write_shard(without, 9, "train", 0)
    one, other = (read_shard(shard_path(f, "train", 0)) for f in (with_them, without))
    assert all(np.array_equal(a.values, b.values) for a, b in zip(one, other, strict=True))
    assert shard_path(with_them, "real-test", 0).exists()


@pytest.mark.parametrize("seed", range(6))
def test_satellites_lie_where_their_truth_says(seed):
    plane = Plane(camera="x", pixels=sky(3), fwhm_px=2.4, trails=())
    wanted = Conditions(
        mode="fast", peak_snr=(15.0, 20.0), streaks=(1, 1), streak_cells=(30.0, 40.0)
    )
    field = draw_on(plane, frame_rng(21, seed), wanted)
    for streak in field.streaks:
        assert _brightness_along(field, streak) > np.median(field.values) + 50


@pytest.mark.parametrize("seed", range(8))
def test_what_was_in_the_picture_stays_known_however_it_is_turned(seed):
    trail = straight_streak((60.0, 110.0), (400.0, 300.0), 5e5)
    ends = (60.0, 110.0, 400.0, 300.0)
    plane = Plane(camera="x", pixels=sky(4, streaks=[trail]), fwhm_px=2.4, trails=(ends,))
    field = draw_on(plane, frame_rng(22, seed), Conditions(mode="fast", streaks=(0, 0)))
    for streak in field.streaks:
        assert not streak.is_asked
        assert _brightness_along(field, streak) > np.median(field.values) + 80
    assert field.streaks


def _brightness_along(field, streak):
    """Mean of the brightest of three cells across, which an image in motion leaves it in."""
    share = np.linspace(0.1, 0.9, 40)
    x = streak.x_a + share * (streak.x_b - streak.x_a)
    y = streak.y_a + share * (streak.y_b - streak.y_a)
    widened = cv2.dilate(field.values, np.ones((3, 3), np.uint8))
    inside = (x >= 0) & (x < 192) & (y >= 0) & (y < 192)
    return float(widened[y[inside].astype(int), x[inside].astype(int)].mean())


def test_the_disc_is_measured_and_wide_stars_have_their_pixels_joined(folder):
    path = folder / "deep" / "huntsman_science_0.fits"
    (plane,) = backgrounds.planes(folder, "Huntsman lens")
    assert plane.fwhm_px == pytest.approx(2.4, rel=0.15)
    fits.PrimaryHDU(sky(5, 720, fwhm_px=6.4).astype(np.uint16)).writeto(path, overwrite=True)
    backgrounds.planes.cache_clear()
    (plane,) = backgrounds.planes(folder, "Huntsman lens")
    assert plane.pixels.shape == (360, 360)
    assert plane.fwhm_px == pytest.approx(3.2, rel=0.15)


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="the pictures of others are not installed")
def test_every_picture_of_the_table_can_be_drawn_on():
    known, unknown = backgrounds.find(SHARED)
    assert set(known) == {each.name for each in BACKGROUNDS}
    # Without a licence, or of one that is not ours to use.
    assert {"qhy163m_272_mpc_1.1_00001.fits", "tetra3_alt40_azi45.tiff"} <= set(unknown)
    for split in backgrounds.SPLITS:
        for number, camera in enumerate(backgrounds.cameras(SHARED, split)):
            for plane in backgrounds.planes(SHARED, camera):
                assert 1.0 < plane.fwhm_px < 5.0
                field = draw_on(plane, frame_rng(23, number), Conditions(mode="fast"))
                assert field.values.shape == (192, 192)
                assert np.median(field.values) == pytest.approx(50, abs=25)
