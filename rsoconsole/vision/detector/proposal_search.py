"""Search of a frame for its stars, and for lines that may be streaks: network, lines, lights."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from rsoconsole.config import DetectorConfig
from rsoconsole.records import FloatArray, Frame
from rsoconsole.vision.detector._candidates import (
    FrameCandidates,
    Proposal,
    merged_proposals,
    ranked_proposals,
)
from rsoconsole.vision.detector._reject_artifacts import is_star_trail
from rsoconsole.vision.detector.measured_detection import Candidate, distinct_boxes
from rsoconsole.vision.detector.network import NetworkBox
from rsoconsole.vision.detector.verifier import Verifier
from rsoconsole.vision.detector.working_frame import WorkingFrame, joined_square_side_px
from rsoconsole.vision.frame.background import Background, local_background
from rsoconsole.vision.frame.bins import bin_frame, squares_of
from rsoconsole.vision.frame.maps import FrameMap, choose_blocks, make_map, map_noise
from rsoconsole.vision.frame.pattern import find_row_column_pattern
from rsoconsole.vision.frame.workers import Workers, threads_for
from rsoconsole.vision.lines.line_filter import FINEST_PX, CellLine, cell_side_px, propose_lines
from rsoconsole.vision.lines.line_images import LineImages, line_images
from rsoconsole.vision.lines.short_lines import interleaved_lines, short_lines
from rsoconsole.vision.stars.point_image import PointImage
from rsoconsole.vision.stars.psf_field import Psf
from rsoconsole.vision.stars.psf_memory import PsfMemory
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.stars import MAX_STARS, STAR_BLOCK_PX, find_stars

FAINT_PX = 2
"""Side of the cells in which the faintest lines are looked for, px."""
_MAX_JOININGS = 2
_MAX_WIDE_STARS = 1500
"""Largest number of stars listed where they are wide."""


class Proposer(Protocol):
    """Source of proposals: the trained network, or a stand-in."""

    verifier: Verifier | None
    """Judge of each line's image; None: the proposals' own confidence counts alone."""

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        """Candidates in one map, most confident first."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameProposals:
    """Sky, stars and proposals of a frame, before any is measured."""

    working: WorkingFrame
    sky: Background
    """Of the working frame."""
    stars: StarList
    """In working-frame pixels."""
    focus: PointImage
    proposals: tuple[Proposal, ...]
    """In working-frame pixels."""
    side_px: int
    """Side of the cells in which lines were looked for, px."""
    original_sky: Background
    is_striped: bool
    """True where offsets of rows or columns were subtracted."""

    def ranked(self) -> list[Proposal]:
        """Return the proposals, the most promising first."""
        return ranked_proposals(self.proposals)

    def candidates(
        self, is_worth_fitting: Callable[[Candidate], bool] = lambda _: True
    ) -> FrameCandidates:
        """Return the frame's candidates, before any is measured."""
        look = self.working.frame, self.sky, self.stars, self.focus
        return FrameCandidates(*look, is_worth_fitting)

    def images(self, lines: FloatArray) -> LineImages:
        """Return the images of lines (n, 4), as the verifier looks at them."""
        look = self.working.frame.pixels, self.sky, self.stars, self.focus
        return line_images(*look, lines)


