"""A looked-at frame against its truth, kept as a row, counted with exact intervals."""

import json
from pathlib import Path

import pytest

from models import rows as kept
from models.frames import TrueTrail, draw
from models.intervals import rate_interval, rate_upper_limit, share_interval
from models.judging import (
    NOT_PROPOSED,
    FrameRow,
    Judge,
    confidences_of,
    trail_of,
    without_figures,
)
from rsoconsole.base import model_file_path
from rsoconsole.config import DetectorConfig
from rsoconsole.simulator import SensorModel
from rsoconsole.vision import ConfidenceCurve, NetworkBox, StreakDetector
from rsoconsole.vision.detector.verifier import Verifier
from tests.makers import straight_detection

SMALL = SensorModel(width_px=1000, height_px=800)
CURVE = ConfidenceCurve.from_card(json.loads(model_file_path("streak_ssd.json").read_text()))


class Oracle:
    """Proposes what it is told to."""

    verifier = Verifier.load()

    def __init__(self, *boxes: NetworkBox) -> None:
        self._boxes = boxes

    def run(self, _frame_map) -> tuple[NetworkBox, ...]:
        return self._boxes


def box_on(trail: TrueTrail, confidence: float = 0.5) -> NetworkBox:
    xs, ys = sorted((trail.x_a_px, trail.x_b_px)), sorted((trail.y_a_px, trail.y_b_px))
    return NetworkBox(
        confidence=confidence,
        corners_px=(xs[0] - 4, ys[0] - 4, xs[1] + 4, ys[1] + 4),
        ends_px=(trail.x_a_px, trail.y_a_px, trail.x_b_px, trail.y_b_px),
    )


@pytest.fixture(scope="module")
def bright():
    """A small frame with a whole streak that nobody overlooks."""
    for number in range(60):
        true = draw("calibrate", "satellites", number, SMALL)
        first = true.trails[0] if len(true.trails) == 1 else None
        if first and not first.is_cut and first.peak_snr > 6 and first.length_px > 90:
            return true
    raise AssertionError("no such frame among the first")


def test_exact_intervals_are_those_of_the_published_tables():
    """Clopper and Pearson 1934; Garwood 1936; the rule of three."""
    assert share_interval(0, 10) == (0.0, pytest.approx(0.3085, abs=1e-4))
    assert share_interval(5, 10) == pytest.approx((0.1871, 0.8129), abs=1e-4)
    assert share_interval(10, 10) == (pytest.approx(0.6915, abs=1e-4), 1.0)
    assert share_interval(0, 0) == (0.0, 1.0)
    assert rate_interval(0, 1.0) == (0.0, pytest.approx(3.689, abs=1e-3))
    assert rate_interval(10, 2.0) == pytest.approx((4.795 / 2, 18.390 / 2), abs=1e-3)
    assert rate_upper_limit(0, 5.0) == pytest.approx(2.996 / 5, abs=1e-3)
    with pytest.raises(ValueError, match="is no share"):
        share_interval(4, 3)


TRAIL = TrueTrail(x_a_px=100.0, y_a_px=200.0, x_b_px=218.0, y_b_px=200.0, peak_snr=5, is_cut=False)


@pytest.mark.parametrize(
    ("candidate", "is_on"),
    [
        ({"x_px": 159.0, "y_px": 200.0}, True),
        ({"x_px": 190.0, "y_px": 203.0, "length_px": 60.0}, True),
        ({"x_px": 159.0, "y_px": 206.0}, False),
        ({"x_px": 230.0, "y_px": 200.0}, False),
        ({"x_px": 159.0, "y_px": 200.0, "angle_deg": 40.0}, False),
    ],
    ids=["on it", "a part of it", "beside it", "beyond its end", "across it"],
)
def test_a_candidate_is_a_satellite_only_on_its_trail_and_along_it(candidate, is_on):
    assert (trail_of(straight_detection(**candidate), (TRAIL,)) == 0) is is_on


def test_reasons_are_counted_by_their_words():
    assert without_figures("too short: 9.1 px, hardly longer") == "too short: # px, hardly longer"
    one, other = (
        "wider than a star (9.0 of 2.2 px): glare",
        "wider than a star (7 of 3.1 px): glare",
    )
    assert without_figures(one) == without_figures(other) == "wider than a star: glare"


