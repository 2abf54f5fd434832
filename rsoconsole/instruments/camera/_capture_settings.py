"""Settings of a camera that decide what its frames are, held against other INDI clients.

They are read before each exposure and set back where another program has changed them. A change
between the order of an exposure and its frame is a race: nobody knows what it did to the frame, so
the frame is not used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.camera._sensor_window import Window, window_of
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector

BINNING, FRAME = "CCD_BINNING", "CCD_FRAME"
Binning = tuple[int, int]
"""Number of pixels joined across and along."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choice:
    """A setting that is one of several members, and what it must be."""

    wanted: tuple[str, ...]
    """Members that are right; the first that the driver offers is set."""
    words: Mapping[str, str]
    """What the camera was set to, by member; others by their name."""
    spoils: tuple[str, ...] | None = None
    """Members with which a frame is not what it should be; None: every other one."""

    def said(self, member: str) -> str:
        """Return the words of a member."""
        return self.words.get(member, member.rpartition("_")[2])


CHOICES = {
    "UPLOAD_MODE": _Choice(wanted=("UPLOAD_CLIENT",), words={}, spoils=("UPLOAD_LOCAL",)),
    "CCD_TRANSFER_FORMAT": _Choice(wanted=("FORMAT_FITS",), words={}),
    "CCD_COMPRESSION": _Choice(
        wanted=("INDI_DISABLED", "CCD_RAW"),
        words=dict.fromkeys(("INDI_ENABLED", "CCD_COMPRESS"), "compressed frames"),
        spoils=(),
    ),
    "CCD_FRAME_TYPE": _Choice(
        wanted=("FRAME_LIGHT",),
        words={
            "FRAME_DARK": "dark frames",
            "FRAME_BIAS": "bias frames",
            "FRAME_FLAT": "flat frames",
        },
    ),
    "CCD_VIDEO_STREAM": _Choice(wanted=("STREAM_OFF",), words={"STREAM_ON": "a video stream"}),
    "CCD_FAST_TOGGLE": _Choice(wanted=("INDI_DISABLED",), words={"INDI_ENABLED": "fast exposures"}),
}
"""Members of these properties that a frame needs, by the names of INDI's standard properties."""
WATCHED = frozenset((*CHOICES, BINNING, FRAME))
SAME_SHARE = 0.02
"""Share by which a pixel's size may differ from the configured one: drivers round it."""
_BY_ANOTHER = "by another program"


class CaptureSettings:
    """Compares a camera's settings with those that frames need, and sets them back."""

    def __init__(self, client: IndiClient, answer_s: float, say: Callable[[str], None]) -> None:
        """Take the driver's binning and window as they are.

        ``say``: called with what was set back.
        """
        self._client, self._answer_s, self._say = client, answer_s, say
        self._binning: Binning | None = None
        self._window: Window | None = None
        self.take_present()
        self._change = ""
        """What was changed since the exposure under way was ordered, in words; empty: nothing."""

    def expect_binning(self, joined: int) -> None:
        """Need ``joined`` pixels joined on each axis from now on."""
        self._binning = joined, joined

    def take_present(self) -> None:
        """Take the present binning and window as those that frames need."""
        self._binning = binning_of(self._client.get(BINNING))
        self._window = window_of(self._client.get(FRAME))

    def restore(self, *, is_quiet: bool = False) -> None:
        """Set back what another program has changed, and say so.

        ``is_quiet``: nothing is said: what was left so long before is nobody's change. Raises
        InstrumentError where the camera does not take what frames need.
        """
        for name, choice in CHOICES.items():
            if found := _wrong_member(self._client.get(name), choice):
                self._restore_choice(name, choice, found, is_quiet=is_quiet)
        # Joined pixels first: drivers round what they read to what those fill.
        binning = binning_of(self._client.get(BINNING))
        if self._binning is not None and binning is not None and binning != self._binning:
            values = dict(zip(("HOR_BIN", "VER_BIN"), map(float, self._binning), strict=True))
            self._restore_numbers(
                BINNING,
                values,
                _binning_words(binning),
                lambda: binning_of(self._client.get(BINNING)) == self._binning,
                is_quiet=is_quiet,
            )
        window = window_of(self._client.get(FRAME))
        if self._window is not None and window is not None and window != self._window:
            sides = dict(zip(("X", "Y", "WIDTH", "HEIGHT"), map(float, self._window), strict=True))
            self._restore_numbers(
                FRAME,
                sides,
                _window_words(window),
                lambda: window_of(self._client.get(FRAME)) == self._window,
                is_quiet=is_quiet,
            )

    def begin(self) -> None:
        """Watch from now on for the exposure that is ordered next."""
        self._change = ""
        for name in WATCHED:
            vector = self._client.get(name)
            if vector is not None:
                self.note(vector)

    def note(self, vector: Vector) -> None:
        """Note a property that was changed while an exposure is under way. Never waits.

        What a driver that has just connected says for the first time is no change.
        """
        if vector.name == FRAME and self._window is None:
            self._window = window_of(vector)
        if vector.name == BINNING and self._binning is None:
            self._binning = binning_of(vector)
        if words := self._fault(vector):
            self._change = self._change or words

    @property
    def change(self) -> str:
        """What another program has changed since ``begin``, so that the frame is of no use."""
        return self._change

    @property
    def keeps_frames(self) -> bool:
        """True where the camera keeps its frames for itself (upload mode LOCAL)."""
        vector = self._client.get("UPLOAD_MODE")
        return vector is not None and bool(vector.values.get("UPLOAD_LOCAL"))

    def _fault(self, vector: Vector) -> str:
        """Return what a property now is, in words, where a frame would be of no use; else empty."""
        if vector.name in CHOICES:
            choice = CHOICES[vector.name]
            found = _wrong_member(vector, choice)
            is_spoilt = bool(found) and (choice.spoils is None or found in choice.spoils)
            return choice.said(found) if is_spoilt else ""
        if vector.name == BINNING:
            binning = binning_of(vector)
            if binning is None or self._binning is None or binning == self._binning:
                return ""
            return _binning_words(binning)
        window = window_of(vector)
        if vector.name != FRAME or window is None or self._window is None:
            return ""
        return _window_words(window) if window != self._window else ""

    def _restore_choice(self, name: str, choice: _Choice, found: str, *, is_quiet: bool) -> None:
        vector = self._client.get(name)
        assert vector is not None
        member = next((each for each in choice.wanted if each in vector.values), choice.wanted[0])
        before = self._client.send_switch(name, member)
        answer = self._client.wait(
            name, lambda v: bool(v.values.get(member)), self._answer_s, before
        )
        if answer is None and (choice.spoils is None or found in choice.spoils):
            raise self._not_taken(choice.said(found), before)
        if answer is not None and not is_quiet:
            self._say_restored(choice.said(found))

    def _restore_numbers(
        self,
        name: str,
        values: Mapping[str, float],
        found: str,
        is_restored: Callable[[], bool],
        *,
        is_quiet: bool,
    ) -> None:
        before = self._client.send_numbers(name, values)
        self._client.wait(name, lambda _: is_restored(), self._answer_s, before)
        if not is_restored():
            raise self._not_taken(found, before)
        if not is_quiet:
            self._say_restored(found)

    def _say_restored(self, found: str) -> None:
        self._say(f"the camera was set to {found} {_BY_ANOTHER}: set back")

    def _not_taken(self, found: str, before: int) -> InstrumentError:
        why = self._client.failure_reason_since(before)
        return InstrumentError(
            f"the camera was set to {found} {_BY_ANOTHER} and cannot be set back ({why}): end that "
            "program, or set it there"
        )


