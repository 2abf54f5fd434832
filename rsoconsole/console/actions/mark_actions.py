"""Marks by hand: the operator sets both ends of a streak missed or badly measured."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.dialogs.dialogs import ConfirmDialog
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.picture.marking import UnfinishedMark
from rsoconsole.console.picture.marks import Mark
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.watches.messages import Pointed, call_between_messages
from rsoconsole.control import BeginMark, MarkByHand, Outcome, Sender
from rsoconsole.night import NightFrame, NightView
from rsoconsole.pipeline import HELD
from rsoconsole.records import NotSolved
from rsoconsole.words import angle

REFUSAL_S = 10.0
MARK_SAID_S = 30.0
"""Seconds that the result of a mark is shown: an opened frame may cover the notice at first."""
DETAILS_S = 60.0
"""Seconds after a mark during which the key ``v`` lists the marked frame's streaks first."""
RECALLED_S = 600.0
"""Seconds after a mark during which the key ``v`` can list the marked frame's streaks too."""


class MarkActions(OperatorScreen):
    """Makes a mark by keys or mouse, and shows the engine's answer to the last mark."""

    newer_picture: Picture | None = None
    """The newest picture, held back while a mark is made in an older one; else None."""
    marking: UnfinishedMark | None = None
    """The unfinished mark; None while no mark is being made."""
    _marked: tuple[int | None, float] = (None, 0.0)
    """Frame of the last mark that the engine accepted, and its time in monotonic seconds."""
    _has_unread_details = False
    """True until that frame's streaks have been shown."""

    def action_mark(self) -> None:
        """Begin a mark, in the close-up if there is one; pressed again: cancel the mark."""
        if self.marking is not None:
            self.cancel_mark()
            return
        if not self.check_can_act():
            return
        drawing = self.drawing
        if self.picture is None or drawing is None:
            self.say("there is no picture to mark in", "warn")
            return
        frame_id = self.picture.frame_id
        too_late = late_mark_reason(self.engine, frame_id)
        why_not = no_mark_reason(frame_id, self.picture.detail) or too_late
        if why_not:
            self.say(why_not, "warn", REFUSAL_S)
            return
        self.marking = UnfinishedMark.begin(frame_id, drawing)
        self.look_closely()
        self.marking = UnfinishedMark.begin(frame_id, self.drawing or drawing)
        self._show_mark()
        self.begin_mark(frame_id, self._refuse_mark)

    def begin_mark(self, frame_id: int, refused: Callable[[str], None]) -> None:
        """Ask the engine to keep a frame for a mark; ``refused`` gets the reason if it does not."""

        def came(outcome: Outcome) -> None:
            if not outcome.ok:
                seat = outcome.data.get("seat")
                why = f"{seat} has control" if seat else outcome.message
                refused(f"no mark in frame {frame_id}: {why}")

        self.orders.send(BeginMark(frame_id=frame_id), partial(call_between_messages, self, came))

    def _refuse_mark(self, why_not: str) -> None:
        if self.marking is not None:
            self._end_mark()
        self.say(why_not, "warn", REFUSAL_S)

    def cancel_mark(self) -> None:
        """Cancel the unfinished mark; no mark is sent."""
        if self.marking is not None:
            self.release_marked_frame(self.marking.frame_id)
        self._end_mark()
        self.say("")

    def drop_mark_on_new_session(self) -> None:
        """Cancel the unfinished mark because another session is shown now."""
        if self.marking is not None:
            self.say("the mark is left off: another session began", "warn")
        self.marking = self.newer_picture = None

    def _end_mark(self) -> None:
        """End the mark and show the newest picture again."""
        self.marking = None
        if self.newer_picture is not None:
            self.picture, self.newer_picture = self.newer_picture, None
        self.show_picture()

    def receive_picture(self, picture: Picture | None) -> None:
        """Show a picture; while a mark is made in another frame, hold the picture back."""
        if self.marking is None or picture is None or picture.frame_id == self.marking.frame_id:
            self.picture = picture
        else:
            self.newer_picture = picture

    def handle_view_change(self) -> None:
        """Fit the unfinished mark's scale and bounds to the picture's new view."""
        drawing = self.drawing
        if self.marking is not None and drawing is not None:
            self.marking.look(drawing)
            self._show_mark()

    def handle_mark_key(self, key: str) -> bool:
        """Handle a key while a mark is made; False: no mark is made, or the key is not for it."""
        if self.marking is None:
            return False
        if key == "enter":
            self._set_mark_end()
        elif key in {"O", "upper_o"}:
            self.marking.shows_signs = not self.marking.shows_signs
            self.show_picture()
        elif not self.marking.move(key):
            return False
        else:
            self._show_mark()
        return True

    def set_mark_end(self, message: Pointed) -> None:
        """Move the mark's cursor to the mouse, and set an end there.

        Releasing the mouse sets an end only after a drag.
        """
        assert self.marking is not None
        self.marking.cursor_px = (message.x_px, message.y_px)
        if (message.is_release and self.marking.is_dragged()) or not message.is_release:
            self._set_mark_end(message.px_per_square)

    def _set_mark_end(self, px_per_square: float | None = None) -> None:
        assert self.marking is not None
        if why_not := late_mark_reason(self.engine, self.marking.frame_id):
            self._end_mark()
            self.say(why_not, "warn", REFUSAL_S)
            return
        ends = self.marking.set_end(px_per_square)
        if ends is None:
            self._show_mark()
            return
        (x_a, y_a), (x_b, y_b) = ends
        self.send(
            MarkByHand(
                frame_id=self.marking.frame_id,
                x_a_px=x_a,
                y_a_px=y_a,
                x_b_px=x_b,
                y_b_px=y_b,
                sigma_px=max(self.marking.coarsest_px, 1.0),
            )
        )
        self._end_mark()

    def _show_mark(self) -> None:
        assert self.marking is not None
        which = "first" if self.marking.first_px is None else "second"
        waits = "; a newer frame waits" if self.newer_picture is not None else ""
        kept = f"frame {self.marking.frame_id} stays markable meanwhile, for {HELD} frames{waits}"
        self.say(f"mark the {which} end: arrows, enter; {kept}", "title", MARK_SAID_S)
        self.show_picture()

    def report_mark_accepted(self, mark: MarkByHand, outcome: Outcome) -> None:
        """Report that the engine accepted a mark; the track takes the mark with the next frame."""
        self._marked, self._has_unread_details = (mark.frame_id, self.now_s()), True
        said = f"your mark in frame {mark.frame_id} is {outcome.message or 'sent'}"
        self.say(said, "good", MARK_SAID_S)

    def _ask_to_replace(self, mark: MarkByHand, outcome: Outcome) -> None:
        """Ask whether a mark shall replace a better measurement, with both sigmas."""

        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                self.send(replace(mark, replaces=True))
            else:
                self.say(f"your mark in frame {mark.frame_id} is not used", "title", MARK_SAID_S)
                self.release_marked_frame(mark.frame_id)

        self.say("the mark waits for your word", "warn")
        own, better = (
            angle(float(outcome.data.get(name) or 0.0))
            for name in ("sigma_arcsec", "better_arcsec")
        )
        text = (
            f"Yours is good to ±{own}: {outcome.data.get('how', '')}.\n"
            f"Frame {mark.frame_id} has it measured to ±{better} already.\n\n"
            "Enter again takes yours instead; esc leaves it as it is."
        )
        self.open_unrequested_dialog(
            ConfirmDialog("a better measurement", text, yes="Take mine", letter="m", is_yes=True),
            decided,
        )

    def release_marked_frame(self, frame_id: int | None) -> None:
        """Ask the engine to release the frame that it keeps for a mark; do nothing for None."""
        if frame_id is not None and self.can_act:
            self.orders.send(BeginMark(frame_id=frame_id, is_on=False), lambda _outcome: None)

    def report_mark_result(self, before: NightView) -> None:
        """Report the results of this console's marks in the log lines recorded since ``before``."""
        own = Sender.console(self.seat_name).words
        for line in self.log_lines_since(before):
            if line.marked_by == own:
                self.say(f"your {line.words}", "good", MARK_SAID_S)

    def recent_mark(self) -> tuple[int | None, bool]:
        """Return the frame marked last, and whether its streaks are to be listed first.

        The frame is None where none was marked within ``RECALLED_S``. The second value is True
        only at the first call, within ``DETAILS_S`` of the mark.
        """
        (frame_id, at_s), is_first = self._marked, self._has_unread_details
        since_s, self._has_unread_details = self.now_s() - at_s, False
        if frame_id is None or since_s >= RECALLED_S:
            return None, False
        return frame_id, is_first and since_s < DETAILS_S

    @property
    def is_marking(self) -> bool:
        """True while a mark is made by hand."""
        return self.marking is not None

    @property
    def hides_signs(self) -> bool:
        """True while a mark is made with the streaks' signs hidden: they cover its ends."""
        return self.marking is not None and not self.marking.shows_signs

    def unfinished_mark_signs(self) -> tuple[Mark, ...]:
        """Return the signs of the unfinished mark: its cursor and first end; empty without one."""
        return () if self.marking is None else self.marking.marks()


