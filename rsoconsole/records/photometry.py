"""Brightness of a frame's streaks: flux, magnitude and its error, and the frame's zero point.

Magnitudes are of a light that shines for the whole exposure: a streak's light is divided by the
time in which it passed through the frame. ``mag_sigma`` has the noise of the pixels and the error
of the zero point; what the unknown colour of the object adds is ``mag_sigma_colour``, apart,
because it is the same in all frames of one object.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

Band: TypeAlias = Literal["V", "instrumental"]
"""Band of magnitudes.

V: Tycho-2's VT at the Sun's colour, which is 0.07 mag fainter than Johnson's V; instrumental: 0 mag
is 1 ADU a second.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightStep:
    """Light of one short step along a streak, about as long as the image of a star is wide."""

    t_s: float
    """Middle of the step after mid-exposure, s, if end a came first; negative: before it."""
    rate_adu_s: float
    """Light, ADU a second; noise makes it negative where there is none."""
    rate_sigma_adu_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakLight:
    """Brightness of one streak."""

    measurement_id: str
    """The measurement with the same light: see ``measurement_id_of``."""
    flux_adu: float
    """Light of the whole streak above sky and stars, ADU."""
    flux_sigma_adu: float
    rate_adu_s: float
    """Flux by the time in which the object was in the frame, ADU a second."""
    rate_sigma_adu_s: float
    band: Band
    mag: float | None = None
    """Apparent magnitude in ``band``; None where no light is left above noise."""
    mag_sigma: float | None = None
    """One sigma of ``mag`` by noise and zero point, without the object's unknown colour."""
    mag_sigma_colour: float | None = None
    """One sigma by the object's unknown colour; None where no band is known."""
    is_saturated: bool = False
    """True where pixels of the streak are saturated: it is brighter than measured."""
    is_blended: bool = False
    """True where stars on it had more than a tenth of its light; its error is larger for it."""
    steps: tuple[LightStep, ...] = ()
    """Light along the streak from end a to end b; () where it is too short or too faint."""

    @property
    def sigma_mag(self) -> float | None:
        """One sigma of ``mag`` with everything in it."""
        if self.mag_sigma is None:
            return None
        return math.hypot(self.mag_sigma, self.mag_sigma_colour or 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Photometry:
    """Brightness of all streaks of a frame that have a measurement, or a detection."""

    frame_id: int
    streaks: tuple[StreakLight, ...] = ()
    zero_point_mag: float | None = None
    """Magnitude that gives 1 ADU a second, at the Sun's colour; None: no plate, too few stars."""
    zero_point_sigma_mag: float | None = None
    zero_point_stars: int = 0
    """Number of catalogue stars from which the zero point comes."""
    zero_point_scatter_mag: float | None = None
    """Scatter of those stars about it: cloud that changes over the field makes it large."""
    colour_term: float | None = None
    """Change of the zero point per magnitude of a star's BT - VT."""
    colour_term_sigma: float | None = None
    limiting_mag: float | None = None
    """Magnitude of a star with an SNR of 5 in this frame; None without a zero point."""
