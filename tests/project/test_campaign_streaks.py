"""The families of altered frames are what they say, and are judged by where things really are."""

import math

import numpy as np
import pytest

from models.altered import FAMILIES, LONG_PX, SNR, draw, draw_altered
from models.telescopes import telescope
from tests.campaign import bands, rows_kept, streaks
from tests.makers import straight_detection


@pytest.mark.nightly("draws a frame of each family three times")
@pytest.mark.parametrize("name", FAMILIES)
def test_a_frame_is_drawn_again_and_its_streak_is_where_the_truth_says(name):
    frame, truth, _ = draw(name, 1)
    assert np.array_equal(draw(name, 1)[0].pixels, frame.pixels)
    assert not np.array_equal(draw(name, 2)[0].pixels, frame.pixels)
    family = FAMILIES[name]
    if name != "faint":
        assert family.low <= truth.severity <= family.high
        assert family.snr == SNR or name in {"telescope", "limit"}
    assert truth.snr == pytest.approx(np.clip(truth.snr, *family.snr), rel=0.05)
    # Light along the line, against light as far beside it: by the median, which no star lifts.
    along = np.linspace(0.05, 0.95, 400)
    x = truth.x_a_px + along * (truth.x_b_px - truth.x_a_px)
    y = truth.y_a_px + along * (truth.y_b_px - truth.y_a_px)
    angle = math.atan2(truth.y_b_px - truth.y_a_px, truth.x_b_px - truth.x_a_px)
    if name in {"faint", "limit"}:
        # At a signal to noise of 10 a line's light is not that of its neighbourhood's median.
        return
    away = {
        far: _light(frame.pixels, x - far * math.sin(angle), y + far * math.cos(angle))
        for far in (0.0, 40.0, -40.0)
    }
    assert away[0.0] > max(away[40.0], away[-40.0])


def _light(pixels: np.ndarray, x: np.ndarray, y: np.ndarray) -> float:
    rows = np.clip(np.rint(y).astype(int), 0, pixels.shape[0] - 1)
    columns = np.clip(np.rint(x).astype(int), 0, pixels.shape[1] - 1)
    near = [pixels[np.clip(rows + dy, 0, pixels.shape[0] - 1), columns] for dy in (-1, 0, 1)]
    cut = np.percentile(near, 90.0)
    return float(np.mean(np.minimum(near, cut)))


def test_telescopes_differ_and_confidence_is_judged_by_thirds_of_them():
    many = [telescope(number) for number in range(300)]
    for low, high, values in (
        (0.3, 10.0, [each.sensor.scale_arcsec_px for each in many]),
        (0.05, 60.0, [each.exposure_s for each in many]),
        (1.2, 8.0, [each.fwhm_px for each in many]),
        (0.3, 61.0, [each.sensor.width_px * each.sensor.height_px / 1e6 for each in many]),
    ):
        assert low * 0.99 <= min(values) < 1.5 * low
        assert high / 1.5 < max(values) <= high
    rows = [
        {"severity": number, "confidence": 0.9, "false_confidences": [0.2] * (number % 10 == 0)}
        for number in range(300)
    ]
    for line in bands.thirds(rows):
        assert line.said == pytest.approx((0.9 + 0.02) / 1.1, abs=0.02)
        assert line.share == pytest.approx(1.0 / 1.1, abs=0.03)
    assert len(bands.thirds(rows)) == 6


def test_what_is_near_the_limit_is_told_by_signal_to_noise_and_length():
    rows = [
        {"snr": snr, "length_px": length_px, "confidence": 0.9 if snr > 10.0 else 0.01}
        for snr in (9.5, 11.0, 13.0, 24.0)
        for length_px in (40.0, 100.0)
    ]
    cells = [line.split("|")[1:-1] for line in bands.at_the_limit(rows).splitlines()[2:]]
    assert [cell.strip()[:6] for cell in cells[0]] == ["9 to 1", "1 of 2", "1 of 2"]
    assert [cells[line][1].strip()[:6] for line in (1, 2, 3)] == ["1 of 1", "0 of 1", "1 of 1"]


