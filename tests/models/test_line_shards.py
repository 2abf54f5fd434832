"""Lines of known truth for the verifier: what counts as a streak; drawing is repeatable."""

import itertools
import math

import numpy as np
import pytest

from models.frames import TrueTrail
from models.line_scenes import draw_scene
from models.line_shards import label, lines_of
from rsoconsole.config import DetectorConfig
from rsoconsole.vision import Network
from rsoconsole.vision.detector.proposal_search import ProposalSearch

TRAIL = TrueTrail(
    x_a_px=100.0, y_a_px=100.0, x_b_px=200.0, y_b_px=150.0, peak_snr=20.0, is_cut=False
)
FWHM_PX = 2.5


def at(along: float, across: float, times: float = 1.0, turn_deg: float = 0.0) -> np.ndarray:
    """A line by its middle's place on the trail, its length over the trail's, and its turn."""
    angle = math.atan2(50.0, 100.0) + math.radians(turn_deg)
    half = 0.5 * times * TRAIL.length_px
    cos, sin = math.cos(math.atan2(50.0, 100.0)), math.sin(math.atan2(50.0, 100.0))
    x, y = 150.0 + along * cos - across * sin, 125.0 + along * sin + across * cos
    dx, dy = half * math.cos(angle), half * math.sin(angle)
    return np.array([x - dx, y - dy, x + dx, y + dy])


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (at(0.0, 0.0), 1),
        (at(0.0, 0.0)[[2, 3, 0, 1]], 1),
        (at(10.0, 1.0, 1.3), 1),
        (at(-20.0, 0.0, 0.5), 1),
        (at(40.0, 0.0, 0.1), -1),
        (at(0.0, 0.0, 4.0), -1),
        (at(0.0, 0.0, 1.0, 60.0), -1),
        (at(0.0, 30.0), 0),
        (at(400.0, 0.0), 0),
    ],
)
def test_a_line_is_a_streak_where_it_lies_on_most_of_one(line, wanted):
    assert label(line, (TRAIL,), FWHM_PX) == (wanted, 0 if wanted == 1 else -1)


def test_a_frame_is_drawn_and_its_lines_are_labelled_the_same_again():
    number = next(n for n in range(50) if draw_scene(n).trails)
    search = ProposalSearch(Network.load(None, 1), DetectorConfig(threads=1), side_px=2)
    one, other = (lines_of(search, number, 20281130) for _ in range(2))
    for name in ("images", "figures", "labels", "snrs", "ends", "frames"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    true = one.labels == 1
    assert np.count_nonzero(true) >= 2
    assert np.all(one.snrs[true] > 0.0)
    assert np.median(np.abs(one.ends[true])) < 3.0


def test_some_satellites_move_alike_one_behind_another():
    def is_row(one: TrueTrail, other: TrueTrail) -> bool:
        dx, dy = one.x_b_px - one.x_a_px, one.y_b_px - one.y_a_px
        off_x, off_y = (
            other.middle_px[0] - one.middle_px[0],
            other.middle_px[1] - one.middle_px[1],
        )
        across = abs(off_y * dx - off_x * dy) / one.length_px
        return abs(one.length_px / other.length_px - 1.0) < 0.01 and across < 0.2 * one.length_px

    pairs = [
        (one, other)
        for trails in (draw_scene(number).trails for number in range(12, 30))
        for one, other in itertools.combinations(trails, 2)
        if not (one.is_cut or other.is_cut)
    ]
    assert 1 <= sum(is_row(*pair) for pair in pairs) < 0.5 * len(pairs)
