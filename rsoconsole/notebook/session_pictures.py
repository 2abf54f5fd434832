"""A session's frames as pictures, pixels and streaks."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.errors import SessionError, said_as
from rsoconsole.night import Logged, NightFrame, NightFrames, tracks_of
from rsoconsole.notebook.night import overlay_svg, words_of
from rsoconsole.notebook.pictures import Picture, TrackStreak, draw_streak, draw_tracks
from rsoconsole.records import PixelArray
from rsoconsole.session.files import pruned_on, read_notes
from rsoconsole.session.reading import SessionReader
from rsoconsole.words import parts_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class SessionPictures:
    """What a session shows of single frames."""

    _reader: SessionReader
    _log: list[Logged]
    _frames: NightFrames

    @property
    def path(self) -> Path:
        """Its folder."""
        return self._reader.folder

    def picture(self, frame_id: int | None = None) -> Picture:
        """A frame's small picture with what was found in it; without a number the newest one.

        Raises SessionError where the session has none of it.
        """
        numbers = (frame_id,) if frame_id is not None else self._newest_frames()
        for number in numbers:
            path = self._reader.preview_path(number)
            if path is not None:
                return self._picture(number, path)
        which = "any frame" if frame_id is None else f"frame {frame_id}"
        raise SessionError(f"{self.path} holds no picture of {which}")

    def pixels(self, frame_id: int) -> PixelArray:
        """All pixels of a frame that was kept, (height, width) ADU, exactly as measured in.

        Raises SessionError where it was not kept, and says which were; FrameError where its file
        cannot be read.
        """
        from rsoconsole.instruments.frames import read_frame

        path = self._reader.frame_path(frame_id)
        if path is None:
            why = self._reader.not_kept_because(frame_id)
            raise SessionError(
                f"the pixels of frame {frame_id} were not kept{f': {why}' if why else ''};"
                f" {self._kept_words()}"
            )
        return read_frame(path, frame_id).pixels

    def plot_streak(self, frame_id: int, figure: Any = None) -> "Figure":
        """The most confident streak of a kept frame, pixel by pixel, and the light along it.

        Raises SessionError where the frame was not kept or nothing was detected in it.
        """
        from rsoconsole.notebook.figures import NightFigure, styled

        found = self._frame(frame_id).found
        if not found:
            raise SessionError(f"nothing was detected in frame {frame_id}")
        pixels, detection = self.pixels(frame_id), found[0]
        parts = (f"confidence {detection.confidence:.2f}", *parts_of(detection))
        title = f"Frame {frame_id}: {', '.join(parts)}"
        figure = NightFigure(6.6, 5.0) if figure is None else figure
        with styled():
            draw_streak(figure, pixels, detection, title)
        return figure  # type: ignore[no-any-return]

    def plot_tracks(self, frame_id: int, figure: Any = None) -> "Figure":
        """The streaks of all tracks in one kept frame, each with its track's number and confidence.

        Raises SessionError where the frame was not kept or no track took anything of it.
        """
        from rsoconsole.notebook.figures import NightFigure, styled

        frame, streaks = self._frame(frame_id), []
        for track in tracks_of(self._frames.seen()).values():
            for state in track.states:
                taken = state.measurement_id if state.frame_id == frame_id else None
                measured = next((m for m in track.measurements if m.measurement_id == taken), None)
                streak = None if measured is None else frame.streak_of(measured)
                if streak is not None:
                    streaks.append(TrackStreak(track.number, state.is_lead, streak))
        if not streaks:
            raise SessionError(f"no track took a streak of frame {frame_id}")
        pixels = self.pixels(frame_id)
        figure = NightFigure(6.6, 4.4) if figure is None else figure
        with styled():
            draw_tracks(figure, pixels, streaks, f"Frame {frame_id}")
        return figure  # type: ignore[no-any-return]

    def _picture(self, frame_id: int, path: Path) -> Picture:
        with said_as(SessionError, f"{path} cannot be read: "):
            png = path.read_bytes()
        frame = self._frame(frame_id)
        return Picture(
            frame_id=frame_id,
            path=path,
            png=png,
            overlay=overlay_svg(frame),
            words=words_of(frame),
        )

    def _frame(self, frame_id: int) -> NightFrame:
        return next(
            (each for each in self._frames.seen() if each.frame_id == frame_id), NightFrame()
        )

    def _newest_frames(self) -> list[int]:
        reduced = [each.frame_id for each in self._frames.seen() if each.detections is not None]
        return reduced[::-1]

    def _kept(self) -> list[int]:
        """Frames whose pixels are there: written, and not pruned since."""
        pruned = pruned_on(read_notes(self.path))
        rows = self._reader.view("frames")
        return [row["frame_id"] for row in rows if row["file"] and row["file"] not in pruned]

    def _kept_words(self) -> str:
        kept = self._kept()
        return f"kept: {', '.join(map(str, kept))}" if kept else "none was kept"
