"""Keys that act on the telescope: each sends one command or asks one question."""

import math
import time
from collections.abc import Callable, Iterable
from typing import Any

from rsoconsole.config import Config
from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.actions.second_press import RELEASED_S, WITHIN_S, TwoPressKeys, has_track
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.dialogs.ask import (
    AimDialog,
    ExposureDialog,
    GotoDialog,
    MoveDialog,
    SettingsDialog,
)
from rsoconsole.console.dialogs.dialogs import ConfirmDialog
from rsoconsole.console.dialogs.up_list import VisibleSatellitesDialog
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.control import (
    Arm,
    Command,
    Disarm,
    Goto,
    Hold,
    Outcome,
    Park,
    Resume,
    Seek,
    Set,
    SetTracking,
    Unpark,
)
from rsoconsole.records import Solution
from rsoconsole.sky import pixel_to_sky

AGAIN_S = 60.0
"""Longest wait, s, for the engine to follow the kept track after it has accepted the request."""


class TelescopeActions:
    """The telescope's keys: arm, hold, park, follow again, go to, expose and others."""

    def __init__(
        self, seat: OperatorScreen, twice: TwoPressKeys, take_back_drop: Callable[[], bool]
    ) -> None:
        """``take_back_drop``: follows the last dropped track again; False where there is none."""
        self._seat, self._twice, self._take_back_drop = seat, twice, take_back_drop
        self._no_arming_before_s = 0.0
        """Monotonic time, s, before which a press may still be meant for the last disarming."""
        self.is_arming = False
        """True while arming for the kept track is under way: a key held down does not repeat it."""
        self.at_rest_since_s = -WITHIN_S
        """Monotonic time, s, at which autonomy last lost the mount or STOP was given here."""
        self._asked_again_s = -math.inf
        """Monotonic time, s, of the unanswered request to follow the kept track; -inf: none."""

    def handle_outcome(self, command: Command, outcome: Outcome) -> None:
        """End the waiting for arming or following again, where the engine's answer ends it."""
        if isinstance(command, Arm):
            self.is_arming = False
        if isinstance(command, Arm | Resume) and not outcome.ok:
            self._asked_again_s = -math.inf

    @property
    def is_following_again(self) -> bool:
        """True from the request to follow the kept track again until the engine follows it."""
        return (
            self._seat.engine.kept is not None
            and self._seat.now_s() < self._asked_again_s + AGAIN_S
        )

    def handle_refused_verbs(self, verbs: frozenset[str]) -> None:
        """End a pending request to follow again, if its command is among the refused ``verbs``."""
        if verbs & {Arm.verb, Resume.verb}:
            self._asked_again_s = -math.inf

    def handle_stop(self) -> None:
        """Note the time of a STOP; cancel a pending request to follow the kept track again."""
        self.at_rest_since_s = self._seat.now_s()
        self._asked_again_s = -math.inf

    def handle_control_change(self, before: EngineView) -> None:
        """Note the time if autonomy lost the mount; end a pending request to follow again.

        The request ends where autonomy lost the mount or no track is kept any more. ``before``: the
        engine's previous status.
        """
        seat = self._seat
        is_lost = before.holder == "autonomy" != seat.engine.holder
        if is_lost:
            self.at_rest_since_s = seat.now_s()
        if is_lost or seat.engine.kept is None:
            self._asked_again_s = -math.inf

    def action_arm_or_disarm(self) -> None:
        """Arm; where armed, disarm. While there is a track, disarming needs a second press."""
        seat = self._seat
        if not seat.check_can_act():
            return
        is_armed = seat.engine.holder == "autonomy"
        if seat.is_click and not has_track(seat.engine):
            key = first_key("arm_or_disarm", seat.keymap)
            does = "takes it from the engine" if is_armed else "hands the mount to the engine"
            seat.say(f"{key} {does}: by the key alone, not by the mouse")
        elif not is_armed:
            self._arm()
        elif has_track(seat.engine):
            self._arm_not_within(WITHIN_S)
            what = f"ends the track of {self._twice.track_words()}"
            self._twice.handle_press("arm_or_disarm", what, self._disarm)
        else:
            self._disarm()

    def _arm(self) -> None:
        seat = self._seat
        if seat.now_s() >= self._no_arming_before_s:
            seat.send(Arm())
            return
        # A key that is held down goes on repeating.
        self._arm_not_within(RELEASED_S)
        key = first_key("arm_or_disarm", seat.keymap)
        seat.say(f"not armed: {key} was Disarm a moment ago. Wait {WITHIN_S:.0f} s, then press it")

    def _disarm(self) -> None:
        self._arm_not_within(RELEASED_S)
        self._seat.send(Disarm())

    def _arm_not_within(self, seconds: float) -> None:
        self._no_arming_before_s = max(self._no_arming_before_s, self._seat.now_s() + seconds)

    def action_hold_or_resume(self) -> None:
        """Hold (no slews), or resume where it holds; where a track is kept, follow it again."""
        seat = self._seat
        if not seat.check_can_act():
            return
        is_at_rest = seat.engine.holder != "autonomy"
        if seat.engine.kept is not None and is_at_rest:
            self._follow_again(is_certain=False)
        elif seat.engine.is_autonomy_waiting:
            seat.send(Resume())
        elif seat.engine.holder == "autonomy":
            seat.send(Hold())
        else:
            seat.say("nothing to hold: the engine is not armed", "warn")

    def action_wait_for_sky(self) -> None:
        """Hold until the stars are back; autonomy resumes by itself then."""
        seat = self._seat
        if not seat.check_can_act():
            return
        if seat.engine.holder == "autonomy":
            seat.send(Hold(until="clear"))
        else:
            seat.say("nothing to hold: the engine is not armed", "warn")

    def action_park(self) -> None:
        """Ask for confirmation, then disarm and park the mount."""
        seat = self._seat
        if not seat.check_can_act():
            return

        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                seat.send(Park())

        text = "The engine disarms and sends the mount to its park position."
        if has_track(seat.engine):
            text += f" This ends the track of {self._twice.track_words()}."
        dialog = ConfirmDialog("park the mount", text, yes="Park", letter="y")
        seat.app.push_screen(dialog, decided)

    def action_undo(self) -> None:
        """Unpark a parked mount; else take the last drop back, or follow the kept track again."""
        seat = self._seat
        if not seat.check_can_act():
            return
        if seat.is_stopping:
            self._follow_again(is_certain=True)  # what the engine said last is from before it
        elif seat.engine.is_parked:
            seat.send(Unpark())
        elif self._take_back_drop():
            pass
        elif seat.engine.kept is not None:
            self._follow_again(is_certain=True)
        elif has_track(seat.engine):
            seat.say(f"already being followed: {self._twice.track_words()}")
        else:
            arm = first_key("arm_or_disarm", seat.keymap)
            is_at_rest = seat.engine.holder != "autonomy"
            then = f": {arm} arms, and it searches" if is_at_rest else ""
            seat.say(f"nothing is kept that could be followed again{then}", "warn")

    def _follow_again(self, *, is_certain: bool) -> None:
        """Follow the kept track; after a STOP or a fault the arming checks come first.

        ``is_certain``: the key has no other meaning, no matter who has the mount.
        """
        seat = self._seat
        left_s = self.at_rest_since_s + WITHIN_S - seat.now_s()
        has_hold = seat.engine.is_resumable or seat.engine.holder == "autonomy"
        if self.is_following_again:
            seat.say(f"already being followed again: {seat.engine.kept}")
        elif has_hold and not seat.is_stopping:
            self._asked_again_s = seat.now_s()
            seat.send(Resume())
        elif left_s > 0.0 and is_certain and self._is_stop_answered:
            self._follow_in(left_s)
        elif left_s > 0.0 or seat.is_stopping:
            # It may have been pressed before the mount was taken from autonomy.
            undo = first_key("undo", seat.keymap)
            wait = f"wait {WITHIN_S:.0f} s, then press {undo}"
            seat.say(f"not followed again: autonomy has just lost the mount; {wait}", "warn")
        elif not self.is_arming:
            self.is_arming, self._asked_again_s = True, seat.now_s()
            seat.send(Arm(), then=Resume())

    @property
    def _is_stop_answered(self) -> bool:
        """True where STOP was given here and the mount's driver has answered it."""
        news = self._seat.stop_news
        return news is not None and news.phase in ("answered", "stopped")

    def _follow_in(self, left_s: float) -> None:
        """Follow the kept track in ``left_s`` seconds, unless another key or STOP comes before."""
        seat = self._seat
        undo, stop = (first_key(name, seat.keymap) for name in ("undo", "stop_by_letter"))
        wait = f"in {math.ceil(left_s)} s; {stop} or any other key: not"
        seat.say(f"{undo}: follows it again {wait}", "warn", left_s)
        stops, number = seat.stops, self._twice.press.number

        def when_due() -> None:
            if seat.stops != stops or not seat.can_act:
                return
            if seat.is_stopping:
                seat.say(f"the engine is still ending what it does: press {undo} again", "warn")
            elif seat.engine.holder == "autonomy":
                pass  # somebody else has armed it
            elif self._twice.press.number != number:
                seat.say("not followed again: another key came behind it", "warn")
            elif seat.engine.kept is None:
                seat.say("nothing is kept that could be followed again", "warn")
            else:
                self._follow_again(is_certain=True)

        seat.set_timer(left_s, when_due)

    def action_seek(self) -> None:
        """Search round the predicted position; giving up a track needs a second press."""
        seat = self._seat
        if not seat.check_can_act():
            return
        if has_track(seat.engine):
            what = f"gives up the track of {self._twice.track_words()} and searches for it"
            self._twice.handle_press("seek", what, lambda: seat.send(Seek()))
        else:
            seat.send(Seek())

    def action_track_or_stand(self) -> None:
        """Switch the mount's sidereal tracking off where it is on, and on where it is off."""
        seat = self._seat
        if seat.check_can_act():
            seat.send(SetTracking(is_on=not seat.engine.is_tracking))

    def action_exposure(self) -> None:
        """Ask for the exposure and the cadence to use from now on."""
        if self._seat.check_can_act():
            self._ask_settings(ExposureDialog(self._settings(ExposureDialog.NAMES)))

    def action_aim(self) -> None:
        """Ask for an offset from the predicted position; the dialog previews its effect."""
        if self._seat.check_can_act():
            self._ask_settings(AimDialog(self._settings(AimDialog.NAMES), self._seat.orders))

    def _settings(self, names: Iterable[str]) -> dict[str, Any]:
        return {name: self._seat.night.setting(name) for name in names}

    def _ask_settings(self, dialog: SettingsDialog) -> None:
        def decided(wanted: dict[str, float] | None) -> None:
            for name, value in (wanted or {}).items():
                self._seat.send(Set(name=name, value=value))

        self._seat.app.push_screen(dialog, decided)

    # -- by hand ------------------------------------------------------------------------------

    def action_goto(self) -> None:
        """Ask for a direction to go to; the dialog shows the path there before anything moves."""
        self._ask_where("")

    def _ask_where(self, begun: str) -> None:
        """Ask for a direction to go to; ``begun``: text already in the field."""
        seat = self._seat
        if not seat.check_can_act():
            return

        def decided(direction: tuple[float, float] | None) -> None:
            if direction is not None:
                seat.send(Goto(ra_icrs_deg=direction[0], dec_icrs_deg=direction[1]))

        undo = first_key("undo", seat.keymap)
        kept = f"{self._twice.track_words()} is kept meanwhile: {undo} follows it again"
        dialog = GotoDialog(
            self._config,
            self._now_utc_ns,
            seat.orders,
            begun,
            kept if has_track(seat.engine) else "",
        )
        seat.app.push_screen(dialog, decided)

    def action_up_now(self) -> None:
        """List the satellites above the limit; for the chosen one the go-to dialog opens."""

        def decided(number: str | None) -> None:
            if number is not None:
                self._ask_where(number)

        self._seat.app.push_screen(VisibleSatellitesDialog(self._config, self._now_utc_ns), decided)

    def _config(self) -> Config | None:
        """Return the night's settings, or the defaults where it has none; None: not read yet."""
        night = self._seat.night
        return night.config or (Config() if night.is_read else None)

    def _now_utc_ns(self) -> int:
        """Return the frame clock, UTC nanoseconds."""
        return self._seat.engine.now_utc_ns or time.time_ns()

    def action_centre(self) -> None:
        """Ask, then point the telescope at the followed streak, or at the likeliest one."""
        seat = self._seat
        if not seat.check_can_act():
            return
        picture = seat.picture
        detail = picture.detail if picture is not None else None
        if detail is None or not isinstance(detail.solution, Solution):
            seat.say("nothing can be pointed at: the frame has no plate", "warn")
            return
        followed = detail.accepted_measurement
        found = detail.detections.detections if detail.detections is not None else ()
        if followed is not None and seat.night.track is not None:
            from rsoconsole.pipeline import direction_at

            # Where it is now: it has gone on since the frame.
            place = direction_at(seat.night.track, self._now_utc_ns())
        elif followed is not None:
            place = followed.ra_icrs_deg, followed.dec_icrs_deg
        elif found:
            ra, dec = pixel_to_sky(detail.solution.wcs, found[0].x_px, found[0].y_px)
            place = float(ra), float(dec)
        else:
            seat.say("the frame has no streak to centre", "warn")
            return

        def decided(is_wanted: bool | None) -> None:
            if is_wanted:
                seat.send(Goto(ra_icrs_deg=place[0], dec_icrs_deg=place[1]))

        has_it = seat.engine.holder == "autonomy"
        back = first_key("hold_or_resume", seat.keymap)
        caution = f"autonomy has the mount: this takes it, {back} gives it back" if has_it else ""
        dialog = MoveDialog(place, caution, seat.orders)
        seat.app.push_screen(dialog, decided)
