"""A part of a frame about its centre: its pixels, stars, streaks and plate. Pure."""

from dataclasses import dataclass, replace

from rsoconsole.records import Detection, Detections, Frame, Wcs

LEAST_PART_PX = 1_100
"""A side, at least: fewer pixels have too few catalogue stars for the plate."""
LEAST_SHARE = 0.25
"""Likewise, of the frame's short side."""
MOST_SHARE = 0.7
"""Of the frame's pixels: a larger part is no faster than the whole."""
_GRID_PX = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Some rows and columns of a frame."""

    x0_px: int
    y0_px: int
    size_px: tuple[int, int]
    """Width and height."""

    def cut(self, frame: Frame) -> Frame:
        """The frame's part; its pixels are the frame's own."""
        width_px, height_px = self.size_px
        rows = slice(self.y0_px, self.y0_px + height_px)
        columns = slice(self.x0_px, self.x0_px + width_px)
        return replace(frame, pixels=frame.pixels[rows, columns])

    def of_part(self, plate: Wcs) -> Wcs:
        """The frame's plate in the part's pixels."""
        return self._shifted(plate, -1)

    def of_frame(self, plate: Wcs) -> Wcs:
        """The part's plate in the frame's pixels."""
        return self._shifted(plate, 1)

    def _shifted(self, plate: Wcs, sign: int) -> Wcs:
        return replace(
            plate,
            crpix_x_px=plate.crpix_x_px + sign * self.x0_px,
            crpix_y_px=plate.crpix_y_px + sign * self.y0_px,
        )

    def streaks_of_frame(self, found: Detections, frame: Frame) -> Detections:
        """Streaks that lie wholly in the part, where they are in the whole frame."""
        whole = tuple(self.moved(each) for each in found.detections if not each.is_clipped)
        return replace(
            found,
            width_px=frame.width_px,
            height_px=frame.height_px,
            detections=whole,
            rejected=(),
        )

    def moved(self, each: Detection) -> Detection:
        """The part's streak in the frame's pixels."""
        x, y = self.x0_px, self.y0_px
        left, top, right, bottom = each.box_px
        return replace(
            each,
            x_px=each.x_px + x,
            y_px=each.y_px + y,
            x_a_px=each.x_a_px + x,
            y_a_px=each.y_a_px + y,
            x_b_px=each.x_b_px + x,
            y_b_px=each.y_b_px + y,
            box_px=(left + x, top + y, right + x, bottom + y),
        )


def middle_of(frame: Frame, reach_px: float) -> Part | None:
    """So far about the centre; None where that is most of the frame."""
    least_px = max(LEAST_PART_PX / 2.0, LEAST_SHARE * min(frame.width_px, frame.height_px))
    half_px = max(reach_px, least_px)
    sides = [
        min(2 * int(half_px) // _GRID_PX * _GRID_PX, side)
        for side in (frame.width_px, frame.height_px)
    ]
    if sides[0] * sides[1] > MOST_SHARE * frame.width_px * frame.height_px:
        return None
    return Part(
        x0_px=(frame.width_px - sides[0]) // 2,
        y0_px=(frame.height_px - sides[1]) // 2,
        size_px=(sides[0], sides[1]),
    )


def part_between(before: Frame, frame: Frame) -> Part | None:
    """A frame as a part of the one before, where both are of one sensor, joined alike.

    Where it is the larger one, its corner lies outside. None where the headers do not tell.
    """
    one, other = before.camera, frame.camera
    if one is None or other is None or one.binning is None or one.binning != other.binning:
        return None
    smaller = one if before.width_px < frame.width_px else other
    if smaller.x0_px is None or smaller.y0_px is None:
        return None
    return Part(
        x0_px=(other.x0_px or 0) - (one.x0_px or 0),
        y0_px=(other.y0_px or 0) - (one.y0_px or 0),
        size_px=(frame.width_px, frame.height_px),
    )
