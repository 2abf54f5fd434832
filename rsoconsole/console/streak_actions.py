"""What the operator says of the streaks in a frame: this one, not that one, here it is."""

import math
from collections.abc import Callable

from rsoconsole.console.marking import Marking
from rsoconsole.console.marks import Mark
from rsoconsole.console.messages import Pointed
from rsoconsole.console.night import FrameDetail
from rsoconsole.console.panes import FramePane
from rsoconsole.console.picture import Picture
from rsoconsole.console.reject_dialog import RejectDialog
from rsoconsole.console.second_press import CarefulSeat, has_track
from rsoconsole.control.commands import Accept, Choose, MarkByHand, Reject
from rsoconsole.records import Detection, NotSolved

CLICK_PX = 60.0
"""A click so far from a streak is not meant for it, unless the picture is coarser than that."""


class StreakActions(CarefulSeat):
    """Follow, accept, reject, mark, seek."""

    picture_waiting: Picture | None = None
    """The newest, while a mark is made in an older one."""
    marking: Marking | None = None
    """The mark that is being made; None while none is."""
    _chosen, _chosen_in = -1, -1

    def show_picture(self) -> None:
        """Draw the picture again; the screen that has it does."""

    def action_follow_next(self) -> None:
        """Go through the frame's streaks, the likeliest first."""
        streaks = self._streaks()
        if not self.may_act():
            return
        if not streaks:
            self.say("the frame has no streak to follow", "warn")
            return
        if self.picture is not None and self._chosen_in != self.picture.frame_id:
            self._chosen, self._chosen_in = -1, self.picture.frame_id
        number = (self._chosen + 1) % len(streaks)

        def choose() -> None:
            self._chosen = number
            self._choose(streaks[number])

        self._choose_carefully("follow_next", streaks[number], choose)

    def _choose_carefully(
        self, name: str, streak: Detection, choose: Callable[[], None], *, key: str = ""
    ) -> None:
        """Another streak than that which is followed ends the track: that asks twice."""
        if has_track(self.engine) and not self._is_followed(streak):
            what = f"leaves {self.track_words()} for another streak"
            self.twice(name, what, choose, key=key)
        else:
            choose()

    def _is_followed(self, streak: Detection) -> bool:
        """By the lead, or by another track, which then leads: no track ends by it."""
        if self.picture is None:
            return False
        detail = self.picture.detail
        taken = (detail.followed, *(m for m in detail.all_measured if detail.track_of(m)))
        return any(
            math.hypot(m.x_px - streak.x_px, m.y_px - streak.y_px) < 1.0
            for m in taken
            if m is not None
        )

    def _streaks(self) -> tuple[Detection, ...]:
        found = self.picture.detail.detections if self.picture is not None else None
        if found is None:
            return ()
        return (*found.detections, *(each.detection for each in found.rejected))

    def _choose(self, streak: Detection) -> None:
        assert self.picture is not None
        self.send(
            Choose(frame_id=self.picture.frame_id, x_px=streak.x_px, y_px=streak.y_px),
        )

    def action_accept(self) -> None:
        """The frame's likeliest candidate is what is followed."""
        if self.may_act():
            self.send(Accept(frame_id=self._frame_shown()))

    def action_reject(self) -> None:
        """One of the last measurements was something else: which, is asked by number."""
        if not self.may_act():
            return
        measured = self.night.measured
        if not measured:
            self.say("the track has taken no measurement yet that could be rejected", "warn")
            return

        def decided(frame_id: int | None) -> None:
            if frame_id is not None:
                self.send(Reject(frame_id=frame_id))

        self.app.push_screen(RejectDialog(measured), decided)

    def _frame_shown(self) -> int | None:
        """The frame that the operator's word is on: the one on the screen."""
        return None if self.picture is None else self.picture.frame_id

    # -- a mark by hand -------------------------------------------------------------------------

    def action_mark(self) -> None:
        """Begin a mark in the picture, or leave off."""
        if self.marking is not None:
            self.end_mark()
            return
        if not self.may_act():
            return
        drawing = self.query_one("#frame", FramePane).drawing
        if self.picture is None or drawing is None:
            self.say("there is no picture to mark in", "warn")
            return
        why_not = why_no_mark(self.picture.frame_id, self.picture.detail)
        if why_not:
            self.say(why_not, "warn")
            return
        self.marking = Marking.begin(self.picture.frame_id, drawing)
        self._show_mark()

    def end_mark(self) -> None:
        """Leave off; nothing is sent."""
        self._leave_mark()
        self.say("")

    def forget_mark(self) -> None:
        """Another session is shown: what was marked in has gone."""
        if self.marking is not None:
            self.say("the mark is left off: another session began", "warn")
        self.marking = self.picture_waiting = None

    def _leave_mark(self) -> None:
        """Show again what is newest."""
        self.marking = None
        if self.picture_waiting is not None:
            self.picture, self.picture_waiting = self.picture_waiting, None
        self.show_picture()

    def take_picture(self, picture: Picture | None) -> None:
        """The newest picture; while a mark is made, its own frame stays and the newest waits."""
        if self.marking is None or picture is None or picture.frame_id == self.marking.frame_id:
            self.picture = picture
        else:
            self.picture_waiting = picture

    def mark_in_other_view(self) -> None:
        """The view has changed while a mark is made: it goes on there."""
        drawing = self.query_one("#frame", FramePane).drawing
        if self.marking is not None and drawing is not None:
            self.marking.look(drawing)
            self._show_mark()

    def mark_key(self, key: str) -> bool:
        """A key while a mark is made; True when it was for the mark."""
        if self.marking is None:
            return False
        if key == "enter":
            self._set_end()
        elif not self.marking.move(key):
            return False
        else:
            self._show_mark()
        return True

    def on_pointed(self, message: Pointed) -> None:
        """The mouse in a picture: an end of a mark, or a streak to follow."""
        if self.marking is not None:
            self.marking.cursor_px = (message.x_px, message.y_px)
            if (message.is_release and self.marking.is_drag()) or not message.is_release:
                self._set_end(message.px_per_square)
            return
        if message.is_release or not self._streaks():
            return
        near = min(self._streaks(), key=lambda d: _away(d, message))
        if _away(near, message) <= max(CLICK_PX, 2.0 * message.px_per_square) and self.may_act():
            name = f"click at {near.x_px:.0f}, {near.y_px:.0f}"
            self._choose_carefully(name, near, lambda: self._choose(near), key="click")

    def _set_end(self, px_per_square: float | None = None) -> None:
        assert self.marking is not None
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
        self._leave_mark()

    def _show_mark(self) -> None:
        assert self.marking is not None
        which = "first" if self.marking.first_px is None else "second"
        waits = ": a newer frame waits" if self.picture_waiting is not None else ""
        self.say(f"mark the {which} end{waits}")
        self.show_picture()

    def mark_marks(self) -> tuple[Mark, ...]:
        """What the mark being made adds to the picture."""
        return () if self.marking is None else self.marking.marks()


def why_no_mark(frame_id: int, detail: FrameDetail) -> str:
    """What stands against a mark in a frame before its ends are set; empty: nothing."""
    if isinstance(detail.solution, NotSolved):
        reason = detail.solution.reason
        return f"no mark in frame {frame_id}: it was not solved ({reason}), so it has no place"
    if detail.solution is None:
        return f"no mark in frame {frame_id} yet: it is not solved yet"
    return ""


def _away(streak: Detection, at: Pointed) -> float:
    return float(((streak.x_px - at.x_px) ** 2 + (streak.y_px - at.y_px) ** 2) ** 0.5)