class ProposalSearch:
    """Search for stars and possible streaks in frame after frame; not for two threads at once."""

    def __init__(
        self,
        network: Proposer,
        settings: DetectorConfig,
        memory: PsfMemory | None = None,
        *,
        is_quick: bool = False,
        side_px: int | None = None,
    ) -> None:
        """Make a search; the arguments are those of ``StreakDetector``.

        ``side_px``: side of the cells in which lines are looked for; None: by the size of a frame.
        """
        self._network, self._settings, self._memory = network, settings, memory
        self._is_quick, self._side_px = is_quick, side_px
        self._workers = Workers(threads_for(settings.threads))

    def search(self, frame: Frame, watch: "Stopwatch | None" = None) -> FrameProposals:
        """Find sky, stars and possible streaks, in joined pixels where the stars are wide."""
        watch = watch or Stopwatch()
        with watch.stage("pattern"):
            pattern = find_row_column_pattern(frame.pixels)
            if pattern is not None:
                frame = replace(frame, pixels=pattern.removed(frame.pixels))
        known = None if self._memory is None else self._memory.recall(frame)
        working = WorkingFrame.of(frame, 1)
        seen = first = self._look(frame, watch, known, may_join_pixels=True)
        for _ in range(_MAX_JOININGS):
            side = joined_square_side_px(seen.stars, working.frame)
            if side == 1:
                break
            working = WorkingFrame.of(frame, side * working.side)
            joined = None if known is None else known.in_binned_pixels(working.side)
            seen = self._look(working.frame, watch, joined, _MAX_WIDE_STARS)
        if self._memory is not None:
            self._memory.remember(frame, working.original_stars(seen.stars))
        return FrameProposals(
            working=working,
            sky=seen.sky,
            stars=seen.stars,
            focus=_focus(seen.stars, working.side),
            proposals=seen.proposals,
            side_px=seen.side_px,
            original_sky=first.sky,
            is_striped=pattern is not None,
        )

    def faint_proposals(self, seen: FrameProposals) -> list[Proposal]:
        """Find lines in the finest cells of a frame that was searched."""
        squares = squares_of(seen.working.frame.pixels, FAINT_PX)
        lines = propose_lines(seen.sky, squares, FAINT_PX, seen.stars, self._workers)
        return _without_star_trails(merged_proposals([], lines), seen.stars)

    def _look(
        self,
        frame: Frame,
        watch: "Stopwatch",
        expected: Psf | None,
        most_stars: int = MAX_STARS,
        *,
        may_join_pixels: bool = False,
    ) -> "_Look":
        """Find sky, stars and possible streaks; ``expected`` of the stars where they are few.

        With ``may_join_pixels`` no streak is searched for where stars are so wide that pixels will
        be joined first, as far as that is known in time.
        """
        pixels, workers = frame.pixels, self._workers
        blocks = choose_blocks(
            frame.width_px, frame.height_px, frame.scale_arcsec_px, frame.exposure_s
        )
        mode = self._settings.map_mode
        lines = blocks if mode == "fast" and not self._is_quick else ()
        # Where pixels were joined stars stand closer together, and streaks are short.
        finest_px = FINEST_PX if may_join_pixels else FINEST_PX // 2
        star_block_px = STAR_BLOCK_PX if may_join_pixels else STAR_BLOCK_PX // 2
        by_size_px = cell_side_px(frame.height_px, frame.width_px, finest_px)
        side_px = self._side_px or by_size_px
        with watch.stage("background"):
            noises = {block: workers.begin(partial(map_noise, pixels, block)) for block in lines}
            bins = bin_frame(
                pixels, {star_block_px}, line_blocks=lines, square_px=side_px, workers=workers
            )
            sky = local_background(pixels, bins=bins, workers=workers)

        def look_for_stars_and_lines() -> tuple[StarList, list[CellLine]]:
            with watch.stage("stars"):
                stars = find_stars(
                    pixels,
                    sky,
                    most_stars,
                    saturation_adu=frame.saturation_adu,
                    bins=bins,
                    expected=expected,
                    block_px=star_block_px,
                    may_be_trails=not self._is_quick,
                )
            if may_join_pixels and joined_square_side_px(stars, frame) > 1:
                return stars, []
            with watch.stage("lines"):
                assert bins.squares is not None
                return stars, propose_lines(sky, bins.squares, side_px, stars)

        looked = workers.begin(look_for_stars_and_lines)
        if (
            may_join_pixels
            and looked.done()
            and joined_square_side_px(looked.result()[0], frame) > 1
        ):
            return _Look(sky=sky, stars=looked.result()[0], proposals=(), side_px=side_px)
        if self._is_quick:
            stars, found = looked.result()
            quick = tuple(merged_proposals([], found))
            return _Look(sky=sky, stars=stars, proposals=quick, side_px=FAINT_PX)
        with watch.stage("map"):
            noise = {block: begun.result() for block, begun in noises.items()}
            maps = [
                make_map(pixels, mode, block, bins=bins, noise=noise.get(block), workers=workers)
                for block in blocks
            ]
        with watch.stage("network"):
            boxes = distinct_boxes([self._network.run(each) for each in maps])
        stars, found = looked.result()
        is_sharp = may_join_pixels and stars.trail is None
        found = interleaved_lines(found, short_lines(stars, found, is_sharp=is_sharp))
        wanted = _without_star_trails(merged_proposals(boxes, found), stars)
        return _Look(sky=sky, stars=stars, proposals=tuple(wanted), side_px=side_px)


def _without_star_trails(proposals: list[Proposal], stars: StarList) -> list[Proposal]:
    trail = stars.trail
    if trail is None:
        return proposals
    return [each for each in proposals if each.is_light or not is_star_trail(each, trail)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Look:
    sky: Background
    stars: StarList
    proposals: tuple[Proposal, ...]
    side_px: int


def _focus(stars: StarList, joined: int) -> PointImage:
    trail = stars.trail
    return PointImage(
        fwhm_px=stars.median_fwhm_px,
        joined=joined,
        trail_px=0.0 if trail is None else trail.length_px,
        trail_deg=0.0 if trail is None else trail.angle_deg,
        is_guessed=stars.width_source == "guessed",
        psf_field=stars.psf_field,
    )


class Stopwatch:
    """Wall time of each stage."""

    def __init__(self) -> None:
        self.stage_ms: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.stage_ms[name] = (time.perf_counter() - began) * 1e3
