"""Settings of a camera that decide what its frames are, held against other INDI clients.

They are read before each exposure and set back where another program has changed them. A change
between the order of an exposure and its frame is a race: nobody knows what it did to the frame, so
the frame is not used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.camera._sensor_window import BINNING, FRAME, SIDES
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector

NUMBERS = {
    BINNING: (("HOR_BIN", "VER_BIN"), "binning"),
    FRAME: (SIDES, "pixels of its sensor"),
}
"""Members of the numbers that a frame needs, and words for them. Joined pixels come first: drivers
round what they read to what those fill."""
Figures = tuple[int, ...]


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
WATCHED = frozenset((*CHOICES, *NUMBERS))
SAME_SHARE = 0.02
"""Share by which a pixel's size may differ from the configured one: drivers round it."""
_HARMLESS_S = 3.0
"""Longest wait for a driver to set back what spoils no frame."""
_BY_ANOTHER = "by another program"


class CaptureSettings:
    """Compares a camera's settings with those that frames need, and sets them back."""

    def __init__(self, client: IndiClient, answer_s: float, say: Callable[[str], None]) -> None:
        """Take the driver's binning and window as they are.

        ``say``: called with what was set back.
        """
        self._client, self._answer_s, self._say = client, answer_s, say
        self._needed: dict[str, Figures | None] = {}
        """Numbers that frames need, by property; None: not known."""
        self._refused: set[str] = set()
        """Harmless settings that the driver does not set back."""
        self.change = ""
        """What another program has changed since ``begin``, so that the frame is of no use."""
        self.take_present()

    def expect_binning(self, joined: int) -> None:
        """Need ``joined`` pixels joined on each axis from now on."""
        self._needed[BINNING] = joined, joined

    def take_present(self) -> None:
        """Take the present binning and window as those that frames need."""
        self._needed = {name: figures_of(self._client.get(name)) for name in NUMBERS}

    def restore(self, *, is_quiet: bool = False) -> None:
        """Set back what another program has changed, and say so.

        ``is_quiet``: nothing is said, as nobody is known to have changed it. Raises InstrumentError
        where the camera does not take what frames need.
        """
        for name in (*CHOICES, *NUMBERS):
            vector = self._client.get(name)
            found = "" if vector is None or name in self._refused else self._difference(vector)
            if not found or vector is None:
                continue
            is_harmless = not self._fault(vector)
            before = self._order(vector)
            answer = self._client.wait(
                name,
                lambda each: not self._difference(each),
                _HARMLESS_S if is_harmless else self._answer_s,
                before,
            )
            if answer is None and not is_harmless:
                raise InstrumentError(
                    f"the camera was set to {found} {_BY_ANOTHER} and cannot be set back"
                    f" ({self._client.failure_reason_since(before)}): end that program, or set it"
                    " there"
                )
            if answer is None:
                self._refused.add(name)
            elif not is_quiet:
                self._say(f"the camera was set to {found} {_BY_ANOTHER}: set back")

    def begin(self) -> None:
        """Watch from now on for the exposure that is ordered next."""
        self.change = ""
        for name in WATCHED:
            vector = self._client.get(name)
            if vector is not None:
                self.note(vector)

    def note(self, vector: Vector) -> None:
        """Note a property that was changed while an exposure is under way. Never waits.

        What a driver that has just connected says for the first time is no change.
        """
        if vector.name in NUMBERS and self._needed[vector.name] is None:
            self._needed[vector.name] = figures_of(vector)
        self.change = self.change or self._fault(vector)

    @property
    def keeps_frames(self) -> bool:
        """True where the camera keeps its frames for itself (upload mode LOCAL)."""
        vector = self._client.get("UPLOAD_MODE")
        return vector is not None and bool(vector.values.get("UPLOAD_LOCAL"))

    def _difference(self, vector: Vector) -> str:
        """Return what a property is, in words, where frames need it otherwise; else empty."""
        if vector.name in CHOICES:
            choice = CHOICES[vector.name]
            found = _wrong_member(vector, choice)
            return choice.said(found) if found else ""
        found_figures, needed = figures_of(vector), self._needed[vector.name]
        if found_figures is None or needed is None or found_figures == needed:
            return ""
        return "{} x {} {}".format(*found_figures[-2:], NUMBERS[vector.name][1])

    def _fault(self, vector: Vector) -> str:
        """Return the same words where a frame is then of no use; else empty."""
        choice = CHOICES.get(vector.name)
        spoils = None if choice is None else choice.spoils
        if (
            choice is not None
            and spoils is not None
            and _wrong_member(vector, choice) not in spoils
        ):
            return ""
        return self._difference(vector)

    def _order(self, vector: Vector) -> int:
        """Order what frames need; return the number of the last update before the order."""
        if vector.name in CHOICES:
            wanted = CHOICES[vector.name].wanted
            member = next(each for each in wanted if each in vector.values)
            return self._client.send_switch(vector.name, member)
        needed, members = self._needed[vector.name], NUMBERS[vector.name][0]
        assert needed is not None
        return self._client.send_numbers(
            vector.name, dict(zip(members, map(float, needed), strict=True))
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


def figures_of(vector: Vector | None) -> Figures | None:
    """Return a property of ``NUMBERS`` as integers; None where the driver does not say them yet."""
    if vector is None:
        return None
    figures = tuple(int(vector.values.get(each) or 0) for each in NUMBERS[vector.name][0])
    return figures if min(figures[-2:]) > 0 else None


def _wrong_member(vector: Vector | None, choice: _Choice) -> str:
    """Return the member that is on and should not be; empty where all is right or not known."""
    if vector is None or not any(each in vector.values for each in choice.wanted):
        return ""
    on = [name for name, is_on in vector.values.items() if is_on]
    return next((each for each in on if each not in choice.wanted), "")
