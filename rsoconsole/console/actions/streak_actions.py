"""What the operator says of the streaks in a frame: this one, not that one, here it is."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rsoconsole.console.actions.seat import MARK_SAID_S, REFUSAL_S
from rsoconsole.console.actions.second_press import SETTLES_S, WITHIN_S, CarefulSeat, has_track
from rsoconsole.console.dialogs import RejectDialog
from rsoconsole.console.night import EngineView, FrameDetail
from rsoconsole.console.panes import FramePane
from rsoconsole.console.picture import Mark, Marking, Picture
from rsoconsole.console.watches import MarkHeld, Pointed
from rsoconsole.control import Accept, BeginMark, Choose, MarkByHand, Outcome, Reject
from rsoconsole.pipeline.frame import HELD
from rsoconsole.records import Detection, NotSolved

CLICK_PX = 60.0
"""A click so far from a streak is not meant for it, unless the picture is coarser than that."""
DETAILS_S = 60.0
"""So long after a mark the details that are asked for first are of its frame."""
RECALLED_S = 600.0
"""So long they are at hand beside those of the newest."""
CLICKED_S = 8.0
"""So long after a click on a streak the key means that one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pick:
    """A streak to follow."""

    frame_id: int
    number: int
    """Its place among the frame's streaks, the likeliest first."""
    streak: Detection


