"""The camera's exposure, binning and subframe during leaps, restored afterwards."""

import logging

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.operator.by_hand import Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.engine.tasks.pace import (
    EXPOSURE,
    change_record,
    config_with_setting,
    round_to_two_digits,
)
from rsoconsole.pipeline import leap_binning

log = logging.getLogger(__name__)

_WORTH_CHANGING = 0.15


class LeapCamera:
    """Sets exposure, binning and subframe for leaps, records it, and restores them later."""

    def __init__(self, control: LoopControl, parts: Parts) -> None:
        self._control, self._session_log = control, parts.session_log
        self._camera = parts.instrument_controller.instruments.camera
        self.binning = 1
        """Pixels joined on each axis, on top of the night's configured binning."""
        self.share = 1.0
        """Part of each side of the sensor that is read out; 1: the whole sensor."""
        self._share_asked = 1.0
        self._can_read_parts = True
        self._is_said = False
        """True once it was reported that the whole sensor was not given back."""
        self._asked = 1
        """Binning requested last; the camera may have refused it."""
        self._before_s: float | None = None
        """The night's own exposure, s, where the leaps have set another; else None."""
        self._set_s = 0.0

    def begin(self) -> bool:
        """Set the binning for leaps; True where the camera's binning has changed by that.

        A camera that cannot bin is reported once, and used unbinned.
        """
        config = self._control.config
        wanted = config.leap.binning or leap_binning(config)
        if wanted == self._asked:
            return False
        self._asked, before = wanted, self.binning
        try:
            self.binning = self._camera.set_binning(wanted)
        except InstrumentError as error:
            self._session_log.say("warning", f"leaps without binning: {error}")
        if self.binning != before:
            self._session_log.say("info", f"the camera is binned {self.binning} x {self.binning}")
        return self.binning != before

    def set_subframe(self, share: float) -> bool:
        """Read only the sensor's middle from the next exposure on; True where that is a change.

        ``share``: part of each side, 1: all. A camera without subframes is reported once, and read
        out whole. Where the camera does not return to the whole sensor, the next call orders it
        again.
        """
        if share == self._share_asked or (share < 1.0 and not self._can_read_parts):
            return False
        before = self.share
        try:
            self.share = self._camera.set_subframe(share)
        except InstrumentError as error:
            if share < 1.0:
                # It may read the part all the same: the next order asks for the whole.
                self._can_read_parts, self._share_asked = False, share
                self._session_log.say("warning", f"leaps without subframes: {error}")
            elif not self._is_said:
                self._session_log.say("warning", f"the camera still reads a part: {error}")
                self._is_said = True
            return False
        self._share_asked, self._is_said = share, False
        if self.share != before:
            part = "all of its sensor"
            if self.share < 1.0:
                part = f"{100 * self.share:.0f} % of each side about the middle of its sensor"
            self._session_log.say("info", f"the camera reads {part}")
        return self.share != before

    def set_exposure(self, exposure_s: float) -> None:
        """Set the exposure, on record, where it differs enough from the present one."""
        config = self._control.config
        wanted_s = round_to_two_digits(exposure_s)
        if abs(wanted_s / config.exposure.exposure_s - 1.0) <= _WORTH_CHANGING:
            return
        if self._before_s is None:
            self._before_s = config.exposure.exposure_s
        self._set(wanted_s, "the leaps")

    def restore_settings(self) -> None:
        """Restore exposure, binning and subframe to their values before the leaps."""
        own_s, self._before_s = self._before_s, None
        if own_s is not None:
            self._set(own_s, "the end of the leaps")
        self._give_binning_back()
        self.set_subframe(1.0)

    def _give_binning_back(self) -> None:
        was_asked, self._asked = self._asked, 1
        if was_asked == 1:
            return
        try:
            self.binning = self._camera.set_binning(1)
        except InstrumentError as error:
            self._asked = was_asked  # the next time that leaps end it is tried again
            log.warning("the camera stays binned: %s", error)
            words = f"the camera stays binned {self.binning} x {self.binning}: {error}"
            self._session_log.say("warning", words)

    def apply_new_settings(self, before: Config) -> None:
        """Note new settings: an exposure that the operator sets during leaps stays after them."""
        if before.leap.subframe != self._control.config.leap.subframe:
            self._can_read_parts = True
        wanted_s = self._control.config.exposure.exposure_s
        if self._before_s is not None and wanted_s not in (before.exposure.exposure_s, self._set_s):
            self._before_s = wanted_s

    def _set(self, exposure_s: float, by: str) -> None:
        config = self._control.config
        self._set_s = exposure_s
        after = config_with_setting(config, EXPOSURE, exposure_s)
        self._session_log.append(change_record(config, after, EXPOSURE, by))
        self._control.configure(after)
