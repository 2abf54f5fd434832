"""Small pictures of a session's frames for the report, limited in total size."""

import base64
import io
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.notebook.figures.draw_light import has_light
from rsoconsole.library.notebook.figures.figures import DRAWINGS, LIGHT, has_track
from rsoconsole.library.notebook.night.night import DrawnNight
from rsoconsole.night import NightFrame
from rsoconsole.records import Solution
from rsoconsole.session import SessionReader
from rsoconsole.sky import sky_to_pixel
from rsoconsole.words import utc_text

MAX_PICTURES = 40
"""Largest number of pictures that are chosen evenly; those of missed frames are added."""
MAX_BYTES = 5_000_000
"""Largest size of all pictures together, bytes, as the page holds them."""
WIDE_PX = 300
QUALITY = 72


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPicture:
    """One frame's picture, as a data URI."""

    frame_id: int
    data_uri: str
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportFrame:
    """Picture with its marks; their places (x, y) are in per cent of the picture's size."""

    picture: ReportPicture
    caption: str
    is_missed: bool
    taken: tuple[float, float] | None
    predicted: tuple[float, float] | None


def choose_frames(frames: list[int], missed: Iterable[int]) -> list[int]:
    """Return the frames to show: all missed frames, and up to ``MAX_PICTURES`` spread evenly."""
    count = len(frames)
    most = min(count, MAX_PICTURES)
    even = {frames[round(k * (count - 1) / max(most - 1, 1))] for k in range(most)}
    return sorted(even | (set(missed) & set(frames)))


def read_pictures(session: Path, frames: Iterable[int]) -> tuple[ReportPicture, ...]:
    """Return pictures of the frames that have a readable preview, until ``MAX_BYTES`` is spent."""
    reader = SessionReader(session)
    found: list[ReportPicture] = []
    spent_bytes = 0
    for frame_id in frames:
        path = reader.preview_path(frame_id)
        picture = None if path is None else _picture(frame_id, path)
        if picture is None:
            continue
        spent_bytes += len(picture.data_uri)
        if spent_bytes > MAX_BYTES:
            break
        found.append(picture)
    return tuple(found)


def _picture(frame_id: int, path: Path) -> ReportPicture | None:
    """Picture of a frame; None for a file that is damaged or gone: a report does without."""
    import cv2
    import numpy as np

    try:
        coded = np.frombuffer(path.read_bytes(), np.uint8)
        pixels = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
    except (OSError, cv2.error):
        return None
    if pixels is None:
        return None
    height, width = pixels.shape
    if width > WIDE_PX:
        height, width = max(1, round(height * WIDE_PX / width)), WIDE_PX
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    ok, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        return None
    text = base64.b64encode(jpeg.tobytes()).decode("ascii")
    return ReportPicture(
        frame_id=frame_id,
        data_uri=f"data:image/jpeg;base64,{text}",
        width_px=width,
        height_px=height,
    )


def report_frames(
    session: Path, night: DrawnNight, rows: tuple[MeasuredRow, ...]
) -> list[ReportFrame]:
    """Return the frames that the report shows, with their marks. Raises SessionError."""
    frames = {frame.frame_id: frame for frame in night.frames}
    missed = [number for number, frame in frames.items() if frame.lead_miss_reason is not None]
    taken = {row.frame_id: row for row in rows if row.is_taken and not row.is_superseded}
    shown = []
    for picture in read_pictures(session, choose_frames(list(frames), missed)):
        frame, row = frames[picture.frame_id], taken.get(picture.frame_id)
        assert frame.taken is not None
        size = frame.taken.width_px, frame.taken.height_px
        shown.append(
            ReportFrame(
                picture=picture,
                caption=_caption(frame, row),
                is_missed=frame.lead_miss_reason is not None,
                taken=None if row is None else _per_cent(row.x_px, row.y_px, size),
                predicted=_predicted(frame, size),
            )
        )
    return shown


def _caption(frame: NightFrame, row: MeasuredRow | None) -> str:
    words = f"{frame.frame_id} · {utc_text(frame.t_mid_utc_ns)}"
    if frame.lead_miss_reason is not None:
        return f"{words} · missed: {frame.lead_miss_reason}"
    return words if row is None else f"{words} · {row.confidence:.2f}"


