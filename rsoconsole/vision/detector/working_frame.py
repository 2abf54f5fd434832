"""The frame as the detector works on it: pixels joined where the stars are wide.

The search for streaks and their measurement expect stars a few pixels wide. Out of focus, in wind,
in poor seeing, or where pixels are finer than the seeing, pixels are joined until the stars are
that narrow. Nothing is lost, since no detail is finer than a star.
"""

from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import Detection, Frame, Rejection
from rsoconsole.vision.stars.star_list import StarList

WIDE_PX = 5.0
"""Width of the stars, px, from which pixels are joined."""
_WANTED_PX = 4.0
"""Width of the stars to join towards, px: narrower, a short streak out of focus would be a blob."""
_SMALLEST_PX = 96
"""Least side of a working frame, px."""


def joined_square_side_px(stars: StarList, frame: Frame) -> int:
    """Return the side of the squares of pixels to join into one, px; 1: none are joined."""
    if stars.median_fwhm_px < WIDE_PX:
        return 1
    most = min(frame.width_px, frame.height_px) // _SMALLEST_PX
    return max(1, min(max(2, round(stars.median_fwhm_px / _WANTED_PX)), most))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkingFrame:
    """Frame with squares of pixels joined, and conversions back to the original frame."""

    frame: Frame
    side: int
    """Side of the squares of original pixels that are joined to one."""

    @classmethod
    def of(cls, frame: Frame, side: int) -> "WorkingFrame":
        """Join squares of ``side`` x ``side`` pixels of a frame to their mean.

        Rows and columns that do not fill a square are left out.
        """
        if side == 1:
            return cls(frame=frame, side=1)
        import cv2

        height, width = frame.pixels.shape
        whole = frame.pixels[: height // side * side, : width // side * side]
        joined = cv2.resize(
            whole.astype(np.float32), (width // side, height // side), interpolation=cv2.INTER_AREA
        )
        scale = frame.scale_arcsec_px
        return cls(
            frame=replace(
                frame, pixels=joined, scale_arcsec_px=scale * side if scale is not None else None
            ),
            side=side,
        )

    def to_original_px(self, place: float) -> float:
        """Convert a column or row of this frame to one of the original frame."""
        return (place + 0.5) * self.side - 0.5

    def original_detection(self, found: Detection) -> Detection:
        """Return a detection with its pixels converted to the original frame."""
        return detection_in_original_pixels(found, self.side)

    def original_rejection(self, rejected: Rejection) -> Rejection:
        """Return a rejection with its pixels converted to the original frame."""
        return replace(rejected, detection=self.original_detection(rejected.detection))

    def original_stars(self, stars: StarList) -> StarList:
        """Return stars with pixels and light converted to the original frame."""
        if self.side == 1:
            return stars
        trail, field, lights = stars.trail, stars.psf_field, stars.oblong
        if trail is not None:
            trail = replace(
                trail, length_px=trail.length_px * self.side, fwhm_px=trail.fwhm_px * self.side
            )
        if lights is not None:
            lights = replace(
                lights,
                x_px=(lights.x_px + 0.5) * self.side - 0.5,
                y_px=(lights.y_px + 0.5) * self.side - 0.5,
                half_px=lights.half_px * self.side,
            )
        return replace(
            stars,
            x_px=(stars.x_px + 0.5) * self.side - 0.5,
            y_px=(stars.y_px + 0.5) * self.side - 0.5,
            flux=stars.flux * self.side**2,
            fwhm_px=stars.fwhm_px * self.side,
            median_fwhm_px=stars.median_fwhm_px * self.side,
            trail=trail,
            psf_field=None if field is None else field.in_binned_pixels(1.0 / self.side),
            oblong=lights,
        )


def detection_in_original_pixels(found: Detection, side: int) -> Detection:
    """Convert a detection from joined pixels (``side`` x ``side``) to original ones."""
    if side == 1:
        return found

    def px(place: float) -> float:
        return (place + 0.5) * side - 0.5

    def size(of: float | None) -> float | None:
        return None if of is None else of * side

    x0, y0, x1, y1 = (px(each) for each in found.box_px)
    return replace(
        found,
        x_px=px(found.x_px),
        y_px=px(found.y_px),
        x_a_px=px(found.x_a_px),
        y_a_px=px(found.y_a_px),
        x_b_px=px(found.x_b_px),
        y_b_px=px(found.y_b_px),
        box_px=(x0, y0, x1, y1),
        length_px=found.length_px * side,
        width_px=found.width_px * side,
        sigma_along_px=found.sigma_along_px * side,
        sigma_across_px=found.sigma_across_px * side,
        light_offset_px=size(found.light_offset_px),
        light_sigma_px=size(found.light_sigma_px),
        light_length_px=size(found.light_length_px),
        light_length_sigma_px=size(found.light_length_sigma_px),
    )
