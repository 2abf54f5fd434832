"""State of the screen of a frame at full resolution, and the texts made of that state."""

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rsoconsole.console.picture.picture import STRETCHES, Stretch
from rsoconsole.console.picture.sheet_pixels import STEPS, ZoomedFrame
from rsoconsole.console.watches.sheet_worker import FrameOpened, FrameProcessed, FrameSettings
from rsoconsole.console.words.tunable import Tunable
from rsoconsole.pipeline import HELD
from rsoconsole.records import MapMode, Solution
from rsoconsole.words import direction

if TYPE_CHECKING:
    from rsoconsole.console.picture.sheet_pixels import FramePixelPyramid
    from rsoconsole.pipeline import ComparedCandidate
    from rsoconsole.vision import FrameMap

TAU = Tunable(name="detector.tau", label="τ", low=0.001, high=0.99)


@dataclass(slots=True)
class FrameScreenState:
    """State of the screen of one frame: record, pixels, settings on trial, view, mark by hand."""

    frame_id: int
    opened: FrameOpened | None = None
    pixels: "FramePixelPyramid | None" = None
    done: FrameProcessed | None = None
    fault: str = ""
    """Reason why the frame's pixels cannot be shown; empty: none."""
    failure: str = ""
    """Reason why the frame could not be processed the last time; empty: none."""
    view: ZoomedFrame | None = None
    step: int = 1
    """Index in STEPS: squares that an arrow key moves the cross by."""
    stretch: Stretch = STRETCHES[0]
    sees_as_network: bool = False
    has_marks: bool = True
    chosen: int | None = None
    tau_steps: int = 0
    map_mode: MapMode | None = None
    solves_again: bool = False
    wanted: FrameSettings | None = None
    """Settings that the frame is being processed with; None: it is not being processed."""
    is_marking: bool = False
    first_px: tuple[float, float] | None = None
    """First end of the mark by hand, pixels of the frame; None until it is set."""
    coarsest_px: float = 0.0
    """Side of the largest square in which an end was set, pixels: the mark's uncertainty."""
    shows_beside_mark: bool = False
    """True where the marks stay over the picture while a new one is made by hand."""
    began_s: float = field(default_factory=time.monotonic)
    """Time at which reading or processing began, monotonic seconds."""

    @property
    def are_marks_shown(self) -> bool:
        """True where the marks are drawn; during a mark by hand they are hidden by default."""
        return self.has_marks and (not self.is_marking or self.shows_beside_mark)

    @property
    def next_end_words(self) -> str:
        """The end of a mark by hand that is to be set next, in words; empty: no mark."""
        if not self.is_marking:
            return ""
        return f"mark the {'first' if self.first_px is None else 'second'} end"

    @property
    def recorded_tau(self) -> float | None:
        """The tau with which the frame was processed; None until the record is read."""
        return None if self.opened is None else self.opened.recorded.config.detector.tau

    @property
    def tau(self) -> float | None:
        """The tau on trial, or where none is, the recorded one; None until the record is read."""
        before = self.recorded_tau
        if before is None or not self.tau_steps:
            return before
        return float(TAU.step_value(before, self.tau_steps))

    @property
    def recorded_mode(self) -> MapMode | None:
        """The map mode that was in force for the frame; None until the record is read."""
        return None if self.opened is None else self.opened.recorded.config.detector.map_mode

    @property
    def candidates(self) -> "tuple[ComparedCandidate, ...]":
        """Candidates as recorded, compared with those of the new processing once it is done."""
        if self.done is not None:
            return self.done.result.candidates
        return self.opened.candidates if self.opened is not None else ()

    @property
    def map(self) -> "FrameMap | None":
        """The network's map; None where the frame itself is shown, or the map is not made yet."""
        if not self.sees_as_network or self.done is None or not self.done.maps:
            return None
        return self.done.maps[0]

    @property
    def solution(self) -> Solution | None:
        """The plate solution for reading positions in the frame; None: the frame is not solved."""
        found = None
        if self.done is not None and self.done.result.is_solved_again:
            found = self.done.result.now.solution
        elif self.opened is not None:
            found = self.opened.recorded.seen.solution
        return found if isinstance(found, Solution) else None

    def wanted_settings(self) -> FrameSettings:
        """Return the settings to process the frame with now."""
        return FrameSettings(
            tau=self.tau if self.tau_steps else None,
            map_mode=self.map_mode,
            solves_again=self.solves_again,
            wants_map=self.sees_as_network,
        )


