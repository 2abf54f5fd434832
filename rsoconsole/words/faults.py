"""Faults and remedies named by more than one package."""

ALIGN = "align the mount with its own tools"
ENGINE_ENDS = "the engine stops the mount and ends"
IN_FAULT = "the engine is in FAULT"
NAME_ELEMENTS = "name a file of element sets"
NO_ANSWER = "the mount does not answer"
NO_EFFECT = "the effect cannot be computed"
NO_PARK = "this mount's driver has no park position"
NOT_SHOWN = "the session cannot be shown"
TAKE_DARK = "give a dark of that exposure"


def no_night_text(twilight_deg: float) -> str:
    """Say that the Sun does not sink to the altitude ``twilight_deg`` within a day."""
    return f"the Sun does not sink to {twilight_deg:+.1f} deg here within a day"


def direction_fault(ra_deg: float, dec_deg: float) -> str:
    """Say that two numbers are no RA and Dec in degrees; empty where they are."""
    if -360.0 <= ra_deg <= 360.0 and abs(dec_deg) <= 90.0:
        return ""
    return f"RA {ra_deg:g}, Dec {dec_deg:g} is no direction in degrees"
