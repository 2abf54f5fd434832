"""The stars' width over the field: where it changes, where it does not, and what goes by it."""

import json

import numpy as np
import pytest

from models.frames import TrueFrame
from models.judging import Judge, confidences_of
from rsoconsole.base import model_file_path
from rsoconsole.config import DetectorConfig
from rsoconsole.simulator import FieldContent, SensorModel
from rsoconsole.vision import ConfidenceCurve, FrameAnalysis, StreakDetector, find_stars
from rsoconsole.vision.stars import stars as star_list
from rsoconsole.vision.stars.psf_field import MIN_STARS, Psf, fit_psf_field
from tests.drawn.soft_corners import (
    HEIGHT,
    PIXEL_FWHM,
    WIDTH,
    Ends,
    Proposes,
    about,
    drawn,
    middle,
    soft_and_tilted,
)

CURVE = ConfidenceCurve.from_card(json.loads(model_file_path("streak_ssd.json").read_text()))
IN_CENTRE: Ends = (540.0, 430.0, 658.0, 470.0)
IN_CORNER: Ends = (1010.0, 780.0, 1128.0, 820.0)
PLACES = [
    (0.5 * WIDTH, 0.5 * HEIGHT),
    *((x, y) for x in (0.0, WIDTH - 1.0) for y in (0.0, HEIGHT - 1.0)),
    *((0.0, 0.5 * HEIGHT), (0.25 * WIDTH, 0.25 * HEIGHT), (WIDTH - 1.0, 0.5 * HEIGHT)),
]


def evenly_wide(_x_px: float, _y_px: float) -> float:
    return 3.0


def seen(streak: Ends, network_confidence: float = 0.5) -> FrameAnalysis:
    network = Proposes(about(streak, network_confidence))
    detector = StreakDetector(network, DetectorConfig(threads=1), CURVE)
    return detector.analyse(drawn(soft_and_tilted, streak=streak), tau=0.0)


def on(streak: Ends, analysis: FrameAnalysis):
    """The detection of the streak that was drawn."""
    x, y = middle(streak)
    (found,) = [
        each
        for each in analysis.detections.detections
        if np.hypot(each.x_px - x, each.y_px - y) < 4.0
    ]
    return found


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_soft_corners_and_a_tilt_are_known_to_a_tenth_wherever_one_asks(seed):
    stars = find_stars(drawn(soft_and_tilted, seed=seed).pixels)
    for x, y in PLACES:
        true_px = np.hypot(soft_and_tilted(x, y), PIXEL_FWHM)
        assert stars.fwhm_at(x, y) == pytest.approx(true_px, rel=0.1), (x, y)


def test_a_bowl_about_another_place_than_the_middle_is_found_there():
    def decentred(x_px, y_px):
        return 2.5 * np.exp(0.8 * ((x_px - 300) ** 2 + (y_px - 300) ** 2) / 600**2)

    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, WIDTH, 200), rng.uniform(0, HEIGHT, 200)
    field = fit_psf_field(x, y, decentred(x, y) * np.exp(rng.normal(0, 0.05, 200)), (HEIGHT, WIDTH))
    assert field is not None
    asked = np.array([[field.at(x, y) for x in range(0, WIDTH, 50)] for y in range(0, HEIGHT, 50)])
    row, column = np.unravel_index(np.argmin(asked), asked.shape)
    assert np.hypot(50 * column - 300, 50 * row - 300) < 75


@pytest.mark.parametrize("count", [MIN_STARS, 100, 400])
def test_scatter_and_blends_alone_make_no_change_over_the_field(count):
    """8 % of scatter, and one star in six a blend up to twice as wide; 100 fields."""
    rng = np.random.default_rng(count)
    for _ in range(100):
        x, y = rng.uniform(0, WIDTH, count), rng.uniform(0, HEIGHT, count)
        blend = np.where(rng.random(count) < 1 / 6, rng.uniform(1, 2, count), 1.0)
        widths = 2.5 * np.exp(rng.normal(0, 0.08, count)) * blend
        assert fit_psf_field(x, y, widths, (HEIGHT, WIDTH)) is None


def test_a_change_that_is_real_but_small_does_not_count_and_a_larger_one_does():
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, WIDTH, 300), rng.uniform(0, HEIGHT, 300)
    scatter = np.exp(rng.normal(0, 0.02, 300))
    for change, counts in ((0.06, False), (0.12, True)):
        widths = 3.0 * (1.0 + change * x / WIDTH) * scatter
        assert (fit_psf_field(x, y, widths, (HEIGHT, WIDTH)) is not None) is counts