def spoilt_words(change: str) -> str:
    """Return why a frame is not used, for what was changed during its exposure."""
    return f"the camera was set to {change} {_BY_ANOTHER} during the exposure"


def sensor_caution(info: Vector | None, pixel_um: float, size_px: Sequence[int]) -> str:
    """Return where a driver's sensor is not the configured one, in words; empty where it is.

    ``info``: the driver's CCD_INFO. ``pixel_um``, ``size_px``: of the configured frame, whose
    pixels may be joined.
    """
    if info is None:
        return ""
    across, along = (float(info.values.get(f"CCD_PIXEL_SIZE_{axis}") or 0.0) for axis in "XY")
    sensor = [float(info.values.get(f"CCD_MAX_{axis}") or 0.0) for axis in "XY"]
    if min(across, along, pixel_um) <= 0.0:
        return ""
    if abs(across - along) > SAME_SHARE * across:
        return f"the camera's pixels are {across:g} x {along:g} µm: frames need square ones"
    joined = max(round(pixel_um / across), 1)
    if abs(joined * across - pixel_um) > SAME_SHARE * pixel_um:
        return (
            f"the camera says that its pixels are {across:g} µm, optics.pixel_um is {pixel_um:g}:"
            " correct it"
        )
    if any(0.0 < full < (joined * px) - joined for full, px in zip(sensor, size_px, strict=True)):
        return (
            f"the camera's sensor has {sensor[0]:.0f} x {sensor[1]:.0f} pixels, fewer than"
            f" optics.width_px x optics.height_px = {size_px[0]} x {size_px[1]}: correct them"
        )
    return ""


def binning_of(vector: Vector | None) -> Binning | None:
    """Return the numbers of joined pixels; None where the driver does not say."""
    if vector is None or not (vector.values.get("HOR_BIN") and vector.values.get("VER_BIN")):
        return None
    return int(vector.values["HOR_BIN"]), int(vector.values["VER_BIN"])


def _binning_words(binning: Binning) -> str:
    return f"{binning[0]} x {binning[1]} binning"


def _window_words(window: Window) -> str:
    return f"{window[2]} x {window[3]} pixels of its sensor"


def _wrong_member(vector: Vector | None, choice: _Choice) -> str:
    """Return the member that is on and should not be; empty where all is right or not known."""
    if vector is None or not any(each in vector.values for each in choice.wanted):
        return ""
    values: Mapping[str, Any] = vector.values
    on = [name for name, is_on in values.items() if is_on]
    return next((each for each in on if each not in choice.wanted), "")
