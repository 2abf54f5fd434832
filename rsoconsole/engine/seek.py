"""Looking again for what was followed, where it must be by now: the operator's wish."""

from typing import TYPE_CHECKING

from rsoconsole.engine.states import Sought
from rsoconsole.pipeline.absence import direction_at

if TYPE_CHECKING:
    from rsoconsole.engine.loop import Engine


def check_seek(engine: "Engine") -> tuple[float, float]:
    """Where what was followed must be now, ICRS.

    Raises ValueError where it cannot be looked for.
    """
    track = engine.last_track
    if track is None:
        raise ValueError("nothing has been followed this night that could be looked for")
    if not engine.charge.is_autonomous:
        raise ValueError("autonomy does not have the mount: arm or resume first")
    if engine.charge.is_held:
        raise ValueError("the mount is held: resume first")
    now_ns = engine.hands.now_utc_ns()
    # A line on the sky leads astray within the hour, an orbit does not.
    direction = engine.guide.of_last(now_ns) or direction_at(track, now_ns)
    refused = engine.slews.refuse_direction(direction, now_ns)
    if refused is not None:
        raise ValueError(f"it cannot be looked for where it must be: {refused}")
    return direction


def seek(engine: "Engine", by: str) -> str:
    """Search in a widening spiral round where it must be. Raises ValueError as ``check_seek``."""
    direction = check_seek(engine)
    engine.happen(Sought(by=by))
    engine.planner.search_about(direction, engine.hands.now_utc_ns())
    return "looking for it in a widening spiral"