def test_the_severity_is_in_the_pixels():
    frame, truth, _ = draw("stripes", 3)
    rows = np.median(frame.pixels.astype(float), axis=1)
    steps = np.diff(frame.pixels[:, ::7].astype(float), axis=1)
    noise = 1.4826 * np.median(np.abs(steps)) / math.sqrt(2.0)
    # Columns differ too, by half as much: neighbours' difference holds both.
    noise /= math.sqrt(1.0 + (0.5 * truth.severity) ** 2)
    found = 1.4826 * np.median(np.abs(rows - np.median(rows)))
    assert found / noise == pytest.approx(truth.severity, rel=0.1)


def test_long_ones_are_long():
    for number in range(3):
        _, truth, _ = draw("long", number)
        length = math.hypot(truth.x_b_px - truth.x_a_px, truth.y_b_px - truth.y_a_px)
        assert LONG_PX[0] <= length <= LONG_PX[1]


def test_faint_ones_are_altered_in_turn():
    assert all(10.0 * 0.95 <= draw("faint", number)[1].snr <= 20.0 * 1.05 for number in (0, 4))
    severities = [draw("faint", number)[1].severity for number in (0, 1)]
    assert severities[0] == 0.0  # as it is
    assert 0.0 < severities[1] <= FAMILIES["blur"].high


@pytest.mark.parametrize(
    ("change", "is_on"),
    [
        ({}, True),
        ({"x_px": 325.0}, True),
        ({"x_px": 340.0}, False),
        ({"y_px": 208.0}, False),
        ({"angle_deg": 8.0}, False),
    ],
)
def test_what_counts_as_found(change, is_on):
    trail = (241.0, 200.0, 359.0, 200.0)
    assert streaks.is_on(straight_detection(**change), trail) is is_on


def test_what_is_known_is_not_looked_at_again(tmp_path, monkeypatch):
    asked = []

    def row(name, number):
        asked.append(number)
        return {"number": number, "confidence": 0.9, "off_px": 0.1, "false": 0, "lost": ""}

    monkeypatch.setattr(streaks, "row_of", row)
    monkeypatch.setattr(rows_kept, "ProcessPoolExecutor", _InThisProcess)
    streaks.run("plain", 3, tmp_path, 1)
    streaks.run("plain", 5, tmp_path, 1)
    assert asked == [0, 1, 2, 3, 4]
    assert "5 of 5" in streaks.table(tmp_path)


class _InThisProcess:
    def __init__(self, _jobs):
        self.map = map

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


def test_a_row_is_of_the_product_s_own_detector():
    row = streaks.row_of("plain", 1)
    assert row["confidence"] > 0.9
    assert row["off_px"] < 2.0


def test_what_the_curve_is_fitted_on_is_not_what_is_judged():
    """Another sky, other streaks; its trails are all that are in the frame, as far as it goes."""
    crossings = list(FAMILIES).index("crossings")
    true = draw_altered("calibrate", crossings)
    frame, truth, others = draw("crossings", crossings)
    assert true.frame.pixels.shape == frame.pixels.shape
    assert not np.array_equal(true.frame.pixels, frame.pixels)
    own, *beside = true.trails
    assert not own.is_cut
    assert math.hypot(own.middle_px[0] - truth.x_a_px, own.middle_px[1] - truth.y_a_px) > 1.0
    assert 1 <= len(beside) <= 3
    assert all(trail.is_cut for trail in beside)
    for trail in true.trails:
        for x, y in ((trail.x_a_px, trail.y_a_px), (trail.x_b_px, trail.y_b_px)):
            assert -1.0 <= x <= frame.width_px
            assert -1.0 <= y <= frame.height_px
    assert others
