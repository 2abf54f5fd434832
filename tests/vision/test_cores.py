"""How many threads a machine's cores ask for, and that their number changes no result."""

import os
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Frame
from rsoconsole.simulator import FieldContent, SensorModel, frame_rng, render, straight_streak
from rsoconsole.vision import (
    ConfidenceCurve,
    FrameAnalysis,
    Network,
    StreakDetector,
    available_cores,
    make_map,
    threads_for,
)
from rsoconsole.vision.frame import workers as cores

HALF = SensorModel(width_px=2328, height_px=1760)


@pytest.mark.parametrize(
    ("there", "wanted", "taken"),
    [(1, 0, 1), (2, 0, 2), (4, 0, 4), (16, 0, 4), (1, 3, 3), (16, 9, 9)],
)
def test_threads_follow_the_cores_unless_they_are_set(monkeypatch, there, wanted, taken):
    monkeypatch.setattr(cores, "available_cores", lambda: there)
    assert threads_for(wanted) == taken


def groups(folder: Path, **quotas: str) -> tuple[Path, Path]:
    """A tree of control groups: the topmost, one in it, and one in that."""
    for place, quota in quotas.items():
        group = folder / place.replace("_", "/")
        group.mkdir(parents=True, exist_ok=True)
        (group / "cpu.max").write_text(quota + "\n", encoding="ascii")
    own = folder / "own"
    own.write_text("0::/user/night\n", encoding="utf-8")
    return folder, own


@pytest.mark.parametrize(
    ("quotas", "cores_left"),
    [
        ({}, 8),
        ({"user": "max 100000", "user_night": "max 100000"}, 8),
        ({"user": "max 100000", "user_night": "150000 100000"}, 2),
        ({"user": "100000 100000", "user_night": "300000 100000"}, 1),
        ({"user_night": "1600000 100000"}, 8),
        ({"user_night": "nonsense"}, 8),
    ],
)
def test_a_quota_anywhere_above_the_process_counts(tmp_path, monkeypatch, quotas, cores_left):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    assert available_cores(*groups(tmp_path, **quotas)) == cores_left


def test_a_machine_without_control_groups_counts_its_affinity(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 5, 7})
    assert available_cores(tmp_path, tmp_path / "nothing") == 3


def drawn() -> Frame:
    """Half the paper's frame: stars, cosmic rays, two satellites and one too faint."""
    rng = frame_rng(5, 77)
    content = FieldContent(
        star_x_px=rng.uniform(0, HALF.width_px, 2500),
        star_y_px=rng.uniform(0, HALF.height_px, 2500),
        star_electrons=np.minimum(150.0 * (1 - rng.random(2500)) ** -1.1, 1e6),
        streaks=(
            straight_streak((611.0, 402.0), (729.0, 411.0), 30_000.0),
            straight_streak((1400.0, 1200.0), (1518.0, 1209.0), 18_000.0),
            straight_streak((900.0, 1500.0), (1018.0, 1509.0), 5_000.0),
        ),
        cosmic_rays=30.0,
    )
    return Frame(
        frame_id=1,
        name="drawn",
        pixels=render(HALF, content, rng),
        exposure_s=10.0,
        scale_arcsec_px=1.264,
        saturation_adu=65520.0,
    )


def looked_at(frame: Frame, threads: int) -> FrameAnalysis:
    settings = DetectorConfig(threads=threads)
    network = Network.load(settings.model, settings.threads)
    return StreakDetector(network, settings, ConfidenceCurve.from_card(network.card)).analyse(frame)


def test_the_number_of_threads_changes_no_bit_of_what_is_found():
    frame = drawn()
    alone = looked_at(frame, 1)
    assert len(alone.detections.detections) >= 2
    for threads in (2, 4):
        shared = looked_at(frame, threads)
        assert shared.detections.detections == alone.detections.detections
        assert shared.detections.rejected == alone.detections.rejected
        for name in ("x_px", "y_px", "flux"):
            assert np.array_equal(getattr(shared.stars, name), getattr(alone.stars, name))
        assert np.array_equal(shared.background.level, alone.background.level)
        assert np.array_equal(shared.background.noise, alone.background.noise)


def test_the_network_answers_alike_with_any_number_of_threads():
    frame_map = make_map(drawn().pixels, "fast", 8)
    answers = [Network.load(threads=threads).answer(frame_map.values) for threads in (1, 2, 4)]
    assert np.ptp(answers[0]) > 1.0
    assert all(np.array_equal(answers[0], answer) for answer in answers[1:])
