"""How a frame shows a point: the width of its stars, and the trail to which drift draws them."""

import math
from dataclasses import dataclass, replace

from rsoconsole.vision.stars.psf_field import PsfField

_WIDTH_OF_A_BAND = 0.9
"""Full width at half maximum of a Gaussian fitted to a band, over the band's width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointImage:
    """Image of a point in a frame: width and trail, in working-frame pixels."""

    fwhm_px: float
    """Width of the stars: their median, or at the place given to ``at``."""
    joined: int = 1
    """Side of the squares of camera pixels that were joined to one; 1: none."""
    trail_px: float = 0.0
    """Length to which drift has drawn the stars out, px; 0: they are points."""
    trail_deg: float = 0.0
    """Direction of the trail, deg, x towards y."""
    is_guessed: bool = False
    """True where no star shows the width."""
    psf_field: PsfField | None = None
    """Change of the stars' width over the frame; None where it does not change."""

    def at(self, x_px: float, y_px: float) -> "PointImage":
        """Return the point image at one place, with the stars' width there."""
        if self.psf_field is None:
            return self
        return replace(self, fwhm_px=self.psf_field.at(x_px, y_px), psf_field=None)

    def widest_streak_px(self, angle_deg: float) -> float:
        """Return the largest width of a streak of this direction, px.

        Drift of the mount and the satellite's motion add up to one straight line, as wide as a
        star. Blur of the whole image, like shaking in one direction, widens the line across.
        """
        if self.trail_px == 0.0:
            return self.fwhm_px
        sideways = abs(math.sin(math.radians(angle_deg - self.trail_deg)))
        return math.hypot(self.fwhm_px, _WIDTH_OF_A_BAND * self.trail_px * sideways)
