"""What the screen of one frame at full resolution knows: the record, what is tried, the view."""

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rsoconsole.console.picture import STRETCHES, Stretch, View
from rsoconsole.console.tuning import Tunable
from rsoconsole.console.watches import Done, FrameSettings, Opened
from rsoconsole.records import MapMode, Solution

if TYPE_CHECKING:
    from rsoconsole.console.picture import SheetPixels
    from rsoconsole.pipeline.replay import Compared
    from rsoconsole.vision.frame import FrameMap

TAU = Tunable(name="detector.tau", label="τ", low=0.001, high=0.99)


@dataclass(slots=True)
class Sheet:
    """All that a frame's screen knows and has been told."""

    frame_id: int
    opened: Opened | None = None
    pixels: "SheetPixels | None" = None
    done: Done | None = None
    fault: str = ""
    """Why the frame's pixels cannot be shown."""
    failure: str = ""
    """Why the last wish was not fulfilled."""
    view: View | None = None
    step: int = 1
    """Which of STEPS the arrows take."""
    stretch: Stretch = STRETCHES[0]
    sees_as_network: bool = False
    has_marks: bool = True
    chosen: int | None = None
    tau_steps: int = 0
    map_mode: MapMode | None = None
    solves_again: bool = False
    wanted: FrameSettings | None = None
    """The one under way."""
    is_marking: bool = False
    first_px: tuple[float, float] | None = None
    """The first end of the mark that is made."""
    coarsest_px: float = 0.0
    """Of the views in which its ends were set."""
    shows_beside_mark: bool = False
    """Whether the marks stay over the picture while another one is made."""
    began_s: float = field(default_factory=time.monotonic)
    """When what is under way began."""

    @property
    def are_marks_shown(self) -> bool:
        """What is pointed at, over the picture; while a mark is made its ends lie beneath it."""
        return self.has_marks and (not self.is_marking or self.shows_beside_mark)

    @property
    def end_words(self) -> str:
        """Which end is to be marked; empty: none."""
        if not self.is_marking:
            return ""
        return f"mark the {'first' if self.first_px is None else 'second'} end"

    @property
    def recorded_tau(self) -> float | None:
        """In force for the frame; None until that is known."""
        return None if self.opened is None else self.opened.recorded.config.detector.tau

    @property
    def tau(self) -> float | None:
        """What is tried, or what was in force."""
        before = self.recorded_tau
        if before is None or not self.tau_steps:
            return before
        return float(TAU.stepped(before, self.tau_steps))

    @property
    def recorded_mode(self) -> MapMode | None:
        """In force for the frame."""
        return None if self.opened is None else self.opened.recorded.config.detector.map_mode

    @property
    def candidates(self) -> "tuple[Compared, ...]":
        """Then and now, or then alone."""
        if self.done is not None:
            return self.done.result.candidates
        return self.opened.candidates if self.opened is not None else ()

    @property
    def map(self) -> "FrameMap | None":
        """What the network sees, where that is looked at and known."""
        if not self.sees_as_network or self.done is None or not self.done.maps:
            return None
        return self.done.maps[0]

    @property
    def solution(self) -> Solution | None:
        """The plate by which places are told."""
        found = None
        if self.done is not None and self.done.result.is_solved_again:
            found = self.done.result.now.solution
        elif self.opened is not None:
            found = self.opened.recorded.seen.solution
        return found if isinstance(found, Solution) else None

    def wanted_settings(self) -> FrameSettings:
        """What is to be processed now."""
        return FrameSettings(
            tau=self.tau if self.tau_steps else None,
            map_mode=self.map_mode,
            solves_again=self.solves_again,
            wants_map=self.sees_as_network,
        )
