"""A measured candidate: what was found, and all else that its confidence depends on."""

import math
from dataclasses import dataclass, replace

from rsoconsole.records import Detection
from rsoconsole.vision.stars import PsfField

SHARP_PX = 3.2
"""Width of a star that neither wind nor the mount has widened: a streak may be as narrow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineLight:
    """How the light of a candidate lies along it (``streak_trace``)."""

    lower_quartile_snr: float
    """What the lower quartile of its parts says of the whole: sigma, were all parts like it."""
    roughness: float
    """Scatter of its parts over their mean that neither a slow change nor one period explains."""
    confusion: float = 1.0
    """Scatter of the sky beside it over its pixels' noise."""
    bend: float = 0.0
    lumpiness: float = 0.0
    """How much more than noise explains its path and its light vary, of a short one
    (``streak_evenness``)."""

    over_points: float = 0.0
    """Chi-square that one line explains better than a few stars in a row, of its profile
    (``line_or_points``)."""
    over_stars: float = 0.0
    """The same of its pixels, held against images of the frame's stars (``line_or_stars``)."""
    left: float = 0.0
    """Chi-square of a pixel that the line leaves; 0: it was not held against any."""

    @property
    def unevenness(self) -> float:
        """The larger of the two."""
        return max(self.bend, self.lumpiness)


UNMEASURED = LineLight(lower_quartile_snr=0.0, roughness=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One line of light."""

    found: Detection
    """With the network's confidence, then with its calibrated one."""
    light: LineLight


@dataclass(frozen=True, slots=True, kw_only=True)
class Focus:
    """How the frame shows a point, in the pixels in which it was searched."""

    fwhm_px: float
    """Of the stars: their median, or at the place that ``at`` was asked for."""
    joined: int = 1
    """Pixels of the camera along one of these: stars were so wide."""
    trail_px: float = 0.0
    """What drift has drawn the stars out to."""
    trail_deg: float = 0.0
    """Its direction, x towards y."""
    psf_field: PsfField | None = None
    """How the stars' width changes over the frame; None where it does not."""

    def at(self, x_px: float, y_px: float) -> "Focus":
        """The same about one place, with the stars' width there; itself where nothing changes."""
        if self.psf_field is None:
            return self
        return replace(self, fwhm_px=self.psf_field.at(x_px, y_px), psf_field=None)

    def widest_px(self, angle_deg: float) -> float:
        """How wide a streak of this direction may be.

        A satellite's path and a drift of the mount add up to one straight line, as wide as a star;
        what blurs the whole image, like shaking in one direction, draws the line out sideways.
        """
        if self.trail_px == 0.0:
            return self.fwhm_px
        sideways = abs(math.sin(math.radians(angle_deg - self.trail_deg)))
        return math.hypot(self.fwhm_px, _WIDTH_OF_A_BAND * self.trail_px * sideways)


_WIDTH_OF_A_BAND = 0.9
"""Full width at half maximum of a band between its edges, over theirs, as a Gaussian fits it."""
