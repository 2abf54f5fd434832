"""What was in the frames: every line and every mover against everything catalogued that crossed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbits.elements import CatalogueEntry
from rsoconsole.orbits.identification import (
    Candidate,
    FieldCatalogue,
    FieldMatch,
    FieldOfView,
    Matched,
    match_field,
)
from rsoconsole.pipeline.field.field_frame import FieldFrame
from rsoconsole.pipeline.field.field_points import Mover, movers_of
from rsoconsole.pipeline.orbits import errors_of
from rsoconsole.records import Detection

CROSSED = 0.05
"""Chance from which on an object counts as one that crossed."""
TAKEN = 0.5
"""From this probability on an object was seen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameAnswer:
    """One frame."""

    frame: FieldFrame
    candidates: tuple[Candidate, ...]
    match: FieldMatch
    detections: tuple[Detection, ...]
    """Of ``match.lines``: what was taken, and what is below tau and named."""
    compared: int
    too_old: int

    @property
    def crossed(self) -> tuple[int, ...]:
        """Places of the candidates that crossed or were seen, the likeliest first."""
        chances = [
            max(each.chance, taken)
            for each, taken in zip(self.candidates, self.match.taken, strict=True)
        ]
        order = sorted(range(len(chances)), key=lambda n: (-chances[n], n))
        return tuple(n for n in order if chances[n] >= CROSSED)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MoverAnswer:
    """One point that moves."""

    mover: Mover
    candidates: tuple[Candidate, ...]
    matched: Matched


class FieldRun:
    """One catalogue, and one frame after another."""

    def __init__(self, config: Config, entries: Sequence[CatalogueEntry]) -> None:
        self._config = config
        self._catalogue = FieldCatalogue(entries, errors_of(config.catalogue))

    def frame(self, frame: FieldFrame) -> FrameAnswer:
        """What crossed one frame."""
        view = frame.view(self._config)
        candidates = self._catalogue.candidates(view)
        match = match_field(view, candidates, frame.lines)
        kept = [
            n
            for n, each in enumerate(match.lines)
            if n < frame.taken or each.verdict == "identified"
        ]
        lines = tuple(match.lines[n] for n in kept)
        taken = [0.0] * len(candidates)
        for choice in (choice for each in lines for choice in each.choices):
            if choice.candidate is not None:
                taken[choice.candidate] += choice.probability
        return FrameAnswer(
            frame=frame,
            candidates=candidates,
            match=FieldMatch(lines=lines, taken=tuple(min(each, 1.0) for each in taken)),
            detections=tuple(frame.detections[n] for n in kept),
            compared=self._catalogue.compared,
            too_old=self._catalogue.too_old,
        )

    def movers(self, frames: Sequence[FieldFrame]) -> tuple[MoverAnswer, ...]:
        """What moves through frames in order of time as a point; those alike in time together."""
        found = movers_of([each.points for each in frames])
        answers: dict[int, MoverAnswer] = {}
        groups: dict[tuple[int, int], list[int]] = {}
        for place, mover in enumerate(found):
            groups.setdefault((mover.points[0][0], mover.points[-1][0]), []).append(place)
        for (first, last), places in groups.items():
            movers = [found[n] for n in places]
            middle = frames[(first + last) // 2]
            view = _view_of(movers, middle.view(self._config))
            candidates = self._catalogue.candidates(view)
            match = match_field(view, candidates, [each.line for each in movers])
            for n, mover, matched in zip(places, movers, match.lines, strict=True):
                answers[n] = MoverAnswer(mover=mover, candidates=candidates, matched=matched)
        return tuple(answers[n] for n in range(len(found)))


def _view_of(movers: Sequence[Mover], frame: FieldOfView) -> FieldOfView:
    """The frames from the first point to the last as one exposure."""
    longest = max(each.line.length_rad for each in movers)
    return replace(
        frame,
        t_mid_utc_ns=int(np.mean([each.t_mid_utc_ns for each in movers])),
        exposure_s=float(np.mean([each.span_s for each in movers])),
        radius_rad=frame.radius_rad + longest / 2.0,
    )
