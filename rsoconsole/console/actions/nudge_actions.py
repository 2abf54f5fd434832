"""Nudges: the arrows move the telescope by a step, up, down, left or right in the picture."""

from functools import partialmethod

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.actions.second_press import TwoPressKeys
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.picture.picture import Picture
from rsoconsole.control import Nudge
from rsoconsole.records import Solution

STEPS_ARCSEC = (1800.0, 600.0, 180.0, 60.0, 20.0, 5.0)
FIRST_STEP = 3


def nudge_step_words(arcsec: float) -> str:
    """Return a nudge's step in words: 30′ or 20″."""
    return f"{arcsec / 60:g}′" if arcsec >= 60 else f"{arcsec:g}″"


class NudgeActions(OperatorScreen):
    """Moves the telescope by the arrow keys, one nudge at a time, by a step that can be changed."""

    twice: TwoPressKeys
    is_nudging = False
    """True while a nudge is under way; arrows pressed meanwhile are dropped."""
    _nudge_step = FIRST_STEP
    _last_plate: Solution | None = None
    """Plate of the newest solved frame shown: the camera stays as it is when clouds come."""

    def watch_picture(self, picture: Picture | None) -> None:
        """Keep the plate of a solved frame."""
        if picture is not None and isinstance(picture.detail.solution, Solution):
            self._last_plate = picture.detail.solution

    def _nudge(self, name: str, right: float, down: float) -> None:
        """Move the telescope so that it looks ``right`` and ``down`` (-1, 0 or 1) in the picture.

        Arrows are often pressed to scroll: under autonomy they take control on a second press only.
        """
        # A key that is held down repeats: one nudge at a time, none on its way after a STOP.
        if self.is_nudging or not self.check_can_act():
            return
        if self.engine.holder == "autonomy":
            back = first_key("hold_or_resume", self.keymap)
            what = f"takes the mount from AUTO ({back} gives it back)"
            self.twice.handle_press(name, what, lambda: self._send_nudge(right, down))
        else:
            self._send_nudge(right, down)

    action_nudge_up = partialmethod(_nudge, "nudge_up", 0.0, -1.0)
    action_nudge_down = partialmethod(_nudge, "nudge_down", 0.0, 1.0)
    action_nudge_left = partialmethod(_nudge, "nudge_left", -1.0, 0.0)
    action_nudge_right = partialmethod(_nudge, "nudge_right", 1.0, 0.0)

    def _send_nudge(self, right: float, down: float) -> None:
        if self.is_nudging:
            return
        self.is_nudging = True
        east, north = self._on_the_sky(right, down)
        arcmin = STEPS_ARCSEC[self._nudge_step] / 60.0
        self.send(Nudge(east_arcmin=round(arcmin * east, 6), north_arcmin=round(arcmin * north, 6)))

    def _on_the_sky(self, right: float, down: float) -> tuple[float, float]:
        """Return a direction in the picture as (east, north): by the last plate, or north is up."""
        if self._last_plate is None:
            return -right, -down
        cd = self._last_plate.wcs.cd
        east = cd[0] * right + cd[1] * down
        north = cd[2] * right + cd[3] * down
        length = (east**2 + north**2) ** 0.5 or 1.0
        return east / length, north / length

    def _change_step(self, by: int) -> None:
        self._nudge_step = min(max(self._nudge_step + by, 0), len(STEPS_ARCSEC) - 1)
        self.say(f"nudge by {nudge_step_words(STEPS_ARCSEC[self._nudge_step])}")

    action_smaller_step = partialmethod(_change_step, 1)
    action_larger_step = partialmethod(_change_step, -1)
