"""The making of the network, as far as it can be tested without PyTorch: truth and judgement."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.dataset import SHARDS, SPLITS, draw_shard, read_shard, shard_path, write_shard
from models.extras import Canvas
from models.field_scene import draw_field, draw_sensor
from models.fields import FIELD_CELLS, Conditions, Field, TrueStreak, clip_to_box, is_asked_for
from models.nights import CALIBRATION_NIGHTS, TEST_NIGHTS
from models.satellites import Satellites
from models.scoring import fit_platt, score
from models.targets import targets_of
from models.turning import cropped, turned
from rsoconsole.simulator import FieldContent, SensorModel, frame_rng, straight_streak
from rsoconsole.simulator.camera.rendering import expected_electrons

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
    monkeypatch.setattr("models.dataset.FIELDS_PER_SHARD", 2)
    monkeypatch.setattr("models.dataset.BLOCKS", (2,))
    keys = [*SPLITS.values(), CALIBRATION_NIGHTS, TEST_NIGHTS]
    assert len(set(keys)) == len(keys)
    drawn = [
        field.values.tobytes()
        for split in SHARDS
        for number in range(2)
        for field in draw_shard(9, split, number)
    ]
    assert len(set(drawn)) == len(drawn) == 12


def test_a_cut_field_keeps_its_streaks_on_their_light():
    field = _draw(4, kind="ordinary", mode="fast", peak_snr=(15.0, 20.0), streaks=(3, 3))
    cut = cropped(field, 30, 20, 128)
    assert cut.values.shape == (128, 128)
    seen = 0
    for before, after in zip(field.streaks, cut.streaks, strict=True):
        assert after.length == pytest.approx(before.length)
        xs, ys = (after.x_a, after.x_b), (after.y_a, after.y_b)
        if min(*xs, *ys) > 0 and max(*xs, *ys) < 128:
            assert _brightness_along(cut, after) == pytest.approx(_brightness_along(field, before))
            seen += 1
    assert seen


def test_a_short_bright_streak_is_asked_for_and_is_where_its_truth_says():
    field = _draw(
        11, 8, kind="ordinary", mode="fast", peak_snr=(24.0, 25.0), streak_cells=(4.0, 5.0)
    )
    for streak in field.streaks:
        assert streak.is_asked
        assert _brightness_along(field, streak) > 200
        ux, uy = (
            (streak.x_b - streak.x_a) / streak.length,
            (streak.y_b - streak.y_a) / streak.length,
        )
        for x, y, sign in ((streak.x_a, streak.y_a, -1), (streak.x_b, streak.y_b, 1)):
            beyond = field.values[int(y + sign * 2.5 * uy), int(x + sign * 2.5 * ux)]
            assert beyond < 150


def test_a_short_streak_needs_more_light_than_a_long_one():
    assert is_asked_for(5.0, 20.0, 3.75, "fast", 8)
    assert not is_asked_for(2.5, 20.0, 3.75, "fast", 8)
    assert is_asked_for(3.0, 20.0, 12.0, "fast", 8)
    assert not is_asked_for(5.0, 20.0, 3.75, "paper", 8)


def test_a_long_faint_streak_is_asked_for_by_its_integrated_light():
    assert is_asked_for(0.85, 12.1, 15.0, "fast", 8)
    assert not is_asked_for(0.85, 11.9, 15.0, "fast", 8)
    # Spread over the whole field its light is in no cell.
    assert not is_asked_for(0.3, 20.0, 250.0, "fast", 8)


def _one_streak(kind: str, x_a: float, x_b: float) -> Field:
    streak = TrueStreak(
        x_a=x_a,
        y_a=30.0,
        x_b=x_b,
        y_b=30.0,
        peak_snr=9.0,
        integrated_snr=99.0,
        is_asked=True,
    )
    values = np.zeros((64, 64), dtype=np.uint8)
    return Field(values=values, kind=kind, mode="fast", block=8, streaks=(streak,))


def test_targets_say_nothing_of_a_trail_from_edge_to_edge_and_of_a_stump():
    assert targets_of(_one_streak("ordinary", 20, 40))[0].max() == 1.0
    for x_a, x_b in ((-10.0, 80.0), (60.0, 90.0)):
        target = targets_of(_one_streak("ordinary", x_a, x_b))
        assert target[0].max() == 0.0
        assert target[6, 7, 15] == 0.0


def test_a_false_candidate_beside_an_aircraft_costs_more():
    ordinary, aircraft = (targets_of(_one_streak(k, 20, 40)) for k in ("ordinary", "aircraft"))
    assert aircraft[6, 1, 1] > ordinary[6, 1, 1]
    best = ordinary[0] == 1.0
    assert np.array_equal(aircraft[6][best], ordinary[6][best])


@pytest.mark.parametrize("kind", ["trailed stars", "aircraft", "rays", "meteor"])
def test_the_nuisances_are_drawn_and_hold_only_the_satellites_asked_for(kind):
    field = _draw(12, kind=kind, mode="fast", streaks=(0, 0))
    assert field.streaks == ()
    assert (field.values == 255).mean() > (
        _draw(12, kind="empty", mode="fast").values == 255
    ).mean()


def test_in_a_trailed_field_only_what_differs_from_the_stars_is_asked_for():
    asked = 0
    for seed in range(30, 60):
        rng = frame_rng(seed)
        sensor = replace(draw_sensor(2, rng, is_hard=False), seed=1)
        canvas = Canvas(width_px=384, height_px=384, fwhm_px=2.2, noise_e=12.0, unit_px=2.0)
        path = np.stack([np.linspace(-15, 15, 9), np.zeros(9)])
        satellites = Satellites(
            sensor=sensor,
            canvas=canvas,
            content=FieldContent(),
            mode="fast",
            block=2,
            conditions=Conditions(
                peak_snr=(9.0, 9.0), streak_cells=(20.0, 20.0), streaks=(1, 1), is_hard=False
            ),
            rng=rng,
        )
        for streak in satellites.draw(path)[1]:
            slope = abs(streak.y_b - streak.y_a) / streak.length
            if streak.length < 11:
                continue
            assert streak.is_asked == (slope > np.sin(np.radians(25)))
            asked += streak.is_asked
    assert 5 < asked < 30


@pytest.mark.parametrize("defocus_px", [0.0, 3.5])
def test_a_streak_is_as_high_above_the_noise_as_was_asked(defocus_px):
    canvas = Canvas(width_px=200, height_px=80, fwhm_px=2.2, noise_e=12.0, defocus_px=defocus_px)
    sensor = SensorModel(width_px=200, height_px=80, vignetting_corner=0, prnu=0, hot_fraction=0)
    trail = straight_streak((40.0, 40.0), (160.0, 40.0), canvas.line_e_per_px(6.0) * 120.0)
    dark = FieldContent(fwhm_px=2.2, defocus_px=defocus_px)
    lit = replace(dark, streaks=(trail,))
    light = expected_electrons(sensor, lit) - expected_electrons(sensor, dark)
    # The wings of the disc hold an eighth of the light.
    assert light[:, 100].max() / 12.0 == pytest.approx(6.0, rel=0.13)


def test_drawing_needs_no_more_than_the_training_environment_has():
    code = (
        "import sys, models.batches, models.dataset, models.nights\n"
        "names = {name.split('.')[0] for name in sys.modules}\n"
        "print(sorted(names & {'astropy', 'pydantic', 'textual', 'PyIndi', 'ai_edge_litert'}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"


def test_a_kill_costs_nothing_but_time(tmp_path):
    """Six steps at once are, bit for bit, three and three with a fresh start between."""
    torch = pytest.importorskip("torch")
    from models.train import Training

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    fields = [_draw(seed, kind="ordinary", mode="fast") for seed in range(4)]
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    one = Training(tmp_path / "one", 5, 6, side=64)
    for _ in range(6):
        one.one_step(fields)
    begun = Training(tmp_path / "two", 5, 6, side=64)
    for _ in range(3):
        begun.one_step(fields)
    begun.save()
    begun.one_step(fields)
    again = Training(tmp_path / "two", 5, 6, side=64)
    for _ in range(3):
        again.one_step(fields)
    torch.set_num_threads(threads)
    for straight, resumed in ((one.net, again.net), (one.average, again.average)):
        for name, value in straight.state_dict().items():
            assert torch.equal(value, resumed.state_dict()[name]), name


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
