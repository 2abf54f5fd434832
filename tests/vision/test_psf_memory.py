"""The stars' width in frames that show too few: that of the last frames, or a guess."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.base import model_file_path
from rsoconsole.config import Config, DetectorConfig
from rsoconsole.pipeline import FrameReducer
from rsoconsole.records import Frame
from rsoconsole.vision import ConfidenceCurve, FrameAnalysis, PsfMemory, StreakDetector, find_stars
from rsoconsole.vision.stars.psf_memory import HOLDS_NS
from tests.drawn.soft_corners import PIXEL_FWHM, Ends, Proposes, about, drawn, soft_and_tilted
from tests.vision.test_trailed_stars import drawn_out

CURVE = ConfidenceCurve.from_card(json.loads(model_file_path("streak_ssd.json").read_text()))
STREAK: Ends = (540.0, 430.0, 658.0, 470.0)
NETWORK = Proposes(about(STREAK, confidence=0.05))
SEEING_PX = 4.2
WIDTH_PX = float(np.hypot(SEEING_PX, PIXEL_FWHM))
GUESS_PX = 2.5
MINUTE_NS = 60 * 10**9


def poor_seeing(_x_px: float, _y_px: float) -> float:
    return SEEING_PX


def later(frame: Frame, by_ns: int) -> Frame:
    assert frame.t_start_utc_ns is not None
    return replace(frame, frame_id=2, t_start_utc_ns=frame.t_start_utc_ns + by_ns)


CLEAR = drawn(poor_seeing, count=80)
CLOUDED = later(drawn(poor_seeing, count=0, streak=STREAK), MINUTE_NS)


def analyses(*frames: Frame, memory: PsfMemory | None) -> list[FrameAnalysis]:
    detector = StreakDetector(NETWORK, DetectorConfig(threads=1), CURVE, memory)
    return [detector.analyse(frame, tau=0.0) for frame in frames]


def last_width_px(*frames: Frame) -> tuple[str, float]:
    stars = analyses(*frames, memory=PsfMemory())[-1].stars
    return stars.width_source, stars.median_fwhm_px


def test_a_clouded_frame_has_the_width_of_the_clear_one_before_it():
    clear, clouded = analyses(CLEAR, CLOUDED, memory=PsfMemory())
    assert clear.stars.width_source == "measured"
    assert clouded.stars.width_source == "remembered"
    assert len(clouded.stars) < 5
    assert clouded.focus.fwhm_px == pytest.approx(WIDTH_PX, rel=0.03)


def test_a_streak_under_cloud_is_believed_by_what_the_clear_frame_showed():
    (alone,) = analyses(CLOUDED, memory=None)
    _, clouded = analyses(CLEAR, CLOUDED, memory=PsfMemory())
    (guessed,), (known,) = alone.detections.detections, clouded.detections.detections
    assert alone.stars.width_source == "guessed"
    assert alone.stars.median_fwhm_px == GUESS_PX
    assert clouded.stars.width_source == "remembered"
    assert known.width_px == pytest.approx(WIDTH_PX, rel=0.1)
    # By a guess the width is no doubt, by what is remembered it is right.
    assert min(known.confidence, guessed.confidence) > 0.99


def test_what_a_detector_without_memory_saw_before_changes_nothing():
    (alone,), (_, after) = (
        analyses(*frames, memory=None) for frames in ((CLOUDED,), (CLEAR, CLOUDED))
    )
    assert after.detections.detections == alone.detections.detections
    assert after.focus == alone.focus


def test_the_same_frames_in_the_same_order_give_the_same_answers():
    one, other = (analyses(CLEAR, CLOUDED, CLOUDED, memory=PsfMemory()) for _ in range(2))
    assert [each.detections.detections for each in one] == [
        each.detections.detections for each in other
    ]
    assert [each.focus for each in one] == [each.focus for each in other]


def test_a_clear_frame_goes_by_its_own_stars():
    sharper = later(drawn(lambda *_: 2.4, count=80, seed=3), MINUTE_NS)
    (alone,) = analyses(sharper, memory=None)
    _, after = analyses(CLEAR, sharper, memory=PsfMemory())
    assert after.focus == alone.focus
    assert np.array_equal(after.stars.x_px, alone.stars.x_px)


@pytest.mark.parametrize(
    ("by_ns", "source"),
    [(HOLDS_NS, "remembered"), (HOLDS_NS + 1, "guessed"), (-1, "guessed"), (0, "remembered")],
)
def test_it_holds_for_half_an_hour_and_not_backwards(by_ns, source):
    assert last_width_px(CLEAR, later(CLOUDED, by_ns - MINUTE_NS))[0] == source


def test_frames_without_a_time_neither_give_nor_take_a_width():
    assert last_width_px(replace(CLEAR, t_start_utc_ns=None), CLOUDED) == ("guessed", GUESS_PX)
    assert last_width_px(CLEAR, replace(CLOUDED, t_start_utc_ns=None)) == ("guessed", GUESS_PX)


def binned(frame: Frame) -> Frame:
    """As a camera reads out 2 x 2 pixels as one."""
    rows, columns = frame.pixels.shape
    four = frame.pixels.astype(float).reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
    scale = None if frame.scale_arcsec_px is None else 2.0 * frame.scale_arcsec_px
    return replace(frame, pixels=np.rint(four).astype(np.uint16), scale_arcsec_px=scale)


def test_another_binning_of_the_same_field_takes_the_width_on_the_sky():
    source, fwhm_px = last_width_px(CLEAR, binned(CLOUDED))
    assert source == "remembered"
    assert fwhm_px == pytest.approx(WIDTH_PX / 2, rel=0.03)


@pytest.mark.parametrize(
    "other",
    [
        replace(CLOUDED, scale_arcsec_px=3.9),
        replace(CLOUDED, scale_arcsec_px=None),
        replace(CLOUDED, pixels=CLOUDED.pixels[:-100]),
        binned(replace(CLOUDED, scale_arcsec_px=None)),
    ],
    ids=["another telescope", "scale unknown", "a part of the field", "binning unknown"],
)
def test_a_frame_of_another_view_takes_nothing(other):
    assert last_width_px(CLEAR, other) == ("guessed", GUESS_PX)


def test_without_a_scale_frames_of_one_shape_share_a_width():
    frames = (replace(each, scale_arcsec_px=None) for each in (CLEAR, CLOUDED))
    source, fwhm_px = last_width_px(*frames)
    assert (source, fwhm_px) == ("remembered", pytest.approx(WIDTH_PX, rel=0.03))


def test_a_handful_of_sources_is_not_worth_remembering():
    sparse = drawn(lambda *_: 3.0, count=8, seed=6)
    assert find_stars(sparse.pixels).width_source == "measured"
    between = later(sparse, MINUTE_NS // 2)
    assert last_width_px(CLEAR, between, CLOUDED) == (
        "remembered",
        pytest.approx(WIDTH_PX, rel=0.03),
    )


def test_stars_that_wind_or_drift_drew_out_are_not_remembered():
    trailed = replace(CLEAR, pixels=drawn_out(CLEAR.pixels, 20.0, 30.0, 3))
    memory = PsfMemory()
    first, clouded = analyses(trailed, CLOUDED, memory=memory)
    assert first.stars.trail is not None
    assert clouded.stars.width_source == "guessed"


def test_the_change_over_the_field_is_remembered_too():
    soft = drawn(soft_and_tilted)
    first, clouded = analyses(soft, CLOUDED, memory=PsfMemory())
    assert first.focus.psf_field is not None
    assert clouded.focus.psf_field == first.focus.psf_field
    assert clouded.stars.fwhm_at(1150.0, 850.0) == first.stars.fwhm_at(1150.0, 850.0)


def test_under_cloud_pixels_are_joined_as_in_the_clear_frame():
    def out_of_focus(_x_px, _y_px):
        return 9.0

    wide = drawn(out_of_focus, count=60, seed=2)
    dark = later(drawn(out_of_focus, count=0, streak=(400.0, 300.0, 800.0, 500.0)), MINUTE_NS)
    clear, clouded = analyses(wide, dark, memory=PsfMemory())
    assert clear.focus.joined == clouded.focus.joined == 2
    assert clouded.focus.fwhm_px == pytest.approx(clear.focus.fwhm_px, rel=0.02)
    assert clouded.stars.median_fwhm_px == pytest.approx(clear.stars.median_fwhm_px, rel=0.02)


class NoPlate:
    """Nobody asks for a plate."""

    def configure(self, config: Config) -> None:
        pass

    def forget(self) -> None:
        pass

    def solve(self, *_: object) -> None:
        return None


def test_new_settings_and_a_lost_plate_do_not_cost_the_memory():
    config = Config(detector=DetectorConfig(threads=1, tau=0.05))
    reducer = FrameReducer(NETWORK, CURVE, NoPlate(), config)
    assert reducer.reduce(CLEAR).fwhm_px == pytest.approx(WIDTH_PX, rel=0.03)
    reducer.configure(config.model_copy(update={"detector": DetectorConfig(threads=1, tau=0.04)}))
    reducer.forget_plate()
    reduced = reducer.reduce(CLOUDED)
    (found,) = reduced.detections.detections
    _, clouded = analyses(CLEAR, CLOUDED, memory=PsfMemory())
    assert found == clouded.detections.detections[0]


def test_a_width_that_is_not_the_frame_s_own_is_not_told_as_its_image_quality():
    reducer = FrameReducer(NETWORK, CURVE, NoPlate(), Config())
    clear, clouded = reducer.reduce(CLEAR), reducer.reduce(CLOUDED)
    assert clear.detections.star_fwhm_px == clear.fwhm_px
    assert clouded.fwhm_px is None
    assert clouded.detections.star_fwhm_px is None
