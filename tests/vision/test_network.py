"""The shipped network: refused when it is not itself, right on frames that the renderer drew.

The network proposes; what is a streak, the fit and the curve of confidence decide. Asked here is
that it believes in streaks far more than in anything else.
"""

import dataclasses
import json
import shutil

import numpy as np
import pytest

from rsoconsole.base import ModelError, model_file_path
from rsoconsole.simulator import FieldContent, SensorModel, frame_rng, render, straight_streak
from rsoconsole.vision import MODEL_NAME, Network, make_map

BELIEVED = 0.004
"""Sky without a satellite stays well below this, streaks above."""
QUARTER = SensorModel(width_px=1164, height_px=880)


@pytest.fixture(scope="module")
def network() -> Network:
    return Network.load(threads=1)


@pytest.fixture
def copied(tmp_path):
    model = tmp_path / MODEL_NAME
    shutil.copy(model_file_path(MODEL_NAME), model)
    shutil.copy(model_file_path("streak_ssd.json"), model.with_suffix(".json"))
    return model


def _sky(seed: int, stars: int = 900, streaks=(), **more) -> np.ndarray:
    rng = frame_rng(seed, 77)
    content = FieldContent(
        star_x_px=rng.uniform(0, QUARTER.width_px, stars),
        star_y_px=rng.uniform(0, QUARTER.height_px, stars),
        star_electrons=np.minimum(150.0 * (1 - rng.random(stars)) ** -1.1, 1e6),
        streaks=tuple(streaks),
        cosmic_rays=3.0,
        **more,
    )
    return render(QUARTER, content, rng)


def _geo(x: float, y: float, angle_deg: float, peak_snr: float = 6.0, length_px: float = 119.0):
    dx = length_px / 2 * np.cos(np.radians(angle_deg))
    dy = length_px / 2 * np.sin(np.radians(angle_deg))
    noise_e, sigma_px = 11.7, 0.98
    electrons = peak_snr * noise_e * np.sqrt(2 * np.pi) * sigma_px * length_px
    return straight_streak((x - dx, y - dy), (x + dx, y + dy), electrons)


def _found(network: Network, pixels: np.ndarray, mode="fast", block=8):
    boxes = network.run(make_map(pixels, mode, block))
    return [box for box in boxes if box.confidence > BELIEVED]


@pytest.mark.parametrize("angle_deg", [0.0, 2.0, 37.0, 90.0, 141.0])
def test_a_geostationary_streak_is_found_where_it_is(network, angle_deg):
    x, y = 611.3, 402.8
    (box,) = _found(network, _sky(1, streaks=[_geo(x, y, angle_deg)]))
    two_cells = 16.0
    assert np.hypot(box.middle_px[0] - x, box.middle_px[1] - y) < two_cells
    assert box.length_px == pytest.approx(119.0, abs=2 * two_cells)
    assert abs((box.angle_deg - angle_deg + 90) % 180 - 90) < 12
    (x0, y0, x1, y1), (x_a, y_a, _, _) = box.corners_px, box.ends_px
    assert x0 <= x_a <= x1
    assert y0 <= y_a <= y1


def test_a_cluster_of_parallel_streaks_is_told_apart(network):
    places = [(400.0, 300.0), (520.0, 410.0), (470.0, 560.0)]
    boxes = _found(network, _sky(2, streaks=[_geo(x, y, 3.0) for x, y in places]))
    middles = [b.middle_px for b in boxes]
    assert len(boxes) == len(places)
    for x, y in places:
        assert min(np.hypot(mx - x, my - y) for mx, my in middles) < 16


def test_a_streak_cut_by_the_edge_is_still_seen(network):
    (box,) = _found(network, _sky(3, streaks=[_geo(20.0, 500.0, 5.0, peak_snr=9.0)]))
    assert box.corners_px[0] < 16


def test_the_papers_black_and_white_map_serves_too(network):
    (box,) = _found(network, _sky(4, streaks=[_geo(700.0, 300.0, 12.0, peak_snr=9.0)]), "paper")
    assert abs(box.middle_px[0] - 700.0) < 24


@pytest.mark.parametrize("seed", range(10, 16))
def test_stars_alone_raise_no_candidate(network, seed):
    assert _found(network, _sky(seed, stars=300 * (seed - 9))) == []


def test_a_map_larger_than_the_input_is_tiled_and_no_streak_counts_twice(network):
    sensor = dataclasses.replace(QUARTER, width_px=1800, height_px=1300)
    places = [(600.0, 450.0), (1215.0, 430.0), (900.0, 700.0), (1700.0, 1200.0), (60.0, 1250.0)]
    streaks = tuple(_geo(x, y, 20.0, length_px=50.0) for x, y in places)
    pixels = render(sensor, FieldContent(streaks=streaks), frame_rng(5))
    boxes = _found(network, pixels, block=2)
    assert len(boxes) == len(places)
    for x, _ in places:
        assert min(abs(b.middle_px[0] - x) for b in boxes) < 8


def test_a_frame_smaller_than_the_input_is_padded(network):
    small = _sky(6, streaks=[_geo(200.0, 150.0, 60.0)])[:300, :420]
    (box,) = _found(network, small)
    assert abs(box.middle_px[0] - 200.0) < 16


def test_the_same_map_gives_the_same_answer(network):
    frame_map = make_map(_sky(7, streaks=[_geo(500.0, 500.0, 80.0)]), "fast", 8)
    assert network.run(frame_map) == network.run(frame_map)


def test_loading_prints_nothing(capfd):
    Network.load(threads=1)
    captured = capfd.readouterr()
    assert captured.err == ""
    assert captured.out == ""


def test_a_copy_with_its_card_loads(copied):
    assert "streak_ssd" in Network.load(copied, threads=1).version


@pytest.mark.parametrize("damage", ["one bit", "truncated", "empty"])
def test_a_damaged_network_is_refused_before_it_is_loaded(copied, damage):
    content = bytearray(copied.read_bytes())
    content[len(content) // 2] ^= 1
    changed = {"one bit": content, "truncated": content[:1000], "empty": b""}[damage]
    copied.write_bytes(changed)
    with pytest.raises(ModelError, match=r"SHA-256.*reinstall rsoconsole"):
        Network.load(copied)


def test_a_missing_network_is_named(copied):
    copied.unlink()
    with pytest.raises(ModelError, match=r"streak_ssd.tflite cannot be read.*detector.model"):
        Network.load(copied)


@pytest.mark.parametrize("card", ["", "[]", "{}", '{"name": "x"'])
def test_a_network_without_a_readable_card_is_refused(copied, card):
    copied.with_suffix(".json").write_text(card)
    with pytest.raises(ModelError, match="reinstall rsoconsole"):
        Network.load(copied)


def test_a_network_for_another_map_is_refused(copied):
    card = json.loads(copied.with_suffix(".json").read_text())
    card["input"]["map"] = "brightest bins"
    copied.with_suffix(".json").write_text(json.dumps(card))
    with pytest.raises(ModelError, match=r"another kind of map.*train it again"):
        Network.load(copied)


def test_what_is_no_network_is_refused_even_with_the_right_digest(copied):
    import hashlib

    copied.write_bytes(b"not a network" * 100)
    card = json.loads(copied.with_suffix(".json").read_text())
    card["sha256"] = hashlib.sha256(copied.read_bytes()).hexdigest()
    copied.with_suffix(".json").write_text(json.dumps(card))
    with pytest.raises(ModelError, match="cannot be loaded"):
        Network.load(copied)
