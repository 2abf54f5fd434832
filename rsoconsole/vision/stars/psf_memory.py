"""Width of the stars in the last frame that showed enough of them, for later frames.

Under cloud, in a narrow field or a short exposure a frame does not show how wide a star is; the
frames just before it do. Seeing and focus last for a while as an angle on the sky: the width is
used for frames of the same field of view, whatever their binning; a frame of unknown scale uses
only the width of a frame of the same shape.
"""

from dataclasses import dataclass

from rsoconsole.records import Frame
from rsoconsole.vision.stars.psf_field import Psf
from rsoconsole.vision.stars.star_list import StarList

HOLDS_NS = 30 * 60 * 10**9
"""Longest time between mid-exposures over which a width holds."""
MIN_STARS_KEPT = 12
"""Fewest stars whose width is remembered: with fewer it may not be the width of stars."""
_SAME_VIEW = 0.01
"""Relative difference of fields of view up to which a camera's binning explains it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    """Width of a star in one frame, with the field of view and shape of that frame."""

    psf: Psf
    t_mid_utc_ns: int
    width_px: int
    height_px: int
    scale_arcsec_px: float | None

    def pixels_along(self, frame: Frame) -> float | None:
        """Pixels of this frame along one of another frame's; None: the fields of view differ."""
        if self.scale_arcsec_px is None or frame.scale_arcsec_px is None:
            own = self.width_px, self.height_px, self.scale_arcsec_px
            return 1.0 if own == (frame.width_px, frame.height_px, frame.scale_arcsec_px) else None
        ratio = frame.scale_arcsec_px / self.scale_arcsec_px
        pairs = (frame.width_px, self.width_px), (frame.height_px, self.height_px)
        is_same = all(abs(ratio * its / own - 1.0) < _SAME_VIEW for its, own in pairs)
        return ratio if is_same else None


class PsfMemory:
    """Width of a star in the last frame of one camera that showed enough stars."""

    def __init__(self) -> None:
        self._last: _Known | None = None

    def remember(self, frame: Frame, stars: StarList) -> None:
        """Remember the width of a frame's stars for later frames.

        Ignored are frames without a time, those with fewer than ``MIN_STARS_KEPT`` stars, and those
        whose stars are trails, since drift and wind last for one frame only.
        """
        is_good = stars.width_source == "measured" and stars.trail is None
        if not is_good or len(stars) < MIN_STARS_KEPT or frame.t_mid_utc_ns is None:
            return
        self._last = _Known(
            psf=Psf(fwhm_px=stars.median_fwhm_px, field=stars.psf_field),
            t_mid_utc_ns=frame.t_mid_utc_ns,
            width_px=frame.width_px,
            height_px=frame.height_px,
            scale_arcsec_px=frame.scale_arcsec_px,
        )

    def recall(self, frame: Frame) -> Psf | None:
        """Return the width of a star to expect in a frame, in that frame's pixels.

        None where the remembered frame has another field of view, is later than this one, or is
        older than ``HOLDS_NS``.
        """
        last = self._last
        if last is None or frame.t_mid_utc_ns is None:
            return None
        if not 0 <= frame.t_mid_utc_ns - last.t_mid_utc_ns <= HOLDS_NS:
            return None
        ratio = last.pixels_along(frame)
        return None if ratio is None else last.psf.in_binned_pixels(ratio)
