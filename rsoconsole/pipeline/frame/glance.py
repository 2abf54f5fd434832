"""A look at the middle of a frame, before all of it is examined: streaks and plate, no record.

The telescope was sent where a satellite would be, so its streak lies about the frame's middle. A
part of the frame is searched in a part of the time; the whole is examined afterwards, as ever.
"""

from dataclasses import dataclass

from rsoconsole.records import Detections, Solution


@dataclass(frozen=True, slots=True, kw_only=True)
class Glance:
    """What the middle of a frame shows, in the whole frame's pixels."""

    detections: Detections
    solution: Solution
