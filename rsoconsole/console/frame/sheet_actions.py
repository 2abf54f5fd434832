"""Actions of keys and mouse on the screen of a frame at full resolution."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.screen import Screen

from rsoconsole.console.actions.mark_actions import MARK_SAID_S, no_mark_reason
from rsoconsole.console.drawing.plot import Ink
from rsoconsole.console.frame._sheet import FrameScreenState, cross_step_words
from rsoconsole.console.frame._sheet_pane import SheetPane
from rsoconsole.console.picture.marking import FAR, MOVES
from rsoconsole.console.picture.picture import STRETCHES
from rsoconsole.console.picture.sheet_pixels import STEPS, ZoomedFrame
from rsoconsole.console.watches.messages import Pointed
from rsoconsole.control import MarkByHand
from rsoconsole.records import Detection, MapMode

FINEST_MARK_PX = 1.0
SAID_S = 4.0
REFUSED_S = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkCallbacks:
    """Callbacks with which the screen of one frame sends a mark by hand to the engine."""

    send: Callable[[MarkByHand], str]
    """Sends a mark to the engine; returns words for the operator."""
    begin: Callable[[int, Callable[[str], None]], None]
    """Asks the engine to keep a frame for a mark; the callback gets the reason if it does not."""
    leave: Callable[[int], None]
    """Asks the engine to release a kept frame; no mark is sent."""
    refusal: Callable[[int], str]
    """Returns why a frame takes no mark any more; empty: it takes one, or that is not known."""


ROOM_PX = 20.0
"""Pixels in view beyond both ends of the chosen candidate."""


def view_of_streak(view: ZoomedFrame, streak: Detection) -> ZoomedFrame:
    """Return the view moved to a streak; a view of the whole field also zooms in on it."""
    there = view.at(streak.x_px, streak.y_px)
    if there.zoom is not None:
        return there
    wide, high = abs(streak.x_b_px - streak.x_a_px), abs(streak.y_b_px - streak.y_a_px)
    return there.zoomed_to_fit(wide + 2.0 * ROOM_PX, high + 2.0 * ROOM_PX)


class FrameScreenActions(Screen[None]):
    """Base of a frame's screen: keys and mouse for view, settings on trial and marks."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "Back", show=False),
        Binding("enter", "set_end", "Set an end", show=False),
        Binding("q", "app.leave", "Leave", id="leave", show=False),
        *(Binding(key, f"move('{key}')", show=False) for key in MOVES),
        *(Binding(f"shift+{key}", f"move('{key}', {FAR})", show=False) for key in MOVES),
        Binding("pageup", "other_frame(-1)", "Frame before", show=False),
        Binding("pagedown", "other_frame(1)", "Frame after", show=False),
        Binding("left_square_bracket", "step(-1)", "Smaller step", id="smaller_step", show=False),
        Binding("right_square_bracket", "step(1)", "Larger step", id="larger_step", show=False),
        Binding("plus,equals_sign", "zoom_by(-1)", "Nearer", show=False),
        Binding("minus", "zoom_by(1)", "Farther", show=False),
        Binding("z", "zoom", "Zoom", id="zoom", show=False),
        Binding("f", "stretch", "Stretch", id="stretch", show=False),
        Binding("O", "marks", "Marks on and off", show=False),
        Binding("d", "next_candidate", "Next candidate", id="follow_next", show=False),
        Binding("comma", "tau(-1)", "Smaller tau", show=False),
        Binding("full_stop", "tau(1)", "Larger tau", show=False),
        Binding("m", "mark", "Mark by hand", id="mark", show=False),
        Binding("M", "map_mode", "Map mode", show=False),
        Binding("V", "network_view", "What the network sees", show=False),
        Binding("P", "plate", "Solve again", show=False),
        Binding("R", "as_recorded", "As recorded", show=False),
        Binding("L", "list", "List", show=False),
    ]

    def __init__(self, sheet: FrameScreenState, mark_to: MarkCallbacks | None = None) -> None:
        """``mark_to``: callbacks that send marks; None: no marks, as in a night that is over."""
        super().__init__()
        self.sheet = sheet
        self._mark_to = mark_to

    def show(self) -> None:
        """Draw everything; empty here, the screen overrides it."""

    def say(self, text: str, ink: Ink = "title", seconds: float = SAID_S) -> None:
        """Show a notice for ``seconds``; empty here, the screen overrides it."""

    def process(self) -> None:
        """Have the frame processed with the settings on trial; empty here, the screen does."""

    @property
    def picture(self) -> SheetPane:
        """The widget of the frame's picture."""
        return self.query_one("#picture", SheetPane)

    # -- the view ------------------------------------------------------------------------------

    def action_move(self, key: str, times: int = 1) -> None:
        """Move the cross by ``times`` steps in an arrow's direction; the view follows."""
        across, down = MOVES[key]
        if self.sheet.view is not None:
            step = STEPS[self.sheet.step] * times
            self.sheet.view = self.sheet.view.moved(step * across, step * down)
            self.picture.redraw()

    def action_step(self, by: int) -> None:
        """Choose a larger step for the arrow keys, or with ``by`` below 0 a smaller one."""
        self.sheet.step = min(max(self.sheet.step + by, 0), len(STEPS) - 1)
        self.say(f"{cross_step_words(self.sheet)} ([ smaller, ] larger)")
        self.show()

    def action_zoom_by(self, by: int) -> None:
        """Zoom out by ``by`` factors of two; below 0 in."""
        if self.sheet.view is not None:
            self.sheet.view = self.sheet.view.zoomed(by)
            self.show()

    def action_zoom(self) -> None:
        """Zoom in by two; from the nearest view return to the whole field."""
        view = self.sheet.view
        if view is None:
            self.picture.show_next_view()
        else:
            nearer = view.zoomed(-1)
            self.sheet.view = replace(view, zoom=None) if nearer == view else nearer
            self.show()

    def action_stretch(self) -> None:
        """Draw the frame with the next of ``STRETCHES``, which map light to grey."""
        at = STRETCHES.index(self.sheet.stretch)
        self.sheet.stretch = STRETCHES[(at + 1) % len(STRETCHES)]
        self.picture.redraw()

    def action_marks(self) -> None:
        """Show or hide the marks; during a mark by hand, show or hide the other marks beside it."""
        if self.sheet.is_marking:
            self.sheet.shows_beside_mark = not self.sheet.shows_beside_mark
        else:
            self.sheet.has_marks = not self.sheet.has_marks
        self.picture.redraw()

    def action_next_candidate(self) -> None:
        """Choose the next candidate, in order of falling confidence, and move the view to it."""
        sheet = self.sheet
        count = len(sheet.candidates)
        if not count:
            return
        sheet.chosen = 0 if sheet.chosen is None else (sheet.chosen + 1) % count
        if sheet.view is not None:
            sheet.view = view_of_streak(sheet.view, sheet.candidates[sheet.chosen].latest_detection)
        self.show()

    # -- a mark by hand ------------------------------------------------------------------------

    @property
    def can_mark(self) -> bool:
        """True where this frame may accept a mark by hand; the engine can still refuse it."""
        return self._mark_to is not None and not self.sheet.fault

    def action_mark(self) -> None:
        """Begin a mark by hand; pressed again: cancel it."""
        sheet, mark_to = self.sheet, self._mark_to
        if sheet.is_marking:
            self.leave_mark()
            return
        detail = None if sheet.opened is None else sheet.opened.detail
        if mark_to is None:
            why_not = "no marks in a night that is over"
        elif sheet.fault:
            why_not = f"no mark in frame {sheet.frame_id}: its pixels were not kept"
        elif detail is None or sheet.view is None:
            why_not = "no mark yet: the frame is still being read, press it again then"
        else:
            why_not = no_mark_reason(sheet.frame_id, detail) or mark_to.refusal(sheet.frame_id)
        if why_not or mark_to is None:
            self.say(why_not, "warn", REFUSED_S)
            return
        sheet.is_marking, sheet.shows_beside_mark = True, False
        self.show()
        mark_to.begin(sheet.frame_id, self.refuse_mark)

    def refuse_mark(self, why_not: str) -> None:
        """Cancel the mark by hand, which the engine refuses in this frame, and show the reason."""
        self._end_mark()
        self.say(why_not, "warn", REFUSED_S)

    def leave_mark(self) -> None:
        """Cancel the mark by hand, and let the engine release the frame that it keeps for it."""
        self._end_mark()
        if self._mark_to is not None:
            self._mark_to.leave(self.sheet.frame_id)

    def _end_mark(self) -> None:
        sheet = self.sheet
        sheet.is_marking, sheet.first_px, sheet.coarsest_px = False, None, 0.0
        self.show()

    def action_set_end(self) -> None:
        """Set an end of the mark at the cross; with the second end the mark is sent."""
        sheet, view, mark_to = self.sheet, self.sheet.view, self._mark_to
        if not sheet.is_marking or view is None or mark_to is None:
            return
        if why_not := mark_to.refusal(sheet.frame_id):
            self.refuse_mark(why_not)
            return
        sheet.coarsest_px = max(sheet.coarsest_px, view.px_per_square, FINEST_MARK_PX)
        if sheet.first_px is None:
            sheet.first_px = (view.x_px, view.y_px)
            self.show()
            return
        (x_a, y_a), sigma_px = sheet.first_px, sheet.coarsest_px
        mark = MarkByHand(
            frame_id=sheet.frame_id,
            x_a_px=x_a,
            y_a_px=y_a,
            x_b_px=view.x_px,
            y_b_px=view.y_px,
            sigma_px=sigma_px,
        )
        self._end_mark()
        self.say(mark_to.send(mark), "title", MARK_SAID_S)

    # -- the settings --------------------------------------------------------------------------

    def _can_process(self) -> bool:
        """Return True if there are pixels to process; without them ring the bell."""
        if self.sheet.pixels is None:
            self.app.bell()
        return self.sheet.pixels is not None

    def action_tau(self, by: int) -> None:
        """Multiply tau by 1.25 to the power ``by``, and process again."""
        if not self._can_process():
            return
        sheet = self.sheet
        before = sheet.tau
        sheet.tau_steps += by
        if sheet.tau == before:
            sheet.tau_steps -= by  # at its bound: no step that would have to be gone back
        else:
            self.process()

    def action_map_mode(self) -> None:
        """Switch to the other mode of the network's map, and process again."""
        if not self._can_process():
            return
        sheet = self.sheet
        mode: MapMode = "paper" if (sheet.map_mode or sheet.recorded_mode) == "fast" else "fast"
        sheet.map_mode = None if mode == sheet.recorded_mode else mode
        self.process()

    def action_network_view(self) -> None:
        """Switch between the frame and the network's map."""
        if not self._can_process():
            return
        self.sheet.sees_as_network = not self.sheet.sees_as_network
        if self.sheet.sees_as_network and self.sheet.map is None:
            self.process()
        self.show()

    def action_plate(self) -> None:
        """Switch between the recorded plate solution and one from this frame's stars alone."""
        if not self._can_process():
            return
        self.sheet.solves_again = not self.sheet.solves_again
        self.process()

    def action_as_recorded(self) -> None:
        """Reset all settings on trial to the recorded ones, and process again."""
        if not self._can_process():
            return
        sheet = self.sheet
        sheet.tau_steps, sheet.map_mode, sheet.solves_again = 0, None, False
        self.process()

    # -- the mouse -----------------------------------------------------------------------------

    def on_pointed(self, message: Pointed) -> None:
        """Move the cross to the clicked pixel."""
        if self.sheet.view is not None and not message.is_release:
            self.sheet.view = self.sheet.view.at(message.x_px, message.y_px)
            self.picture.redraw()

    def on_mouse_scroll_up(self) -> None:
        """Zoom in by two."""
        self.action_zoom_by(-1)

    def on_mouse_scroll_down(self) -> None:
        """Zoom out by two."""
        self.action_zoom_by(1)
