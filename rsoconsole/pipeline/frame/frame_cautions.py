"""Cautions about a frame, apart from its detections; each is one sentence."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.instruments import NOTES_KEY
from rsoconsole.pipeline.frame.hints import header_hint, wrong_hints
from rsoconsole.records import Frame, NotSolved, Solution
from rsoconsole.vision import camera_cautions

CALIBRATION = "calibration"
"""Prefix of the kinds of cautions about master frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Caution:
    """Warning about a frame, or information that holds for later frames too."""

    kind: str
    """Kind of the caution: over several frames each kind is reported once."""
    words: str
    level: Literal["info", "warning"] = "warning"


def cautions(
    frame: Frame, solution: Solution | NotSolved | None, config: Config
) -> tuple[Caution, ...]:
    """Return the cautions about a frame: notes of its reader, wrong hints, unusual values.

    Unusual is a scale (by plate, else header), an exposure or a size outside the range in which the
    detector was tested and its confidence is calibrated.
    """
    notes = [str(note) for note in frame.header.get(NOTES_KEY, ())]
    found = [Caution(kind=note, words=note) for note in notes]
    scale_arcsec_px = frame.scale_arcsec_px
    if isinstance(solution, Solution):
        scale_arcsec_px = solution.scale_arcsec_px
        wrong = wrong_hints(header_hint(frame, config), solution, frame, config)
        found += [Caution(kind=f"{each.hint} hint", words=each.words) for each in wrong]
    about = camera_cautions(scale_arcsec_px, frame.exposure_s, frame.width_px, frame.height_px)
    return (*found, *(Caution(kind=kind, words=words) for kind, words in about.items()))


def calibration_warnings(cautions: Iterable[Caution]) -> Iterator[str]:
    """Yield the texts of the warnings about master frames among the cautions.

    A comparison of a new reduction with the record depends on the masters.
    """
    for each in cautions:
        if each.level == "warning" and each.kind.startswith(CALIBRATION):
            yield each.words
