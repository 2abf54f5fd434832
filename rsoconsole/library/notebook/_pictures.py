"""Previews of frames with marks over them, and plots of streaks at full resolution."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rsoconsole.base import SessionError, system_errors_as
from rsoconsole.library.notebook._recorded import RecordedSession
from rsoconsole.library.notebook.night.overlay import frame_caption, overlay_svg
from rsoconsole.library.notebook.night.svg import escape_markup
from rsoconsole.night import NightFrame, tracks_of
from rsoconsole.records import Detection, FloatArray, PixelArray
from rsoconsole.session import pruning_times, read_notes
from rsoconsole.words import streak_detail_words

SHOWN_PX = 560
_ROOM_PX = 60
_FLATTEST = 0.5
"""Smallest ratio of shorter to longer side of a picture with several streaks."""
_MAX_IN_WORDS = 3
"""Most tracks that a picture labels with more than numbers."""
_LOW, _HIGH = -2.0, 10.0
"""Black and white of a cut-out, in units of the noise about the median."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """Preview of a frame, some 466 pixels wide; a notebook displays it with its marks."""

    frame_id: int
    path: Path
    png: bytes
    overlay: str
    """SVG to lay over the preview: boxes about streaks, a cross where the track was expected."""
    words: str

    def _repr_html_(self) -> str:
        return (
            f'<figure style="margin:0;max-width:{SHOWN_PX}px">'
            f"{picture_with_overlay_html(self.png, self.overlay)}"
            f'<figcaption style="font-size:90%">{escape_markup(self.words)}</figcaption></figure>'
        )

    def __repr__(self) -> str:
        return f"<{self.words}: {self.path}>"


def picture_with_overlay_html(png: bytes, overlay: str, alt: str = "") -> str:
    """Return HTML of a picture under its overlay, as wide as the page allows.

    ``overlay``: SVG; ``alt``: alternative text of the picture.
    """
    return (
        '<div style="position:relative;line-height:0">'
        f'<img alt="{escape_markup(alt)}" '
        f'src="data:image/png;base64,{base64.b64encode(png).decode()}" '
        f'style="width:100%;height:auto;margin:0">{overlay}</div>'
    )


def draw_streak(figure: Any, pixels: PixelArray, detection: Detection, title: str) -> None:
    """Draw a streak with its ends and midpoint, and its profile in a lower panel.

    ``pixels``: the whole frame, (height, width) ADU. The profile is the light along the streak, the
    mean over seven pixels across it, in units of the sky's noise.
    """
    x_0 = max(int(min(detection.x_a_px, detection.x_b_px)) - _ROOM_PX, 0)
    y_0 = max(int(min(detection.y_a_px, detection.y_b_px)) - _ROOM_PX, 0)
    x_1 = int(max(detection.x_a_px, detection.x_b_px)) + _ROOM_PX
    y_1 = int(max(detection.y_a_px, detection.y_b_px)) + _ROOM_PX
    upper, lower = figure.subplots(2, 1, height_ratios=(2.2, 1.0))
    sky, noise = _show(upper, pixels, (x_0, x_1), (y_0, y_1), title, interpolation="nearest")
    ends = ((detection.x_a_px, detection.y_a_px), (detection.x_b_px, detection.y_b_px))
    upper.plot(*zip(*ends, strict=True), "|", color="#e5484d", markersize=16, label="ends")
    upper.plot(
        detection.x_px, detection.y_px, "+", color="#4a90e2", markersize=12, label="midpoint"
    )
    upper.legend(loc="upper right", labelcolor="white")
    along_px, light = _profile(pixels, detection)
    lower.plot(along_px, (light - sky) / noise, color="#1e55c8", linewidth=1.0)
    half = detection.length_px / 2.0
    for end in (-half, half):
        lower.axvline(end, color="#e5484d", linewidth=0.9, linestyle=(0, (4, 2.5)))
    lower.set_xlabel("Along the streak, from its midpoint (px)")
    lower.set_ylabel("Light (σ of the sky)")


def _show(
    axes: Any,
    pixels: PixelArray,
    columns: tuple[int, int],
    rows: tuple[int, int],
    title: str,
    *,
    interpolation: str | None = None,
) -> tuple[float, float]:
    """Draw a piece of the frame in units of its noise; return the sky and its noise, ADU."""
    piece = np.asarray(pixels[slice(*rows), slice(*columns)], float)
    sky = float(np.median(piece))
    noise = 1.4826 * float(np.median(np.abs(piece - sky))) or 1.0
    (height, width), x_0, y_0 = piece.shape, columns[0], rows[0]
    axes.imshow(
        (piece - sky) / noise,
        origin="upper",
        cmap="gray",
        vmin=_LOW,
        vmax=_HIGH,
        interpolation=interpolation,
        extent=(x_0 - 0.5, x_0 + width - 0.5, y_0 + height - 0.5, y_0 - 0.5),
    )
    axes.set_title(title, loc="left")
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")
    axes.grid(visible=False)
    return sky, noise


def _widened(low: float, high: float, least: float, most: int) -> tuple[int, int]:
    """Range widened about its middle to ``least`` or more, within 0 and ``most``."""
    more = max(least - (high - low), 0.0) / 2.0
    return max(int(low - more), 0), min(int(high + more) + 1, most)


class TrackStreak(NamedTuple):
    """Streak of a frame, with the number of the track to which it is assigned."""

    number: int
    is_lead: bool
    streak: Detection


def draw_tracks(
    figure: Any, pixels: PixelArray, streaks: Sequence[TrackStreak], title: str
) -> None:
    """Draw the part of a frame that holds these streaks, with track numbers and confidences.

    ``pixels``: the whole frame, (height, width) ADU.
    """
    ends = [(s.x_a_px, s.y_a_px) for *_, s in streaks] + [(s.x_b_px, s.y_b_px) for *_, s in streaks]
    x, y = zip(*ends, strict=True)
    x_0, x_1 = min(x) - _ROOM_PX, max(x) + _ROOM_PX
    y_0, y_1 = min(y) - _ROOM_PX, max(y) + _ROOM_PX
    across, down = _FLATTEST * (y_1 - y_0), _FLATTEST * (x_1 - x_0)
    x_0, x_1 = _widened(x_0, x_1, across, pixels.shape[1])
    y_0, y_1 = _widened(y_0, y_1, down, pixels.shape[0])
    axes = figure.subplots()
    _show(axes, pixels, (x_0, x_1), (y_0, y_1), title)
    for number, is_lead, streak in sorted(streaks, key=lambda each: each.number):
        lead = "*" if is_lead else ""
        axes.plot(
            (streak.x_a_px, streak.x_b_px),
            (streak.y_a_px, streak.y_b_px),
            "|",
            color="#e5484d",
            markersize=14,
        )
        axes.annotate(
            f"track {number}{lead} · confidence {streak.confidence:.2f}"
            if len(streaks) <= _MAX_IN_WORDS
            else f"{number}{lead}",
            (streak.x_px, min(streak.y_a_px, streak.y_b_px)),
            xytext=(0, 9),
            textcoords="offset points",
            ha="center",
            color="#ffd479",
            fontsize=9,
        )


def _profile(pixels: PixelArray, detection: Detection) -> tuple[FloatArray, FloatArray]:
    """Mean light across seven pixels, every pixel along the streak and a little beyond."""
    dx = detection.x_b_px - detection.x_a_px
    dy = detection.y_b_px - detection.y_a_px
    length = float(np.hypot(dx, dy)) or 1.0
    ux, uy = dx / length, dy / length
    reach = length / 2.0 + _ROOM_PX * 0.6
    along = np.arange(-reach, reach + 1.0)
    across = np.arange(-3.0, 4.0)
    x = detection.x_px + along[:, None] * ux - across * uy
    y = detection.y_px + along[:, None] * uy + across * ux
    rows = np.clip(np.rint(y).astype(int), 0, pixels.shape[0] - 1)
    columns = np.clip(np.rint(x).astype(int), 0, pixels.shape[1] - 1)
    return along, np.asarray(pixels[rows, columns], float).mean(axis=1)


if TYPE_CHECKING:
    from matplotlib.figure import Figure


class SessionPictures(RecordedSession):
    """Pictures and pixels of single frames of a session."""

    def picture(self, frame_id: int | None = None) -> Picture:
        """Return the preview of a frame; None: of the newest frame that has a preview.

        Raises SessionError where there is no such preview.
        """
        reduced = (
            each.frame_id for each in self._frames.kept_frames() if each.detections is not None
        )
        for number in (*reduced,)[::-1] if frame_id is None else (frame_id,):
            path = self._reader.preview_path(number)
            if path is not None:
                return self._picture(number, path)
        which = "any frame" if frame_id is None else f"frame {frame_id}"
        raise SessionError(f"{self.path} holds no picture of {which}")

    def pixels(self, frame_id: int) -> PixelArray:
        """Return all pixels of a kept frame, (height, width) ADU, exactly as they were measured.

        Raises SessionError, which lists the kept frames, for a frame that was not kept; FrameError
        where its file cannot be read.
        """
        from rsoconsole.instruments import read_frame

        path = self._reader.frame_path(frame_id)
        if path is None:
            why = self._reader.missing_pixels_reason(frame_id)
            kept = ", ".join(map(str, self._kept()))
            raise SessionError(
                f"the pixels of frame {frame_id} were not kept{f': {why}' if why else ''};"
                f" {f'kept: {kept}' if kept else 'none was kept'}"
            )
        return read_frame(path, frame_id).pixels

    def plot_streak(self, frame_id: int, figure: Any = None) -> "Figure":
        """Plot the most confident streak of a kept frame pixel by pixel, and its light profile.

        ``figure``: an empty matplotlib figure; None: a new one. Raises SessionError where the frame
        was not kept or nothing was detected in it.
        """
        from rsoconsole.library.notebook.figures.inline import NightFigure, figure_style

        found = self._frame(frame_id).detected_streaks
        if not found:
            raise SessionError(f"nothing was detected in frame {frame_id}")
        pixels, detection = self.pixels(frame_id), found[0]
        parts = (f"confidence {detection.confidence:.2f}", *streak_detail_words(detection))
        title = f"Frame {frame_id}: {', '.join(parts)}"
        figure = NightFigure(6.6, 5.0) if figure is None else figure
        with figure_style():
            draw_streak(figure, pixels, detection, title)
        return figure  # type: ignore[no-any-return]

    def plot_tracks(self, frame_id: int, figure: Any = None) -> "Figure":
        """Plot the streaks of a kept frame that belong to tracks, with numbers and confidences.

        ``figure``: an empty matplotlib figure; None: a new one. Raises SessionError where the frame
        was not kept or no streak of it belongs to a track.
        """
        from rsoconsole.library.notebook.figures.inline import NightFigure, figure_style

        frame, streaks = self._frame(frame_id), []
        for track in tracks_of(self._frames.kept_frames()).values():
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
        with figure_style():
            draw_tracks(figure, pixels, streaks, f"Frame {frame_id}")
        return figure  # type: ignore[no-any-return]

    def _picture(self, frame_id: int, path: Path) -> Picture:
        with system_errors_as(SessionError, f"{path} cannot be read: "):
            png = path.read_bytes()
        frame = self._frame(frame_id)
        return Picture(
            frame_id=frame_id,
            path=path,
            png=png,
            overlay=overlay_svg(frame),
            words=frame_caption(frame),
        )

    def _frame(self, frame_id: int) -> NightFrame:
        return next(
            (each for each in self._frames.kept_frames() if each.frame_id == frame_id), NightFrame()
        )

    def _kept(self) -> list[int]:
        """Frames whose pixels are there: written, and not pruned since."""
        pruned = pruning_times(read_notes(self.path))
        rows = self._reader.view_rows("frames")
        return [row["frame_id"] for row in rows if row["file"] and row["file"] not in pruned]
