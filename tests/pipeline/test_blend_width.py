"""How wide the frame shows things: what decides whether two satellites are found as one streak."""

import dataclasses

import pytest

from rsoconsole.pipeline import FrameObservations
from rsoconsole.pipeline.cycle.frame_fold import _width_arcsec
from rsoconsole.records import Detections, FrameTaken, Solution
from rsoconsole.session import SessionReader
from tests.nights.samples import SAMPLE


@pytest.fixture(scope="module")
def frame() -> FrameObservations:
    """A frame of the shipped session that shows a streak."""
    found: dict[int, dict[type, object]] = {}
    for _, _, record in SessionReader(SAMPLE).records():
        if isinstance(record, FrameTaken | Detections | Solution):
            found.setdefault(record.frame_id, {})[type(record)] = record
    parts = next(
        each
        for each in found.values()
        if len(each) == 3 and any(d.kind == "streak" for d in each[Detections].detections)  # type: ignore[attr-defined]
    )
    return FrameObservations(
        taken=parts[FrameTaken],  # type: ignore[arg-type]
        detections=parts[Detections],  # type: ignore[arg-type]
        solution=parts[Solution],  # type: ignore[arg-type]
        measurements=(),
    )


def shown(
    frame: FrameObservations, star_px: float | None, streaks_px: list[float]
) -> FrameObservations:
    assert frame.detections is not None
    one = next(d for d in frame.detections.detections if d.kind == "streak")
    streaks = tuple(dataclasses.replace(one, width_px=each) for each in streaks_px)
    found = dataclasses.replace(frame.detections, detections=streaks, star_fwhm_px=star_px)
    return dataclasses.replace(frame, detections=found)


@pytest.mark.parametrize(
    ("star_px", "streaks_px", "width_px"),
    [
        (9.3, [7.4, 7.8, 7.4, 6.7, 6.0], 7.4),  # stars that drift
        (2.6, [3.2, 3.3], 2.6),
        (9.3, [], 9.3),
        (None, [3.2], None),
    ],
)
def test_the_narrower_of_stars_and_streaks_counts(frame, star_px, streaks_px, width_px):
    assert isinstance(frame.solution, Solution)
    found = _width_arcsec(shown(frame, star_px, streaks_px))
    expected = None if width_px is None else width_px * frame.solution.scale_arcsec_px
    assert found == (expected if expected is None else pytest.approx(expected))