def _predicted(frame: NightFrame, size: tuple[int, int]) -> tuple[float, float] | None:
    plate = frame.solution
    if frame.predicted is None or not isinstance(plate, Solution):
        return None
    x_px, y_px = sky_to_pixel(plate.wcs, frame.predicted.x[0], frame.predicted.x[2])
    return _per_cent(float(x_px), float(y_px), size)


def _per_cent(x_px: float, y_px: float, size: tuple[int, int]) -> tuple[float, float] | None:
    """Place in per cent of the frame; None outside it."""
    x, y = (x_px + 0.5) / size[0] * 100.0, (y_px + 0.5) / size[1] * 100.0
    return (x, y) if 0.0 <= x <= 100.0 and 0.0 <= y <= 100.0 else None


_INKS = {
    "#ffffff": "paper",
    "#000000": "ink",
    "#333333": "ink-2",
    "#555555": "ink-2",
    "#777777": "mid",
    "#888888": "mid",
    "#e4e4e4": "grid",
    "#f3d9b8": "miss",
    "#b26a00": "miss-ink",
    "#c62828": "measured",
    "#1e55c8": "updated",
    "#2e7d32": "predicted",
    "#5b7fb5": "band",
}
"""Colours of the drawings by the page's name for them."""
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_NAMESPACE = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')
_ID = re.compile(r'\bid="([^"]+)"')
_REFERENCE = re.compile(r'(?:xlink:)?href="#([^"]+)"')
_URL = re.compile(r"url\(#([^)]+)\)")
_OPENING = re.compile(r"<svg\b[^>]*?viewBox=\"([^\"]+)\"[^>]*>", re.DOTALL)


_HEIGHTS_IN = {3.0: 2.8, 5.0: 4.6}
"""Height of a figure in the page by its height in print, inches."""


def inline_figures(night: DrawnNight, with_firsts: DrawnNight) -> dict[str, str]:
    """Return figures as SVG by name: the paper's (without a track the confidence), light curve.

    The SVG is well-formed and refers to nothing outside the page. ``with_firsts``: the night in
    which measurements that began a track also count as assigned to it; for the confidence.
    """
    drawn = {}
    for drawing in (*DRAWINGS.values(), *((LIGHT,) if has_light(night) else ())):
        if drawing.needs_track and not has_track(night):
            continue
        name = drawing.name.removeprefix("track_")
        source = night if drawing.needs_track else with_firsts
        height_in = _HEIGHTS_IN[drawing.height_in]
        drawn[name] = _inlined(_drawn(drawing.draw, source, height_in), name)
    return drawn


def _drawn(draw: Callable[[Any, DrawnNight], None], night: DrawnNight, height_in: float) -> str:
    # Half a second of imports: only who draws pays for them. No window system is asked for.
    from rsoconsole.library.notebook.figures.inline import NightFigure, figure_style

    salt = night.title
    # Nothing of it is shown; a dollar in a title would begin a formula.
    night = replace(night, title="")
    with figure_style(salt):
        figure = NightFigure(7.2, height_in)
        draw(figure, night)
        for axis in figure.axes:
            axis.set_title("", loc="left")  # the page's caption says it
        drawn = io.StringIO()
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()


def _inlined(svg: str, name: str) -> str:
    """The drawing without its file's head, with names and colours of its own in the page."""
    inner = _METADATA.sub("", svg[svg.index("<svg") :])
    inner = _ID.sub(rf'id="{name}-\1"', inner)
    inner = _REFERENCE.sub(rf'href="#{name}-\1"', inner)
    inner = _URL.sub(rf"url(#{name}-\1)", inner)
    inner = _NAMESPACE.sub("", inner)
    for colour, ink in _INKS.items():
        inner = inner.replace(colour, f"var(--{ink})")
    head = rf'<svg viewBox="\1" role="img" aria-labelledby="figure-{name}" focusable="false">'
    return _OPENING.sub(head, inner, count=1)