class StreakActions(CarefulSeat):
    """Follow, accept, reject, mark, seek."""

    picture_waiting: Picture | None = None
    """The newest, while a mark is made in an older one."""
    marking: Marking | None = None
    """The mark that is being made; None while none is."""
    _marked: tuple[int | None, float] = (None, 0.0)
    """The frame of the last mark that the engine took, and when."""
    _is_mark_unseen = False
    """Whether its details have not been asked for since."""
    _chosen, _chosen_in = -1, -1
    _picked: Pick | None = None
    _picked_until_s = 0.0
    """So long the key means that pick, though newer frames are shown."""

    def show_picture(self) -> None:
        """Draw the picture again; the screen that has it does."""

    def action_follow_next(self) -> None:
        """The streak that was asked for, else the frame's next one, the likeliest first."""
        if not self.may_act():
            return
        asked = self._picked if self.now_s() < self._picked_until_s else None
        pick = asked or self._next_pick()
        if pick is None:
            self.say("the frame has no streak to follow", "warn")
        elif has_track(self.engine) and (asked or not self._is_followed(pick.streak)):
            # Another streak ends the track: that asks twice, and the second press means the same.
            self._keep_pick(pick, WITHIN_S)
            self.twice("follow_next", self._leaves_words(pick), lambda: self._choose(pick))
        else:
            self._choose(pick)

    def _next_pick(self) -> Pick | None:
        streaks, picture = self._streaks(), self.picture
        if not streaks or picture is None:
            return None
        before = self._chosen if self._chosen_in == picture.frame_id else -1
        number = (before + 1) % len(streaks)
        return Pick(frame_id=picture.frame_id, number=number, streak=streaks[number])

    def _keep_pick(self, pick: Pick, seconds: float) -> None:
        until_s = self.now_s() + seconds + SETTLES_S
        is_same = pick == self._picked
        self._picked_until_s = max(until_s, self._picked_until_s) if is_same else until_s
        self._picked = pick

    def _leaves_words(self, pick: Pick) -> str:
        is_shown = self.picture is not None and self.picture.frame_id == pick.frame_id
        which = "another streak" if is_shown else f"a streak of frame {pick.frame_id:04d}"
        return f"leaves {self.track_words()} for {which}"

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

    def _choose(self, pick: Pick) -> None:
        self._chosen, self._chosen_in, self._picked_until_s = pick.number, pick.frame_id, 0.0
        streak = pick.streak
        self.send(Choose(frame_id=pick.frame_id, x_px=streak.x_px, y_px=streak.y_px))

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
        frame_id = self.picture.frame_id
        too_late = too_late_to_mark(self.engine, frame_id)
        why_not = why_no_mark(frame_id, self.picture.detail) or too_late
        if why_not:
            self.say(why_not, "warn", REFUSAL_S)
            return
        self.marking = Marking.begin(self.picture.frame_id, drawing)
        self._show_mark()
        self.begin_marking(frame_id, self._refuse_mark)

    def begin_marking(self, frame_id: int, refused: Callable[[str], None]) -> None:
        """Have the engine keep that frame; ``refused`` is called with why it cannot."""

        def came(outcome: Outcome) -> None:
            self.post_from_thread(MarkHeld(frame_id, outcome, refused))

        self.orders.send(BeginMark(frame_id=frame_id), came)

    def on_mark_held(self, message: MarkHeld) -> None:
        """A mark that the engine cannot take ends where it begins."""
        outcome = message.outcome
        if outcome.ok:
            return
        seat = outcome.data.get("seat")
        why = f"{seat} has control" if seat else outcome.message
        message.refused(f"no mark in frame {message.frame_id}: {why}")

    def _refuse_mark(self, why_not: str) -> None:
        if self.marking is not None:
            self._leave_mark()
        self.say(why_not, "warn", REFUSAL_S)

    def end_mark(self) -> None:
        """Leave off; nothing is sent."""
        if self.marking is not None:
            self.leave_marking(self.marking.frame_id)
        self._leave_mark()
        self.say("")

    def forget_mark(self) -> None:
        """Another session is shown: what was marked in has gone."""
        if self.marking is not None:
            self.say("the mark is left off: another session began", "warn")
        self.marking = self.picture_waiting = None
        self._picked_until_s = 0.0

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
        elif key in {"O", "upper_o"}:
            self.marking.shows_signs = not self.marking.shows_signs
            self.show_picture()
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
        if not message.is_release:
            self._click(message)

    def _click(self, at: Pointed) -> None:
        """Choose the streak there; where that would end the track, the key does it."""
        streaks, picture = self._streaks(), self.picture
        if not streaks or picture is None:
            return
        number = min(range(len(streaks)), key=lambda each: _away(streaks[each], at))
        pick = Pick(frame_id=picture.frame_id, number=number, streak=streaks[number])
        if _away(pick.streak, at) > max(CLICK_PX, 2.0 * at.px_per_square) or not self.may_act():
            return
        if has_track(self.engine) and not self._is_followed(pick.streak):
            self._keep_pick(pick, CLICKED_S)
            self.name_key("follow_next", self._leaves_words(pick))
        else:
            self._choose(pick)

    def _set_end(self, px_per_square: float | None = None) -> None:
        assert self.marking is not None
        if why_not := too_late_to_mark(self.engine, self.marking.frame_id):
            self._leave_mark()
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
        self._leave_mark()

    def _show_mark(self) -> None:
        assert self.marking is not None
        which = "first" if self.marking.first_px is None else "second"
        waits = "; a newer frame waits" if self.picture_waiting is not None else ""
        kept = f"frame {self.marking.frame_id} stays markable meanwhile, for {HELD} frames{waits}"
        self.say(f"mark the {which} end: arrows, enter; {kept}", "title", MARK_SAID_S)
        self.show_picture()

    def mark_is_taken(self, mark: MarkByHand, outcome: Outcome) -> None:
        """By the engine: its frame's details are what is asked for next."""
        self._marked, self._is_mark_unseen = (mark.frame_id, self.now_s()), True
        super().mark_is_taken(mark, outcome)

    def marked_lately(self) -> tuple[int | None, bool]:
        """The frame marked last, while it is recalled; whether its details come first, once."""
        (frame_id, at_s), is_first = self._marked, self._is_mark_unseen
        since_s, self._is_mark_unseen = self.now_s() - at_s, False
        if frame_id is None or since_s >= RECALLED_S:
            return None, False
        return frame_id, is_first and since_s < DETAILS_S

    @property
    def mark_hides_signs(self) -> bool:
        """While a mark is made: they stand where its ends are."""
        return self.marking is not None and not self.marking.shows_signs

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


def too_late_to_mark(engine: EngineView, frame_id: int) -> str:
    """Why the engine would take no mark in that frame any more; empty: it would."""
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
    """Frames 20 to 31; frames 1, 2, 20."""
    if len(frames) > 2 and frames[-1] - frames[0] == len(frames) - 1:
        return f"frames {frames[0]} to {frames[-1]}"
    return f"frame{'s' if len(frames) > 1 else ''} {', '.join(map(str, frames))}"


def _away(streak: Detection, at: Pointed) -> float:
    return float(((streak.x_px - at.x_px) ** 2 + (streak.y_px - at.y_px) ** 2) ** 0.5)
