"""For which cameras the detector's confidence was measured, and beyond which it cannot say much."""

CALIBRATED_ARCSEC_PX, USABLE_ARCSEC_PX = (1.0, 10.0), (0.3, 250.0)
EXPOSURE_S = (0.05, 60.0)
SMALLEST_PX, LARGEST_PX = (640, 480), (9576, 6388)
"""Longer and shorter side."""
_ROUNDING = 1e-3


def range_cautions(
    scale_arcsec_px: float | None, exposure_s: float | None, width_px: int, height_px: int
) -> dict[str, str]:
    """What to say of a camera, by what it is about: "scale", "exposure", "size"; None is unknown.

    Empty for a camera of the kind that the confidence was calibrated with.
    """
    text_of = {
        "scale": _scale_words(scale_arcsec_px),
        "exposure": _exposure_words(exposure_s),
        "size": _size_words(width_px, height_px),
    }
    return {about: words for about, words in text_of.items() if words}


def is_usable_scale(scale_arcsec_px: float) -> bool:
    """Whether anything may be expected of the detector at this scale."""
    return _is_within(scale_arcsec_px, USABLE_ARCSEC_PX)


def _scale_words(scale_arcsec_px: float | None) -> str:
    if scale_arcsec_px is None or _is_within(scale_arcsec_px, CALIBRATED_ARCSEC_PX):
        return ""
    low, high = CALIBRATED_ARCSEC_PX
    here = f"{scale_arcsec_px:.3g} arcsec/px"
    if is_usable_scale(scale_arcsec_px):
        return (
            f"{here}: confidence is calibrated for {low:g} to {high:g}; take it as an order of"
            " rank, not as a probability"
        )
    low, high = USABLE_ARCSEC_PX
    return f"{here} is outside the {low:g} to {high:g} that can be used: do not rely on detections"


def _exposure_words(exposure_s: float | None) -> str:
    if exposure_s is None or _is_within(exposure_s, EXPOSURE_S):
        return ""
    low, high = EXPOSURE_S
    return (
        f"exposure {exposure_s:.3g} s: made for {low:g} to {high:g} s; confidence is not calibrated"
    )


def _size_words(width_px: int, height_px: int) -> str:
    longer, shorter = max(width_px, height_px), min(width_px, height_px)
    if longer > LARGEST_PX[0] or shorter > LARGEST_PX[1]:
        return (
            f"{width_px} x {height_px} px is larger than the {LARGEST_PX[0]} x {LARGEST_PX[1]}"
            " that was tested: memory may not suffice"
        )
    if longer < SMALLEST_PX[0] or shorter < SMALLEST_PX[1]:
        return (
            f"{width_px} x {height_px} px is smaller than {SMALLEST_PX[0]} x {SMALLEST_PX[1]}:"
            " confidence is not calibrated"
        )
    return ""


def _is_within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] * (1.0 - _ROUNDING) <= value <= bounds[1] * (1.0 + _ROUNDING)
