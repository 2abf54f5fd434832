"""Brightness of a frame's streaks, by detection."""

from rsoconsole.night.frame import NightFrame, is_measurement_of
from rsoconsole.records import Detection, StreakLight, measurement_id_of


def light_of_streak(frame: NightFrame, streak: Detection) -> StreakLight | None:
    """Return the brightness of one of a frame's candidates; None where it is not on record.

    A candidate without a measurement, as in a frame without a plate, is known by its number.
    """
    measured = (m for m in frame.all_measurements if is_measurement_of(streak, m))
    lights = (frame.light_of(m.measurement_id) for m in measured)
    found = next((light for light in lights if light is not None), None)
    if found is not None or frame.detections is None:
        return found
    rejected = (each.detection for each in frame.detections.rejected)
    candidates = (*frame.detections.detections, *rejected)
    number = next((n for n, each in enumerate(candidates) if each is streak), None)
    return None if number is None else frame.light_of(measurement_id_of(frame.frame_id, number))
