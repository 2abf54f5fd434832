"""Read-out modes of the simulated camera: binning and sub-frame, as INDI defines them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from indipydriver import NumberVector

from rsoconsole.simulator.camera.indi_fits import CameraTraits, Card
from rsoconsole.simulator.mount.indi_vectors import number_vector

_GROUP = "Image Settings"
MAX_BINNING = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOutMode:
    """One read-out mode: binning, and the part of the sensor in unbinned pixels."""

    binning: int
    x_px: int
    y_px: int
    width_px: int
    height_px: int

    @classmethod
    def of_whole_sensor(cls, traits: CameraTraits) -> "ReadOutMode":
        """Read-out of the whole sensor with the scene's own binning, the driver's initial mode."""
        binning = traits.binning
        return cls(
            binning=binning,
            x_px=0,
            y_px=0,
            width_px=traits.width_px * binning,
            height_px=traits.height_px * binning,
        )

    def with_binning(self, horizontal: float, vertical: float) -> "ReadOutMode | None":
        """Return this mode with another binning; None where the camera does not offer it.

        The camera offers equal whole factors on both axes, up to ``MAX_BINNING``.
        """
        is_square = horizontal == vertical == int(horizontal)
        if not (is_square and 1 <= horizontal <= MAX_BINNING):
            return None
        return replace(self, binning=int(horizontal))

    def with_sub_frame(
        self, wanted: Mapping[str, float], traits: CameraTraits
    ) -> "ReadOutMode | None":
        """Return this mode with another sub-frame; None where it is too small or off the sensor.

        ``wanted``: X, Y, WIDTH and HEIGHT of CCD_FRAME, unbinned pixels.
        """
        whole = ReadOutMode.of_whole_sensor(traits)
        x, y, width, height = (int(wanted[each]) for each in ("X", "Y", "WIDTH", "HEIGHT"))
        least = self.binning * 16
        is_inside = x >= 0 and y >= 0 and width >= least and height >= least
        if not is_inside or x + width > whole.width_px or y + height > whole.height_px:
            return None
        return replace(self, x_px=x, y_px=y, width_px=width, height_px=height)

    def scene_binning_factor(self, traits: CameraTraits) -> int | None:
        """Return this mode's binning divided by the scene's own; None where that is not whole."""
        return self.binning // traits.binning if self.binning % traits.binning == 0 else None

    def crop(self, pixels: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint16]:
        """Return this mode's sub-frame of a whole-sensor frame that has this mode's binning."""
        top, left = self.y_px // self.binning, self.x_px // self.binning
        bottom = top + self.height_px // self.binning
        right = left + self.width_px // self.binning
        return pixels[top:bottom, left:right]

    def cards(self, traits: CameraTraits) -> dict[str, Card]:
        """Return this mode's FITS cards: pixel size, binning, and for a sub-frame its origin."""
        pixel_um = traits.pixel_um / traits.binning * self.binning
        found: dict[str, Card] = {
            "XPIXSZ": pixel_um,
            "YPIXSZ": pixel_um,
            "XBINNING": self.binning,
            "YBINNING": self.binning,
        }
        if replace(self, binning=traits.binning) != ReadOutMode.of_whole_sensor(traits):
            found |= {"XORGSUBF": self.x_px // self.binning, "YORGSUBF": self.y_px // self.binning}
        return found


class ReadOutVectors:
    """INDI's CCD_BINNING and CCD_FRAME, and the read-out mode that clients set with them."""

    def __init__(self, traits: CameraTraits, *, can_bin: bool) -> None:
        """``can_bin``: True where the scene can be drawn with another binning."""
        self._traits, self._can_bin = traits, can_bin
        self.mode = ReadOutMode.of_whole_sensor(traits)
        self.binning: NumberVector = number_vector(
            "CCD_BINNING", _GROUP, self._of_binning(), perm="rw" if can_bin else "ro"
        )
        self.frame: NumberVector = number_vector("CCD_FRAME", _GROUP, self._of_frame(), perm="rw")

    def set_binning(self, asked: Mapping[str, float]) -> bool:
        """Set the binning from CCD_BINNING's members; False where the camera refuses it."""
        mode = self.mode.with_binning(asked.get("HOR_BIN", 0.0), asked.get("VER_BIN", 0.0))
        if mode is None or not self._can_bin or mode.scene_binning_factor(self._traits) is None:
            return False
        self._take(mode)
        return True

    def set_frame(self, asked: Mapping[str, float]) -> bool:
        """Set the sub-frame from CCD_FRAME's members; False where the camera refuses it."""
        mode = self.mode.with_sub_frame({**self._of_frame(), **asked}, self._traits)
        if mode is None:
            return False
        self._take(mode)
        return True

    def _take(self, mode: ReadOutMode) -> None:
        self.mode = mode
        for vector, values in ((self.binning, self._of_binning()), (self.frame, self._of_frame())):
            for name, value in values.items():
                vector[name] = repr(value)

    def _of_binning(self) -> dict[str, float]:
        return dict.fromkeys(("HOR_BIN", "VER_BIN"), float(self.mode.binning))

    def _of_frame(self) -> dict[str, float]:
        mode = self.mode
        sides = (mode.x_px, mode.y_px, mode.width_px, mode.height_px)
        return dict(zip(("X", "Y", "WIDTH", "HEIGHT"), map(float, sides), strict=True))