def test_too_few_stars_and_stars_that_differ_wildly_tell_of_no_change():
    rng = np.random.default_rng(9)
    x, y = rng.uniform(0, WIDTH, 400), rng.uniform(0, HEIGHT, 400)
    widths = 3.0 * (1.0 + x / WIDTH)
    few = slice(MIN_STARS - 1)
    assert fit_psf_field(x[few], y[few], widths[few], (HEIGHT, WIDTH)) is None
    wild = widths * np.exp(rng.normal(0, 0.4, 400))
    assert fit_psf_field(x, y, wild, (HEIGHT, WIDTH)) is None


def test_where_the_width_is_the_same_everywhere_it_is_the_median_to_the_last_bit(monkeypatch):
    frame = drawn(evenly_wide, streak=IN_CORNER)
    detector = StreakDetector(Proposes(about(IN_CORNER)), DetectorConfig(threads=1), CURVE)
    analysis = detector.analyse(frame, tau=0.0)
    stars = analysis.stars
    assert stars.psf_field is None
    assert all(stars.fwhm_at(*place) == stars.median_fwhm_px for place in PLACES)
    monkeypatch.setattr(star_list, "fit_psf_field", lambda *_: None)
    without = detector.analyse(frame, tau=0.0)
    assert without.detections.detections == analysis.detections.detections
    assert without.focus == analysis.focus


def test_no_honest_star_of_a_soft_corner_is_left_out():
    """Beyond 2.5 of the median's widths nothing counts as a star; these are honest ones."""

    def steep(x_px, y_px):
        return 1.8 + 5.0 * (x_px / WIDTH) ** 4

    frame = drawn(steep, count=300, seed=4)
    stars = find_stars(frame.pixels)
    assert 2.5 * stars.median_fwhm_px < steep(WIDTH, 0)
    wide = stars.fwhm_px > 2.5 * stars.median_fwhm_px
    assert np.count_nonzero(wide & (stars.x_px > 0.9 * WIDTH)) >= 5


def test_a_streak_in_a_soft_corner_is_as_wide_as_the_stars_there():
    for streak in (IN_CENTRE, IN_CORNER):
        analysis = seen(streak)
        found = on(streak, analysis)
        ratio = found.width_px / analysis.focus.at(found.x_px, found.y_px).fwhm_px
        assert ratio == pytest.approx(1.0, abs=0.1), streak
        assert found.object_class == "satellite"


def test_a_streak_in_a_soft_corner_is_believed_as_one_in_the_centre():
    def believed(streak):
        return on(streak, seen(streak, network_confidence=0.01)).confidence

    centre, corner = believed(IN_CENTRE), believed(IN_CORNER)
    assert corner == pytest.approx(centre, abs=0.05)


def test_a_change_in_a_frame_of_joined_pixels_is_told_in_the_camera_s():
    def wide(x_px, y_px):
        return 3.0 * soft_and_tilted(x_px, y_px)

    analysis = StreakDetector(Proposes(), DetectorConfig(threads=1), CURVE).analyse(
        drawn(wide, count=120, seed=5)
    )
    assert analysis.focus.joined > 1
    for x, y in PLACES[:5]:
        true_px = np.hypot(wide(x, y), PIXEL_FWHM * analysis.focus.joined)
        assert analysis.stars.fwhm_at(x, y) == pytest.approx(true_px, rel=0.12), (x, y)


def test_few_stars_set_the_level_of_a_change_that_earlier_frames_showed():
    known = find_stars(drawn(soft_and_tilted).pixels)
    before = Psf(fwhm_px=known.median_fwhm_px, field=known.psf_field)

    def poorer_seeing(x_px, y_px):
        return 1.3 * soft_and_tilted(x_px, y_px)

    stars = find_stars(drawn(poorer_seeing, count=20, seed=8).pixels, expected=before)
    assert stars.width_source == "measured"
    assert len(stars) < MIN_STARS
    for x, y in PLACES[:5]:
        assert stars.fwhm_at(x, y) == pytest.approx(poorer_seeing(x, y), rel=0.15), (x, y)


def test_a_row_of_a_frame_with_soft_corners_speaks_as_the_product_does():
    frame = drawn(soft_and_tilted, streak=IN_CORNER)
    true = TrueFrame(
        frame=frame, kind="empty", trails=(), content=FieldContent(), sensor=SensorModel()
    )
    row = json.loads(json.dumps(Judge(Proposes(about(IN_CORNER))).row(true)))  # type: ignore[arg-type]
    said = sorted(each.confidence for each in seen(IN_CORNER).detections.detections)
    assert row["focus"]["psf_field"] is not None
    assert sorted(confidences_of(row, CURVE)) == pytest.approx(said, abs=1e-5)