def test_a_row_tells_what_was_found_and_how_far_off_and_where_the_rest_was_lost(
    bright, monkeypatch
):
    (trail,) = bright.trails
    row = Judge(Oracle(box_on(trail))).row(bright)
    # Beside it, one light of the field.
    (candidate,) = (each for each in row["candidates"] if each["trail"] == 0)
    assert candidate["is_taken"]
    assert candidate["measured"]["confidence"] == 0.5
    half_a_pixel = 0.5
    assert candidate["error_px"] < half_a_pixel
    assert row["trails"][0]["lost"] == ""
    by_the_filter = Judge(Oracle()).row(bright)
    assert [each["trail"] for each in by_the_filter["candidates"]].count(0) == 1
    search = "rsoconsole.vision.detector.proposal_search"
    monkeypatch.setattr(f"{search}.propose_lines", lambda *_: [])
    monkeypatch.setattr(f"{search}.short_lines", lambda *_, **__: [])
    blind = Judge(Oracle()).row(bright)
    assert blind["candidates"] == []
    assert blind["trails"][0]["lost"] == NOT_PROPOSED


def test_a_row_survives_the_disk_and_speaks_as_the_product_does(bright):
    proposals = Oracle(box_on(bright.trails[0]))
    row: FrameRow = json.loads(json.dumps(Judge(proposals).row(bright)))
    product = StreakDetector(proposals, DetectorConfig(threads=1), CURVE)
    said = [each.confidence for each in product.detect(bright.frame, tau=0.0).detections]
    assert max(said) > 0.5
    assert sorted(confidences_of(row, CURVE)) == pytest.approx(sorted(said), abs=1e-5)


def _row(kind: str, number: int) -> dict:
    return {"kind": kind, "number": number, "trails": [], "candidates": []}


def test_work_broken_off_in_the_middle_of_a_line_goes_on_and_nothing_is_done_twice(
    tmp_path, monkeypatch
):
    looked: list[tuple[str, str, int]] = []

    def look(task):
        looked.append(task)
        return _row(task[1], task[2])

    monkeypatch.setattr(kept, "_begin", lambda _sensor: None)
    monkeypatch.setattr(kept, "_look", look)
    done = "".join(json.dumps(_row("empty", n)) + "\n" for n in range(3))
    torn = json.dumps(_row("empty", 3))[:20]
    (tmp_path / "empty.jsonl").write_text(done + torn)
    found = kept.complete(tmp_path, "test", {"empty": 6, "rays": 2}, 1)
    assert [(r["kind"], r["number"]) for r in found] == [
        *(("empty", n) for n in range(6)),
        *(("rays", n) for n in range(2)),
    ]
    assert sorted(looked) == sorted(
        [*(("test", "empty", n) for n in (3, 4, 5)), *(("test", "rays", n) for n in (0, 1))]
    )
    looked.clear()
    assert len(kept.complete(tmp_path, "test", {"empty": 6}, 1)) == 6
    assert looked == []
    kept.complete(tmp_path, "test", {"empty": 2}, 1, again=True)
    assert len(looked) == 2


def test_other_code_or_another_network_means_other_rows(tmp_path, monkeypatch):
    root = tmp_path / "project"
    for name in (
        "models/frames.py",
        "rsoconsole/vision/frame/maps.py",
        "rsoconsole/vision/detector/confidence.py",
    ):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("one = 1\n")
    for name in ("streak_ssd", "line_verifier"):
        (root / f"models/{name}.tflite").write_bytes(b"net")
    (root / "models/streak_ssd.json").write_text('{"calibration": {"slope": 1.0}}')
    monkeypatch.setattr(kept, "HERE", root / "models")

    def after(name: str, text: str) -> str:
        Path(root / name).write_text(text)
        return kept.fingerprint()

    first = kept.fingerprint()
    assert after("rsoconsole/vision/detector/confidence.py", "two = 2\n") == first
    second = after("rsoconsole/vision/frame/maps.py", "two = 2\n")
    third = after("models/frames.py", "two = 2\n")
    fourth = after("models/streak_ssd.tflite", "another net")
    fifth = after("models/streak_ssd.json", '{"calibration": {"slope": 2.0}}')
    sixth = after("models/line_verifier.tflite", "another net")
    assert len({first, second, third, fourth, fifth, sixth}) == 6
