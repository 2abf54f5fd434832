"""Lines of light that are the sensor's own."""

import numpy as np
import pytest

from rsoconsole.records import Frame
from rsoconsole.vision.detector.candidate import UNMEASURED, Candidate
from rsoconsole.vision.detector.set_aside import set_aside
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
    taken, rejected = set_aside([faint], None, FRAME, is_striped=True)
    assert taken == []
    assert [each.reason.kind for each in rejected] == ["row or column"]


def test_without_offsets_taken_away_a_faint_line_along_the_rows_stays():
    assert len(set_aside([line(12.0, 0.1)], None, FRAME)[0]) == 1


@pytest.mark.parametrize(("snr", "angle_deg"), [(60.0, 0.1), (12.0, 1.0), (12.0, 45.0)])
def test_a_brighter_line_and_one_that_leaves_its_row_stay(snr, angle_deg):
    assert len(set_aside([line(snr, angle_deg)], None, FRAME, is_striped=True)[0]) == 1
