"""Brightness of the last frame and of what is followed, for the status."""

from rsoconsole.records import Photometry, StreakLight
from rsoconsole.tracking import Following


class FrameLights:
    """Holds the last frame's photometry, and the light of each track's last measurement.

    Written by the loop, read by any thread: what is read is replaced as a whole.
    """

    def __init__(self) -> None:
        self._lights: dict[str, StreakLight] = {}
        self.last: Photometry | None = None
        """The last frame's photometry; None before the first one."""

    def note(self, record: Photometry, following: Following) -> None:
        """Note a frame's photometry; lights of measurements that no track has taken last go.

        ``following``: the tracks after that frame.
        """
        taken = {each.taken.measurement_id for each in following.tracks if each.taken is not None}
        known = [*self._lights.values(), *record.streaks]
        self._lights = {each.measurement_id: each for each in known if each.measurement_id in taken}
        self.last = record

    def light_of(self, measurement_id: str) -> StreakLight | None:
        """Return the light of a track's last measurement; None where it is not known."""
        return self._lights.get(measurement_id)
