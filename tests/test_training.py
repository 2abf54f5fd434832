"""The making of the network, as far as it can be tested without PyTorch: truth and judgement."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.dataset import draw_shard, read_shard, shard_path, write_shard
from models.field_scene import draw_field, draw_sensor
from models.fields import FIELD_CELLS, Conditions, Field, TrueStreak, clip_to_box
from models.scoring import fit_platt, score
from models.targets import targets_of
from models.turning import turned
from rsoconsole.simulator.render import frame_rng

coordinates = st.floats(-300, 500, allow_nan=False)


def _draw(seed: int, block: int = 2, **wanted) -> Field:
    rng = frame_rng(seed)
    sensor = draw_sensor(block, rng, is_hard=False)
    return draw_field(sensor, block, Conditions(is_hard=False, **wanted), rng)


def _brightness_along(field: Field, streak: TrueStreak) -> float:
    share = np.linspace(0.1, 0.9, 40)
    x = streak.x_a + share * (streak.x_b - streak.x_a)
    y = streak.y_a + share * (streak.y_b - streak.y_a)
    return float(field.values[y.astype(int), x.astype(int)].mean())


@given(coordinates, coordinates, coordinates, coordinates)
def test_a_clipped_segment_lies_inside_and_on_the_line(x_a, y_a, x_b, y_b):
    seen = clip_to_box((x_a, y_a, x_b, y_b), 192, 100)
    samples = np.linspace(0, 1, 401)
    x, y = x_a + samples * (x_b - x_a), y_a + samples * (y_b - y_a)
    inside = (x > 1e-6) & (x < 192 - 1e-6) & (y > 1e-6) & (y < 100 - 1e-6)
    if seen is None:
        assert not inside.any()
        return
    for px, py in (seen[:2], seen[2:]):
        assert -1e-6 <= px <= 192 + 1e-6
        assert -1e-6 <= py <= 100 + 1e-6
        area = (px - x_a) * (y_b - y_a) - (py - y_a) * (x_b - x_a)
        assert abs(area) <= 1e-6 * (1 + np.hypot(x_b - x_a, y_b - y_a) ** 2)
    if inside.any():
        reach = np.hypot(seen[2] - seen[0], seen[3] - seen[1])
        step = np.hypot(x_b - x_a, y_b - y_a) / 400
        assert reach >= (inside.sum() - 1) * step - 1e-6


@pytest.mark.parametrize("block", [2, 8])
def test_truth_lies_on_the_light_that_was_drawn(block):
    field = _draw(3, block, kind="ordinary", mode="fast", peak_snr=(15.0, 20.0), streaks=(2, 2))
    assert len(field.streaks) == 2
    for streak in field.streaks:
        assert _brightness_along(field, streak) > np.median(field.values) + 60


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_truth_turns_with_the_picture(turns, is_mirrored):
    field = _draw(4, kind="ordinary", mode="fast", peak_snr=(15.0, 20.0), streaks=(2, 2))
    moved = turned(field, turns, is_mirrored=is_mirrored)
    for before, after in zip(field.streaks, moved.streaks, strict=True):
        assert after.length == pytest.approx(before.length)
        assert _brightness_along(moved, after) > 0.8 * _brightness_along(field, before)


def test_empty_and_trailed_fields_hold_no_satellite():
    assert _draw(5, kind="empty").streaks == ()
    assert _draw(5, kind="trailed stars").streaks == ()


def test_a_shard_is_the_same_from_the_same_seed_and_survives_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr("models.dataset.FIELDS_PER_SHARD", 3)
    monkeypatch.setattr("models.dataset.BLOCKS", (2,))
    drawn = draw_shard(9, "train", 0)
    write_shard(tmp_path, 9, "train", 0)
    stored = read_shard(shard_path(tmp_path, "train", 0))
    for one, other in zip(drawn, stored, strict=True):
        assert np.array_equal(one.values, other.values)
        assert (one.kind, one.mode, one.block) == (other.kind, other.mode, other.block)
        assert [s.is_asked for s in one.streaks] == [s.is_asked for s in other.streaks]
        for a, b in zip(one.streaks, other.streaks, strict=True):
            assert a.x_a == pytest.approx(b.x_a, abs=1e-3)


def test_no_two_splits_share_a_field(monkeypatch):
    monkeypatch.setattr("models.dataset.FIELDS_PER_SHARD", 1)
    monkeypatch.setattr("models.dataset.BLOCKS", (2,))
    (one,), (other,) = draw_shard(9, "train", 0), draw_shard(9, "test", 0)
    assert not np.array_equal(one.values, other.values)


def _perfect(field: Field):
    target = targets_of(field)
    answer = target[:6].copy()
    answer[0] = np.where(target[0] > 0, 10 * target[0] - 5, -20)
    return lambda _values: answer


def test_perfect_answers_score_perfectly_and_silence_scores_nothing():
    field = _draw(6, kind="ordinary", mode="fast", peak_snr=(5.0, 9.0), streaks=(1, 1))
    best = score([field], _perfect(field))
    assert best.recall(0.0) == 1.0
    assert len(best.false_logits) == 0
    assert best.middle_errors.max() < 1e-3
    silent = score([field], lambda _values: np.full((6, 48, 48), -20, dtype=np.float32))
    assert silent.recall(0.0) == 0.0


def test_a_candidate_far_from_every_streak_is_false():
    field = _draw(7, kind="empty")
    answer = np.full((6, 48, 48), -20, dtype=np.float32)
    answer[:, 20, 20] = [3.0, 0, 0, 0, 1, 0]
    result = score([field], lambda _values: answer)
    assert list(result.false_logits) == [3.0]
    assert result.cells == FIELD_CELLS**2


def test_targets_ask_nothing_near_a_streak_too_faint_to_ask_for():
    faint = _draw(8, kind="ordinary", mode="fast", peak_snr=(0.3, 0.4), streaks=(1, 1))
    target = targets_of(faint)
    assert target[0].max() == 0.0
    assert 0 < (target[6] == 0).sum() < 400


def test_platts_curve_returns_the_odds_the_candidates_were_drawn_with():
    rng = np.random.default_rng(1)
    x = rng.uniform(-4, 4, 40000)
    is_true = rng.random(40000) < 1 / (1 + np.exp(-(1.7 * x - 0.8)))
    slope, offset = fit_platt(x[is_true], x[~is_true])
    assert slope == pytest.approx(1.7, abs=0.1)
    assert offset == pytest.approx(-0.8, abs=0.1)
