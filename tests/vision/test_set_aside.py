"""Lines of light that are the sensor's own."""

import numpy as np
import pytest

from rsoconsole.records import Frame
from rsoconsole.vision import Candidate
from rsoconsole.vision.detector._reject_artifacts import reject_artifacts
from rsoconsole.vision.detector.measured_detection import UNMEASURED
from tests.makers import straight_detection

FRAME = Frame(
    frame_id=1, name="f", pixels=np.full((1000, 1600), 900, dtype=np.uint16), saturation_adu=65535.0
)


def line(snr: float, angle_deg: float, length_px: float = 500.0) -> Candidate:
    found = straight_detection(
        x_px=700.0, y_px=500.0, length_px=length_px, angle_deg=angle_deg, snr=snr, width_px=4.0
    )
    return Candidate(found=found, light=UNMEASURED)


@pytest.mark.parametrize("angle_deg", [0.0, 0.2, 179.9, 90.0])
def test_what_is_no_brighter_than_the_errors_of_the_rows_offsets_is_theirs(angle_deg):
    faint = line(12.0, angle_deg)
    taken, rejected = reject_artifacts([faint], None, FRAME, is_striped=True)
    assert taken == []
    assert [each.reason.kind for each in rejected] == ["row or column"]


def test_without_offsets_taken_away_a_faint_line_along_the_rows_stays():
    assert len(reject_artifacts([line(12.0, 0.1)], None, FRAME)[0]) == 1


@pytest.mark.parametrize(("snr", "angle_deg"), [(60.0, 0.1), (12.0, 1.0), (12.0, 45.0)])
def test_a_brighter_line_and_one_that_leaves_its_row_stay(snr, angle_deg):
    assert len(reject_artifacts([line(snr, angle_deg)], None, FRAME, is_striped=True)[0]) == 1


@pytest.mark.parametrize(
    ("x_px", "y_px", "angle_deg", "is_taken"),
    [
        (1599.0, 500.0, 90.0, False),
        (700.0, 0.5, 0.0, False),
        (1590.0, 500.0, 90.0, True),
        (1598.0, 500.0, 84.0, True),
    ],
)
def test_what_lies_along_the_frame_s_rim_is_the_sensor_s(x_px, y_px, angle_deg, is_taken):
    found = straight_detection(
        x_px=x_px, y_px=y_px, length_px=300.0, angle_deg=angle_deg, snr=30.0, width_px=4.0
    )
    taken, _ = reject_artifacts([Candidate(found=found, light=UNMEASURED)], None, FRAME)
    assert bool(taken) == is_taken


def beside(count: int, length_px: float = 120.0, sigma_along_px: float = 0.2) -> list[Candidate]:
    return [
        Candidate(
            found=straight_detection(
                x_px=700.0,
                y_px=60.0 + 70.0 * i,
                length_px=length_px,
                angle_deg=2.0,
                snr=100.0,
                sigma_along_px=sigma_along_px,
            ),
            light=UNMEASURED,
        )
        for i in range(count)
    ]


@pytest.mark.parametrize(("points", "kept"), [(0, 0), (30, 0), (60, 12), (800, 12)])
def test_a_dozen_of_one_length_are_stars_only_where_stars_are_no_points(points, kept):
    taken, rejected = reject_artifacts(beside(12), None, FRAME, points=points)
    assert len(taken) == kept
    assert {each.reason.kind for each in rejected} == (set() if kept else {"trailed stars"})


def test_what_runs_out_of_the_frame_is_not_as_long_as_a_streak_within_it():
    of_rows = beside(8, length_px=1500.0, sigma_along_px=1500.0)
    taken, rejected = reject_artifacts([*beside(4), *of_rows], None, FRAME)
    assert len(taken) == 12
    assert rejected == []
