"""Glints of the tracks as they happen: an event in the log for each."""

from collections.abc import Iterable

from rsoconsole.night import NightFrames, glints_of, light_curve_of, tracks_of
from rsoconsole.records import Event, Record
from rsoconsole.words import glint_words, utc_text

FRAMES_KEPT = 12
"""Number of frames whose light is the rest that a glint stands out of."""


class GlintWatch:
    """Keeps the light of the last frames, and finds glints in the newest one."""

    def __init__(self) -> None:
        """Start without frames."""
        self._frames = NightFrames(newest=FRAMES_KEPT)

    def glint_events(self, records: Iterable[Record]) -> tuple[Event, ...]:
        """Return an event for each glint in a frame; ``records``: all of the frame, in order."""
        frame_id = 0
        for record in records:
            frame_id = getattr(record, "frame_id", None) or frame_id
            self._frames.fold_record(record)
        frames = tuple(self._frames.kept_frames())
        if not frames or frames[-1].photometry is None or not frames[-1].photometry.streaks:
            return ()
        events: list[Event] = []
        for number, track in tracks_of(frames).items():
            curve = light_curve_of(frames, track)
            for glint in () if curve is None else glints_of(curve):
                if glint.frame_id != frame_id:
                    continue
                words = glint_words(
                    glint.height_mag, glint.duration_s, is_within_frame=glint.is_within_frame
                )
                at = utc_text(glint.t_utc_ns)
                text = f"track {number} glinted at {at}: {words}"
                events.append(Event(level="info", text=text, frame_id=frame_id))
        return tuple(events)
