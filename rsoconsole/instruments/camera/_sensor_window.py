"""The part of the sensor that a camera reads: INDI's CCD_FRAME, in single pixels of the sensor.

As a rule a driver answers an order twice, both times with its new window: first with the state that
it had before, then with the present state. A driver that cannot read a part may send no answer.
Drivers round positions and sides; some round again when pixels are joined (binned).
"""

import contextlib
import sys
from collections.abc import Sequence
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector

FRAME, BINNING, INFO = "CCD_FRAME", "CCD_BINNING", "CCD_INFO"
SIDES = ("X", "Y", "WIDTH", "HEIGHT")
_GRID_PX = 16
"""Step to which position and sides of a part are rounded, in joined pixels."""
_ROUNDED_PX = 64
"""Largest rounding of a position or side by a driver, in pixels."""
_ANSWER_S, _SECOND_WORD_S = 3.0, 1.0

Window = list[int]
"""Part of the sensor: x, y, width, height, in single pixels of the sensor."""


class SensorWindow:
    """Sets which part of a camera's sensor is read, and restores the earlier part."""

    def __init__(self, client: IndiClient, answer_s: float) -> None:
        """``answer_s``: longest time that the driver may take to answer."""
        self._client, self._answer_s = client, min(answer_s, _ANSWER_S)
        self._remembered: Window | None = None

    def set_share(self, share: float, own: Window, size_px: Sequence[int]) -> dict[str, Any]:
        """Read only the fraction ``share`` of each side of the driver's own window.

        About its middle. ``own``: that window, as an earlier answer returned it; empty: not known.
        Then it is the whole sensor, if ``size_px`` (the configured width and height) is the whole
        sensor, as a killed engine may have left a part set; in other cases it is the present
        window. Returns ``own``, the fraction set and the window set. Raises InstrumentError where
        the camera cannot.
        """
        now = window_of(self._client.get(FRAME))
        if now is None:
            raise InstrumentError(
                "the camera's driver cannot read a part of the sensor: set leap.subframe to 1"
            )
        joined = _joined(self._client.get(BINNING))
        own = own or self._own_of(now, joined, size_px)
        wanted = central_window(own, share, _GRID_PX * joined)
        if wanted != now:
            now = self._set_window(wanted)
        share = 1.0 if wanted == own else max(now[2] / own[2], now[3] / own[3])
        return {"own": own, "share": share, "window": now}

    def restore_whole(self, size_px: Sequence[int]) -> None:
        """Set the driver's window back to the whole sensor, where a killed engine left a part set.

        ``size_px``: configured width and height. Nothing is done where these are a part of the
        sensor.
        """
        now = window_of(self._client.get(FRAME))
        whole = whole_sensor(self._client.get(INFO), size_px)
        if now is None or whole is None or not _is_about_its_middle(now, whole):
            return
        print(f"the camera was left with {now} of its sensor: it reads all", file=sys.stderr)
        with contextlib.suppress(InstrumentError):
            self._set_window(whole)

    def remember(self) -> None:
        """Note the present window before binning, because some drivers then round it."""
        self._remembered = window_of(self._client.get(FRAME))

    def restore(self) -> None:
        """Set the noted window again, where the driver has changed it."""
        before, self._remembered = self._remembered, None
        if before is not None and before != window_of(self._client.get(FRAME)):
            with contextlib.suppress(InstrumentError):
                self._set_window(before)

    def _own_of(self, now: Window, joined: int, size_px: Sequence[int]) -> Window:
        """Window that the operator has set in the driver."""
        whole = whole_sensor(self._client.get(INFO), size_px)
        if whole is not None:
            return whole
        if any(
            abs(side - joined * px) >= 2 * joined for side, px in zip(now[2:], size_px, strict=True)
        ):
            raise InstrumentError(
                f"the camera reads {now[2]} x {now[3]} pixels of its sensor, not optics.width_px x"
                " optics.height_px: correct them, or set leap.subframe to 1"
            )
        return now

    def _set_window(self, wanted: Window) -> Window:
        """Order a window; return the driver's answer, which may be rounded. Raises
        InstrumentError.
        """
        before = self._client.send_numbers(FRAME, dict(zip(SIDES, map(float, wanted), strict=True)))

        def has_taken(vector: Vector) -> bool:
            now = window_of(vector)
            return now is not None and _off_px(now, wanted) <= _ROUNDED_PX

        answer = self._client.wait(
            FRAME, lambda each: has_taken(each) or each.state == "Alert", self._answer_s, before
        )
        if answer is not None and not has_taken(answer):
            # The state may be that of the order before.
            answer = self._client.wait(FRAME, has_taken, _SECOND_WORD_S, answer.serial)
        if answer is None:
            raise InstrumentError(
                f"the camera did not take {wanted[2]} x {wanted[3]} pixels of its sensor"
                f" ({self._client.failure_reason_since(before)}): set leap.subframe to 1"
            )
        return window_of(answer) or wanted


def central_window(window: Window, share: float, grid_px: int) -> Window:
    """Return the central part of a window: ``share`` (0 to 1) of each side.

    ``grid_px``: step to which position and sides are rounded. A share of 1 returns the window.
    """
    if share >= 1.0:
        return list(window)
    x, y, width, height = window
    sides = [max(int(share * side) // grid_px, 1) * grid_px for side in (width, height)]
    corner = [
        start + (side - part) // 2 // grid_px * grid_px
        for start, side, part in zip((x, y), (width, height), sides, strict=True)
    ]
    return [*corner, *sides]


def whole_sensor(info: Vector | None, size_px: Sequence[int]) -> Window | None:
    """Return the window of the whole sensor, where the configured size is all of it.

    ``info``: the driver's CCD_INFO. ``size_px``: configured width and height; pixels may be joined.
    None where that size is only a part, or is not known to be all.
    """
    if info is None:
        return None
    sensor = [int(float(info.values.get(key, 0.0))) for key in ("CCD_MAX_X", "CCD_MAX_Y")]
    if len(size_px) != 2 or min(*sensor, *size_px) <= 0:
        return None
    joined = round(sensor[0] / size_px[0])
    is_all = joined >= 1 and all(
        abs(all_px - joined * px) < joined for all_px, px in zip(sensor, size_px, strict=True)
    )
    return [0, 0, *sensor] if is_all else None


def window_of(vector: Vector | None) -> Window | None:
    if vector is None or not all(side in vector.values for side in SIDES):
        return None
    window = [int(float(vector.values[side])) for side in SIDES]
    return window if min(window[2:]) > 0 else None  # a driver that connects has none yet


def _joined(vector: Vector | None) -> int:
    """Number of pixels joined on each axis at present."""
    return 1 if vector is None else max(int(float(vector.values.get("HOR_BIN", 1.0))), 1)


def _off_px(window: Window, wanted: Window) -> int:
    return max(abs(a - b) for a, b in zip(window, wanted, strict=True))


def _is_about_its_middle(window: Window, whole: Window) -> bool:
    """True for a centred part, as this program orders it."""
    return window[2] < whole[2] and all(
        abs((whole[n + 2] - window[n + 2]) // 2 - window[n]) <= _ROUNDED_PX for n in (0, 1)
    )
