"""Records of a frame: its pixels and mode, its detections, its plate solution."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from rsoconsole.records.reasons import BelowTau, NotAStreak

FloatArray = npt.NDArray[np.float64]

PixelArray = npt.NDArray[np.uint16] | npt.NDArray[np.float32]

MapMode = Literal["fast", "paper"]

UNITS_KEY = "COMMENT UNITS"
"""Key in a frame's header for the units in brackets in comments, by keyword (FITS 4.0, 4.3.2)."""

StreakKind = Literal["streak", "clipped", "crossing"]
"""Kind of streak: both ends in the frame, one end, neither."""

ObjectClass = Literal["satellite", "aircraft", "meteor", "cosmic ray", "star chain", "undetermined"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Place of the telescope (WGS84)."""

    latitude_deg: float
    longitude_deg: float
    """Longitude, east positive, -180 to 180 deg."""
    elevation_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMode:
    """How a frame was read out; None for what its header does not state."""

    binning: str | None = None
    """Binning, as ``2x2``."""
    x0_px: int | None = None
    """First column of the sensor that was read, px."""
    y0_px: int | None = None
    gain: float | None = None
    """Gain, in the units of the camera's own setting."""
    time_by: Literal["header", "gps"] = "header"
    """Source of the exposure's time: the header's DATE-OBS, or the camera's GPS receiver."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One exposure: the pixels as the camera gave them, and what its header states."""

    frame_id: int
    name: str
    pixels: PixelArray
    """Pixels, (height, width), uint16 or float32 ADU; every value finite."""
    t_start_utc_ns: int | None = None
    exposure_s: float | None = None
    scale_arcsec_px: float | None = None
    """Scale from focal length and pixel size, arcsec/px; a hint for the solver."""
    pointing_ra_icrs_deg: float | None = None
    """Right ascension of the mount's reported pointing: a hint, never a measurement."""
    pointing_dec_icrs_deg: float | None = None
    saturation_adu: float = 65535.0
    camera: CameraMode | None = None
    """Read-out of the frame; None where there was no header."""
    header: Mapping[str, Any] = field(default_factory=dict)

    @property
    def t_mid_utc_ns(self) -> int | None:
        """Mid-exposure, UTC ns; None when start or exposure time is unknown."""
        return middle_utc_ns(self.t_start_utc_ns, self.exposure_s)

    @property
    def width_px(self) -> int:
        """Number of columns."""
        return int(self.pixels.shape[1])

    @property
    def height_px(self) -> int:
        """Number of rows."""
        return int(self.pixels.shape[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """One streak, or one candidate for a streak, in one frame."""

    frame_id: int
    confidence: float
    """Probability that the candidate is a real streak of the sky, 0 to 1."""
    x_px: float
    """Column of the streak's midpoint; of the middle of its box where ``method`` is "box"."""
    y_px: float
    x_a_px: float
    """Column of end a; a and b say nothing about which end came first in time."""
    y_a_px: float
    x_b_px: float
    y_b_px: float
    box_px: tuple[float, float, float, float]
    """Network's box around the streak: x0, y0, x1, y1."""
    length_px: float
    width_px: float
    """Full width at half maximum across the streak, px; 0 when not measured."""
    snr: float
    """Integrated SNR of the whole streak (matched filter); 0 when not measured."""
    sigma_along_px: float
    """One sigma of the midpoint along the streak, px."""
    sigma_across_px: float
    is_clipped: bool
    """True when an end lies outside the frame: the position along the streak is then unknown."""
    method: Literal["line", "box", "operator"]
    unevenness: float = 0.0
    """Excess ln variance of light and path; 0: none, too long for a cosmic ray, or not measured."""
    kind: StreakKind = "streak"
    """Kind of streak; never "streak" where ``is_clipped``: "clipped" stands in for it."""
    sigma_angle_deg: float | None = None
    """One sigma of direction, deg, all but independent of ``sigma_across_px``; None: unmeasured."""
    object_class: ObjectClass = "undetermined"
    class_probability: float = 1.0
    """Probability of its class if a real streak; of "undetermined", 1 minus the likeliest's."""
    modulation_period_px: float | None = None
    """Period of regularly varying light along the streak, px; None where none is seen."""
    modulation_period_s: float | None = None
    """Period of regularly varying light, s; None: none, or exposed share of its length unknown."""
    modulation_depth: float | None = None
    """Depth of the variation, 0 to 1: (most - least) / (most + least), blurred by stars' width."""
    train: int = 0
    """Number of parallel streaks of a satellite train, with this streak; 0: no train."""
    light_offset_px: float | None = field(default=None, compare=False)
    """Offset of the middle from the midpoint to end b, px, by ends and light; None: unmeasured."""
    light_sigma_px: float | None = field(default=None, compare=False)
    """One sigma of ``light_offset_px``."""
    light_length_px: float | None = field(default=None, compare=False)
    """Length of the even motion by ends and light together, px; None where not measured."""
    light_length_sigma_px: float | None = field(default=None, compare=False)
    """One sigma of ``light_length_px``."""

    def __post_init__(self) -> None:
        if self.kind == "streak" and self.is_clipped:
            object.__setattr__(self, "kind", "clipped")
        elif self.kind != "streak" and not self.is_clipped:
            object.__setattr__(self, "is_clipped", True)

    @property
    def angle_deg(self) -> float:
        """Direction from end a to end b in the array, from x towards y, modulo 180 deg."""
        dx, dy = self.x_b_px - self.x_a_px, self.y_b_px - self.y_a_px
        return float(np.degrees(np.arctan2(dy, dx)) % 180.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rejection:
    """A candidate that the detector rejected, and why."""

    detection: Detection
    reason: BelowTau | NotAStreak


@dataclass(frozen=True, slots=True, kw_only=True)
class Detections:
    """Result of the detector for one frame: any number of streaks, most confident first."""

    frame_id: int
    width_px: int
    height_px: int
    detections: tuple[Detection, ...]
    rejected: tuple[Rejection, ...] = ()
    star_count: int | None = None
    """Number of stars found in the frame, up to a few hundred; None where not counted."""
    star_fwhm_px: float | None = None
    """Median full width at half maximum of the stars, px; None where not measured."""
    star_flux_adu: float | None = None
    """Median flux of the 20th to 60th brightest stars, ADU; None: too few to compare."""
    background_adu: float | None = None
    """Median sky light of a pixel, ADU, with the offset if no dark was used; None: unmeasured."""
    stage_ms: Mapping[str, float] = field(default_factory=dict)


class ChartStar(NamedTuple):
    """One of a frame's brightest stars, for a chart of its field."""

    x_px: float
    y_px: float
    flux_adu: float
    """Light above the sky, ADU; too small for a saturated star."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Closeup:
    """Place of a close-up in its frame: a part at full resolution, saved as a picture."""

    frame_id: int
    x0_px: int
    """Column of the frame in which the close-up's first column lies."""
    y0_px: int
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Wcs:
    """Gnomonic (TAN) plate model with optional SIP distortion, ICRS, pixels 0-based.

    Maps pixel offsets from the reference pixel through ``cd`` to the tangent plane in degrees.
    Source of the form: Greisen & Calabretta 2002; Shupe et al. 2005 for SIP.
    """

    crpix_x_px: float
    crpix_y_px: float
    crval_ra_deg: float
    crval_dec_deg: float
    cd: tuple[float, float, float, float]
    """Matrix (cd11, cd12, cd21, cd22) from pixel offsets to the tangent plane, deg/px."""
    sip_a: tuple[tuple[int, int, float], ...] = ()
    """SIP terms added to u, px: each (p, q, coefficient) of u^p v^q."""
    sip_b: tuple[tuple[int, int, float], ...] = ()


PlatePath = Literal["full", "refit", "shift"]
"""Way of a plate solution: sky search; last plate fitted to the stars; last plate shifted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """A plate solution: the frame's pixels tied to catalogue stars."""

    frame_id: int
    wcs: Wcs
    ra_icrs_deg: float
    """Right ascension of the image centre, ((width - 1) / 2, (height - 1) / 2)."""
    dec_icrs_deg: float
    scale_arcsec_px: float
    rotation_deg: float
    """Position angle of the array's +y axis, east of north, 0 to 360 deg."""
    is_flipped: bool
    """True when the array, shown in a FITS viewer, is a mirror image of the sky (det cd > 0)."""
    matched: int
    rms_arcsec: float
    """Solve RMS: root mean square residual of the matched stars, per axis, arcsec."""
    path: PlatePath
    ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NotSolved:
    """A frame without a plate solution, and why."""

    frame_id: int
    reason: str
    """Reason in words for people; no program decides by it."""
    ms: float


def middle_utc_ns(t_start_utc_ns: int | None, exposure_s: float | None) -> int | None:
    if t_start_utc_ns is None or exposure_s is None:
        return None
    return t_start_utc_ns + round(exposure_s * 5e8)
