"""Keys and clicks on the streaks of a frame: follow, accept, reject."""

import math
from dataclasses import dataclass

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.actions.second_press import SETTLES_S, WITHIN_S, TwoPressKeys, has_track
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.dialogs.candidates import RejectDialog
from rsoconsole.console.watches.messages import Pointed
from rsoconsole.control import Accept, ChooseStreak, Reject
from rsoconsole.records import Detection

CLICK_PX = 60.0
"""Largest distance of a click from the streak that it chooses, pixels; more in coarse pictures."""
CLICKED_S = 8.0
"""Seconds after a click on a streak during which the key follows the clicked streak."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakChoice:
    """A streak that the operator chose to follow."""

    frame_id: int
    number: int
    """Index among the frame's streaks, of which the likeliest is 0."""
    streak: Detection


class StreakActions:
    """The operator's choices among a frame's streaks: follow, accept, reject, by key or click."""

    def __init__(self, seat: OperatorScreen, twice: TwoPressKeys) -> None:
        self._seat, self._twice = seat, twice
        self._chosen, self._chosen_in = -1, -1
        self._choice: StreakChoice | None = None
        self._choice_until_s = 0.0
        """Monotonic time, s, until which the key follows the choice, whatever frame is shown."""

    def forget_choice(self) -> None:
        """Drop the chosen streak because another session is shown."""
        self._choice_until_s = 0.0

    def action_follow_next(self) -> None:
        """Follow the clicked streak, or the shown frame's next one, the likeliest first."""
        seat = self._seat
        if not seat.check_can_act():
            return
        asked = self._choice if seat.now_s() < self._choice_until_s else None
        pick = asked or self._next_choice()
        if pick is None:
            seat.say("the frame has no streak to follow", "warn")
        elif has_track(seat.engine) and (asked or not self.is_followed(pick.streak)):
            # Another streak ends the track: that asks twice, and the second press means the same.
            self._keep_choice(pick, WITHIN_S)
            self._twice.handle_press(
                "follow_next", self._track_end_words(pick), lambda: self._choose(pick)
            )
        else:
            self._choose(pick)

    def _next_choice(self) -> StreakChoice | None:
        streaks, picture = self.streaks(), self._seat.picture
        if not streaks or picture is None:
            return None
        before = self._chosen if self._chosen_in == picture.frame_id else -1
        number = (before + 1) % len(streaks)
        return StreakChoice(frame_id=picture.frame_id, number=number, streak=streaks[number])

    def _keep_choice(self, pick: StreakChoice, seconds: float) -> None:
        until_s = self._seat.now_s() + seconds + SETTLES_S
        is_same = pick == self._choice
        self._choice_until_s = max(until_s, self._choice_until_s) if is_same else until_s
        self._choice = pick

    def _track_end_words(self, pick: StreakChoice) -> str:
        is_shown = self._seat.picture is not None and self._seat.picture.frame_id == pick.frame_id
        which = "another streak" if is_shown else f"a streak of frame {pick.frame_id:04d}"
        return f"leaves {self._twice.track_words()} for {which}"

    def is_followed(self, streak: Detection) -> bool:
        """Return True if a track follows this streak already, so that choosing it ends no track."""
        if self._seat.picture is None:
            return False
        detail = self._seat.picture.detail
        taken = (
            detail.accepted_measurement,
            *(m for m in detail.all_measurements if detail.track_of(m)),
        )
        return any(
            math.hypot(m.x_px - streak.x_px, m.y_px - streak.y_px) < 1.0
            for m in taken
            if m is not None
        )

    def streaks(self) -> tuple[Detection, ...]:
        """Return the shown frame's detections, the likeliest first, then its rejected ones."""
        found = self._seat.picture.detail.detections if self._seat.picture is not None else None
        if found is None:
            return ()
        return (*found.detections, *(each.detection for each in found.rejected))

    def _choose(self, pick: StreakChoice) -> None:
        self._chosen, self._chosen_in, self._choice_until_s = pick.number, pick.frame_id, 0.0
        streak = pick.streak
        self._seat.send(ChooseStreak(frame_id=pick.frame_id, x_px=streak.x_px, y_px=streak.y_px))

    def action_accept(self) -> None:
        """Accept the shown frame's likeliest candidate as the followed object."""
        if self._seat.check_can_act():
            picture = self._seat.picture
            self._seat.send(Accept(frame_id=None if picture is None else picture.frame_id))

    def action_reject(self) -> None:
        """Ask which of the last measurements was of another object, and reject that one."""
        seat = self._seat
        if not seat.check_can_act():
            return
        measured = seat.night.measured
        if not measured:
            seat.say("the track has taken no measurement yet that could be rejected", "warn")
            return

        def decided(frame_id: int | None) -> None:
            if frame_id is not None:
                seat.send(Reject(frame_id=frame_id))

        seat.app.push_screen(RejectDialog(measured), decided)

    def click(self, at: Pointed) -> None:
        """Choose the streak at the mouse for the key that follows it; nothing is sent yet."""
        seat = self._seat
        streaks, picture = self.streaks(), seat.picture
        if not streaks or picture is None:
            return
        number = min(range(len(streaks)), key=lambda each: _away_px(streaks[each], at))
        pick = StreakChoice(frame_id=picture.frame_id, number=number, streak=streaks[number])
        if (
            _away_px(pick.streak, at) > max(CLICK_PX, 2.0 * at.px_per_square)
            or not seat.check_can_act()
        ):
            return
        if self.is_followed(pick.streak):
            seat.say("this streak is followed already")
            return
        self._keep_choice(pick, CLICKED_S)
        if has_track(seat.engine):
            self._twice.show_key_to_press("follow_next", self._track_end_words(pick))
        else:
            key = first_key("follow_next", seat.keymap)
            within = f"{key} within {CLICKED_S:.0f} s"
            seat.say(f"{within} follows this streak: not by the mouse", "warn", CLICKED_S)


def _away_px(streak: Detection, at: Pointed) -> float:
    return float(((streak.x_px - at.x_px) ** 2 + (streak.y_px - at.y_px) ** 2) ** 0.5)