def no_mark_reason(frame_id: int, detail: NightFrame) -> str:
    """Return why a frame cannot be marked: not solved, or not solved yet; empty if it can be."""
    if isinstance(detail.solution, NotSolved):
        reason = detail.solution.reason
        return f"no mark in frame {frame_id}: it was not solved ({reason}), so it has no place"
    if detail.solution is None:
        return f"no mark in frame {frame_id} yet: it is not solved yet"
    return ""


def late_mark_reason(engine: EngineView, frame_id: int) -> str:
    """Return why a frame is too old to be marked; empty if it is not, or if that is not known."""
    frames = engine.markable_frames
    if not engine.is_attached or frames is None or frame_id in frames:
        return ""
    if frame_id > max(frames, default=(engine.frame_id or 0) - 1):
        return ""  # newer than the engine's last word
    if not frames:
        return f"no mark in frame {frame_id}: the next one takes one"
    return (
        f"frame {frame_id} is too old to mark: only {_frames_text(frames)} can be;"
        " on the main screen enter opens the newest"
    )


def _frames_text(frames: Sequence[int]) -> str:
    """Return frame numbers in words: "20 to 31", "1, 2, 20"."""
    if len(frames) > 2 and frames[-1] - frames[0] == len(frames) - 1:
        return f"frames {frames[0]} to {frames[-1]}"
    return f"frame{'s' if len(frames) > 1 else ''} {', '.join(map(str, frames))}"
