"""The detector: what is taken, what is refused and why; the network stands in as a proposer."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.instruments import read_frame
from rsoconsole.records import FloatArray, Frame
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.vision import (
    FEATURES,
    Box,
    ConfidenceCurve,
    FrameAnalysis,
    FrameMap,
    NetworkBox,
    StreakDetector,
    fit_streak,
    is_same_streak,
)
from rsoconsole.vision.detector._reject_artifacts import TRAILED_STREAKS
from rsoconsole.vision.detector.detector import MAX_FITS
from rsoconsole.vision.lines.line_images import LineImages
from rsoconsole.words import text

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
Point = tuple[float, float]


class Proposals:
    """Answers every map with the same candidates."""

    def __init__(self, *boxes: NetworkBox, verifier: "Says | None" = None) -> None:
        self.boxes = boxes
        self.verifier = verifier
        self.maps: list[FrameMap] = []

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        self.maps.append(frame_map)
        return self.boxes


class Says:
    """A verifier that says one thing of lines in the upper half of a frame, one of the others."""

    def __init__(self, above: float, below: float) -> None:
        self.above, self.below = above, below
        self.asked = 0

    def log_odds(self, lines: LineImages) -> FloatArray:
        self.asked += len(lines.ends)
        return np.where(lines.ends[:, 1] < 256.0, self.above, self.below)


def candidate(a: Point, b: Point, confidence: float) -> NetworkBox:
    (x0, x1), (y0, y1) = sorted((a[0], b[0])), sorted((a[1], b[1]))
    return NetworkBox(
        confidence=confidence,
        corners_px=(x0 - 4, y0 - 4, x1 + 4, y1 + 4),
        ends_px=(a[0] + 2, a[1] - 2, b[0] + 2, b[1] + 2),
    )


def frame_with(*streaks: tuple[Point, Point], size: int = 512) -> Frame:
    light = np.zeros((size, size), dtype=np.float32)
    for a, b in streaks:
        t = (np.arange(500) + 0.5) / 500
        flux = np.full(500, 600 * np.hypot(b[0] - a[0], b[1] - a[1]) / 500, dtype=np.float32)
        x, y = a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t
        add_points(light, x, y, flux, sigma_px=0.95, faintest_e=0.01)
    noise = np.random.default_rng(1).normal(0, 38, light.shape)
    pixels = np.clip(np.rint(730 + light + noise), 0, 65535).astype(np.uint16)
    return Frame(frame_id=9, name="synthetic", pixels=pixels)


A, B = (100.0, 200.0), (218.0, 215.0)
C, D = (260.0, 300.0), (378.0, 315.0)


def analyse(frame: Frame, *boxes: NetworkBox, **settings: object) -> FrameAnalysis:
    return StreakDetector(Proposals(*boxes), DetectorConfig(**settings)).analyse(frame)  # type: ignore[arg-type]


def test_midpoints_are_measured_and_the_most_confident_comes_first() -> None:
    found = analyse(frame_with((A, B), (C, D)), candidate(C, D, 0.4), candidate(A, B, 0.8))
    first, second = found.detections.detections
    assert (first.confidence, second.confidence) == (0.8, 0.4)
    assert first.method == "line"
    assert first.frame_id == 9
    half_a_pixel = 0.5
    assert np.hypot(first.x_px - 159, first.y_px - 207.5) < half_a_pixel
    assert np.hypot(second.x_px - 319, second.y_px - 307.5) < half_a_pixel
    assert found.detections.rejected == ()


def test_threads_change_nothing_but_the_time() -> None:
    frame = frame_with((A, B), (C, D))
    alone, shared = (
        analyse(frame, candidate(A, B, 0.8), candidate(C, D, 0.4), threads=threads)
        for threads in (1, 3)
    )
    assert shared.detections.detections == alone.detections.detections
    assert np.array_equal(shared.stars.x_px, alone.stars.x_px)
    assert np.array_equal(shared.background.level, alone.background.level)
    assert np.array_equal(shared.background.noise, alone.background.noise)


def test_every_stage_is_timed_and_the_background_is_handed_on() -> None:
    found = analyse(frame_with((A, B)), candidate(A, B, 0.8))
    assert set(found.detections.stage_ms) == {
        *("pattern", "background", "stars", "lines", "map", "network"),
        *("fit", "judge", "class"),
    }
    assert found.background.level.size > 0
    assert len(found.stars) == 0


def test_below_tau_is_rejected_with_both_numbers() -> None:
    detector = StreakDetector(Proposals(candidate(A, B, 0.06)), DetectorConfig())
    found = detector.detect(frame_with((A, B)))
    assert found.detections == ()
    assert [text(r.reason) for r in found.rejected] == ["confidence 0.06 below tau 0.10"]
    assert found.rejected[0].detection.length_px == pytest.approx(119, abs=1.5)
    assert len(detector.detect(frame_with((A, B)), tau=0.05).detections) == 1


def curve(**weights: float) -> ConfidenceCurve:
    table = {"constant": 2.0, "network": 1.0} | weights
    return ConfidenceCurve(tuple(table.get(name.rpartition(" ")[2], 0.0) for name in FEATURES))


def test_what_the_verifier_gives_no_hope_is_not_measured(monkeypatch) -> None:
    monkeypatch.setattr("rsoconsole.vision.detector.proposal_search.propose_lines", lambda *_: [])
    frame, boxes = frame_with((A, B), (C, D)), (candidate(A, B, 0.8), candidate(C, D, 0.012))
    doubting = curve(constant=-2.5)
    says = Says(above=5.0, below=-9.0)
    strict = StreakDetector(Proposals(*boxes, verifier=says), DetectorConfig(), doubting)
    found = strict.detect(frame)
    assert [d.method for d in found.detections] == ["line"]
    assert [text(r.reason) for r in found.rejected] == ["unlike a streak, by the verifier"]
    assert says.asked >= 2


def test_the_verifier_s_word_on_the_measured_line_is_what_counts(monkeypatch) -> None:
    monkeypatch.setattr("rsoconsole.vision.detector.proposal_search.propose_lines", lambda *_: [])
    frame, box = frame_with((A, B)), candidate(A, B, 0.05)
    believed = curve(verifier=1.0, constant=-3.0)
    for says, is_found in ((Says(8.0, 0.0), True), (Says(-5.0, 0.0), False)):
        detector = StreakDetector(Proposals(box, verifier=says), DetectorConfig(), believed)
        assert bool(detector.detect(frame).detections) is is_found


def test_what_the_line_filter_sees_is_measured_whatever_the_network_says() -> None:
    analysis = analyse(frame_with((A, B)))
    measured = max(analysis.candidates, key=lambda each: each.found.snr)
    assert measured.found.method == "line"
    assert np.hypot(measured.found.x_px - 159, measured.found.y_px - 207.5) < 0.5
    # What is as good as sure to be none is not on record.
    assert analysis.detections.rejected == ()


def test_a_candidate_that_is_no_streak_is_rejected_with_the_reason() -> None:
    found = analyse(frame_with((A, B)), candidate((300, 400), (418, 410), 0.9)).detections
    assert found.detections == ()
    assert text(found.rejected[0].reason).startswith("too faint: signal to noise")
    assert found.rejected[0].detection.confidence == 0.9


def test_a_fit_that_breaks_costs_its_candidate_alone(monkeypatch, caplog) -> None:
    def broken_on_one(pixels: object, sky: object, box: Box, **rest: object) -> object:
        if box[0] > 200:
            raise IndexError("index 0 is out of bounds")
        return fit_streak(pixels, sky, box, **rest)  # type: ignore[arg-type]

    monkeypatch.setattr("rsoconsole.vision.detector._candidates.fit_streak", broken_on_one)
    found = analyse(frame_with((A, B), (C, D)), candidate(A, B, 0.8), candidate(C, D, 0.4))
    assert [d.confidence for d in found.detections.detections] == [0.8]
    assert [text(r.reason) for r in found.detections.rejected] == [
        "the line fit broke on it: see the log"
    ]
    assert "out of bounds" in caplog.text


def test_two_candidates_on_one_streak_are_one_detection() -> None:
    half = candidate(A, (159.0, 207.5), 0.3)
    known = replace(frame_with((A, B)), scale_arcsec_px=1.264, exposure_s=10.0)
    found = analyse(known, candidate(A, B, 0.8), half).detections
    assert [d.confidence for d in found.detections] == [0.8]
    assert found.rejected == ()


def test_parallel_neighbours_stay_two() -> None:
    up = 12.0
    a, b = (A[0], A[1] + up), (B[0], B[1] + up)
    found = analyse(frame_with((A, B), (a, b)), candidate(A, B, 0.8), candidate(a, b, 0.7))
    assert len(found.detections.detections) == 2
    one, two = found.detections.detections
    assert not is_same_streak(one, two)
    assert is_same_streak(one, replace(one, x_px=one.x_px + 20))


def test_a_field_of_trailed_stars_gives_no_detection() -> None:
    places = [(x, y) for x in (40.0, 200.0, 340.0) for y in range(60, 460, 90)]
    streaks = [((x, float(y)), (x + 90, float(y) + 10)) for x, y in places]
    assert len(streaks) >= TRAILED_STREAKS
    boxes = [candidate(a, b, 0.5) for a, b in streaks]
    found = analyse(frame_with(*streaks), *boxes).detections
    assert found.detections == ()
    reasons = [
        text(r.reason) for r in found.rejected if not text(r.reason).startswith("not measured")
    ]
    assert len(reasons) >= TRAILED_STREAKS
    assert {r for r in reasons if "the stars are trailed" not in r} == set()
    fewer = TRAILED_STREAKS - 1
    kept = analyse(frame_with(*streaks[:fewer]), *boxes[:fewer]).detections
    assert len(kept.detections) == fewer


def test_box_mode_measures_as_the_paper_does() -> None:
    found = analyse(frame_with((A, B)), candidate(A, B, 0.8), centroid="box").detections
    (detection,) = found.detections
    assert detection.method == "box"
    assert (detection.x_px, detection.y_px) == (159.0, 207.5)
    assert detection.sigma_along_px == detection.sigma_across_px == 3.0


def test_box_mode_takes_the_papers_centre_not_its_word_for_what_is_a_streak() -> None:
    frame, box = frame_with((A, B)), candidate(A, B, 0.8)
    found = {}
    for centroid in ("line", "box"):
        settings = DetectorConfig(centroid=centroid)  # type: ignore[arg-type]
        detector = StreakDetector(Proposals(box), settings, curve(constant=-2.0))
        (found[centroid],) = detector.detect(frame).detections
        strict = detector.detect(frame, tau=0.5)
        assert strict.detections == ()
        assert "below tau 0.50" in text(strict.rejected[0].reason)
    assert found["box"].confidence == found["line"].confidence != box.confidence
    assert found["box"].snr == found["line"].snr
    nothing = analyse(frame_with(), box, centroid="box").detections
    assert nothing.detections == ()
    assert text(nothing.rejected[0].reason).startswith("too faint: signal to noise")


def test_box_mode_knows_a_streak_that_the_edge_cuts() -> None:
    a, b = (-60.0, 50.0), (60.0, 60.0)
    inside = candidate((4.0, 55.0), b, 0.8)
    edge = replace(inside, corners_px=(0.0, *inside.corners_px[1:]))
    (found,) = analyse(frame_with((a, b)), edge, centroid="box").detections.detections
    assert (found.method, found.is_clipped) == ("box", True)


def test_dark_proposals_do_not_cost_a_streak_its_turn() -> None:
    dark = [
        candidate((x, 400.0 + y), (x + 80.0, 404.0 + y), 0.9)
        for x in (20.0, 150.0, 300.0)
        for y in np.arange(0.0, 90.0, 9.0)
    ]
    assert len(dark) > MAX_FITS
    proposals = Proposals(*dark, candidate(A, B, 0.5), verifier=Says(above=5.0, below=-9.0))
    found = StreakDetector(proposals, DetectorConfig()).detect(frame_with((A, B)))
    assert [d.confidence for d in found.detections] == [0.5]
    assert {text(r.reason) for r in found.rejected} == {"unlike a streak, by the verifier"}


def test_the_map_is_made_as_configured() -> None:
    for mode in ("fast", "paper"):
        proposals = Proposals()
        settings = DetectorConfig(map_mode=mode)  # type: ignore[arg-type]
        StreakDetector(proposals, settings).detect(frame_with((A, B)))
        assert proposals.maps[0].mode == mode


def test_an_empty_answer_is_no_detection() -> None:
    found = analyse(frame_with()).detections
    assert (found.detections, found.rejected) == ((), ())
    assert (found.width_px, found.height_px) == (512, 512)


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
def test_an_independently_rendered_satellite_is_measured_within_a_pixel() -> None:
    folder = SHARED / "simulated" / "geo_single"
    truth = json.loads((folder / "truth.json").read_text())["frames"][0]["objects"][0]
    a, b = (truth["x_start"], truth["y_start"]), (truth["x_end"], truth["y_end"])
    frame = read_frame(folder / "geo_single_01.fits.bz2", 1)
    found = analyse(frame, candidate(a, b, 0.9))
    (detection,) = found.detections.detections
    assert detection.x_px == pytest.approx((a[0] + b[0]) / 2, abs=1)
    assert detection.y_px == pytest.approx((a[1] + b[1]) / 2, abs=1)
    assert len(found.stars) > 100


def test_what_is_found_is_named_and_what_crosses_beside_it_takes_nothing_from_it() -> None:
    left, right = (-60.0, 60.0), (580.0, 140.0)
    telescope = replace(frame_with((A, B), (left, right)), exposure_s=10.0, scale_arcsec_px=1.3)
    alone = replace(frame_with((A, B)), exposure_s=10.0, scale_arcsec_px=1.3)
    proposed = candidate((5.0, 68.0), (505.0, 131.0), 0.7)
    both = analyse(telescope, candidate(A, B, 0.8), proposed).detections
    (only,) = analyse(alone, candidate(A, B, 0.8)).detections.detections
    whole, across = both.detections
    assert (whole.kind, across.kind) == ("streak", "crossing")
    assert whole.object_class == only.object_class == "satellite"
    assert whole.confidence == only.confidence
    a_tenth_px = 0.1
    assert abs(whole.x_px - only.x_px) < a_tenth_px
    assert across.sigma_angle_deg is not None
    assert across.sigma_angle_deg < 0.1
