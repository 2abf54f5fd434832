"""What becomes of tracking once STOP has ended a mount's motion."""

from typing import Literal

AfterStop = Literal["track", "stand still"]


def tracking_after_stop(
    after_stop: AfterStop,
    *,
    was_slewing: bool,
    was_parking: bool,
    was_tracking: bool,
    is_parked: bool,
) -> bool | None:
    """Whether tracking is to be on; None: leave it as it is.

    A slew goes where the mount is then to track, so that one that was cut short counts as
    tracking, though drivers say "not tracking" meanwhile. The way to the park position does not.
    """
    if is_parked:
        return None
    if after_stop == "stand still":
        return False
    if was_parking:
        return None
    return True if was_slewing or was_tracking else None