def title_parts(sheet: FrameScreenState) -> list[str]:
    """Return the parts of the picture's title: frame, scale, exposure or map, stretch."""
    parts = [f"frame {sheet.frame_id:04d}", *([sheet.next_end_words] if sheet.is_marking else [])]
    opened = sheet.opened
    if opened is not None and sheet.pixels is None and not sheet.fault:
        seconds = time.monotonic() - sheet.began_s
        parts.append(f"reading {opened.bytes / 1e6:.1f} MB … {seconds:.1f} s")
    if sheet.pixels is None or sheet.view is None:
        return [*parts, "preview"]
    parts.append(scale_words(sheet.view))
    if sheet.map is not None:
        return [*parts, "network's map", f"{sheet.map.block} px a cell"]
    if sheet.sees_as_network:
        return [*parts, "making the map …"]
    if opened is not None and opened.recorded.taken.exposure_s is not None:
        parts.append(f"{opened.recorded.taken.exposure_s:g} s")
    return [*parts, sheet.stretch]


def cross_step_px(sheet: FrameScreenState) -> float:
    """Return the distance that an arrow key moves the cross, pixels of the frame."""
    squares = STEPS[sheet.step]
    return squares * (1.0 if sheet.view is None else sheet.view.px_per_square)


def cross_step_words(sheet: FrameScreenState) -> str:
    """Return the step of an arrow key in words: step 4 squares = 16 px."""
    squares, px = STEPS[sheet.step], cross_step_px(sheet)
    if squares == px:
        return f"step {px:g} px"
    return f"step {squares} square{'s' if squares > 1 else ''} = {px:.3g} px"


def marking_instructions(sheet: FrameScreenState) -> str:
    """Return the instructions for the next step of a mark by hand."""
    keys = "arrows move ╋ (shift: far), enter sets it"
    kept = f"frame {sheet.frame_id} stays markable meanwhile, for {HELD} frames"
    return f"{sheet.next_end_words}: {keys}; {cross_step_words(sheet)}, [ ] changes it; {kept}"


def scale_words(view: ZoomedFrame) -> str:
    """Return a view's scale in words, such as "4 px a square"."""
    if view.zoom is None:
        return "whole field"
    if view.zoom < 0:
        return f"{2**-view.zoom}×{2**-view.zoom} squares a px"
    return "pixel by pixel" if view.zoom == 0 else f"{2**view.zoom} px a square"


def readout_parts(sheet: FrameScreenState) -> list[str]:
    """Return what is read at the cross, in parts: pixel, step, value, direction."""
    view, pixels = sheet.view, sheet.pixels
    if view is None or pixels is None:
        return []
    x, y = math.floor(view.x_px + 0.5), math.floor(view.y_px + 0.5)
    parts = [f"╋ {x},{y}", f"step {cross_step_px(sheet):.3g} px"]
    frame_map = sheet.map
    if frame_map is not None and frame_map.mode == "fast":
        from rsoconsole.console.picture.sheet_pixels import map_snr

        parts.append(f"{map_snr(frame_map, x, y):.1f}σ")
    else:
        parts.append(f"{pixels.pixel_adu(x, y):g} ADU")
    solution = sheet.solution
    if solution is None:
        parts.append("not solved")
    else:
        from rsoconsole.sky import pixel_to_sky

        ra, dec = (float(angle) for angle in pixel_to_sky(solution.wcs, x, y))
        parts.append(direction(ra, dec))
    return parts
