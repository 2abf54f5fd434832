"""The paper's figures, from a session: confidence, right ascension and declination, residuals.

Marks as in Jordan et al. (arXiv 2304.06227): measured red squares, updated blue triangles,
predicted green circles, 3-sigma bounds dashed. At the scale of a night the three marks coincide
and the bounds vanish, so the same is drawn again about a straight line, and the innovations with
their own bounds by themselves.
"""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from rsoconsole.errors import SessionError
from rsoconsole.notebook.draw_sky import draw_about_line, draw_errors, draw_track
from rsoconsole.notebook.draw_time import draw_confidence, draw_nis, draw_residuals
from rsoconsole.notebook.night import Night, read_night, read_truth
from rsoconsole.notebook.page import STYLE

FigureFormat = Literal["png", "svg", "pdf"]


def write_figures(
    session: Path, out: Path, *, truth: Path | None = None, file_format: FigureFormat = "png"
) -> tuple[Path, ...]:
    """Draw a session's figures into the folder ``out`` and return their paths, in order.

    ``truth`` is a simulated observatory's truth, one JSON object an exposure; with it there is
    one figure more, the errors against what really was. A session without a track gives the
    confidences alone. Raises SessionError when the session cannot be read, holds no frame, or
    ``out`` cannot be written.
    """
    night = read_night(session)
    drawings: list[tuple[str, Callable[[Any], None]]] = [
        ("confidence", lambda figure: draw_confidence(figure, night))
    ]
    if any(frame.track is not None for frame in night.frames):
        drawings += [
            ("track", lambda figure: draw_track(figure, night)),
            ("track_about_line", lambda figure: draw_about_line(figure, night)),
            ("residuals", lambda figure: draw_residuals(figure, night)),
            ("nis", lambda figure: draw_nis(figure, night)),
        ]
        if truth is not None:
            places = read_truth(truth, night)
            drawings.append(("errors", lambda figure: draw_errors(figure, night, places)))
    return _written(night, drawings, out, file_format)


def _written(
    night: Night,
    drawings: list[tuple[str, Callable[[Any], None]]],
    out: Path,
    file_format: FigureFormat,
) -> tuple[Path, ...]:
    # Half a second of imports: only who draws pays for them. No window system is asked for.
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    paths = []
    # A fixed salt makes the same session give the same SVG.
    style: Any = {**STYLE, "svg.hashsalt": night.title}
    with mpl.rc_context(style):
        for number, (name, draw) in zip(itertools.count(1), drawings, strict=False):
            figure = Figure(figsize=(6.6, 3.0 if name in {"confidence", "nis"} else 5.0))
            FigureCanvasAgg(figure)
            draw(figure)
            path = out / f"{number}_{name}.{file_format}"
            try:
                out.mkdir(parents=True, exist_ok=True)
                figure.savefig(path, metadata=_undated(file_format))
            except OSError as error:
                raise SessionError(f"{path} cannot be written: {error}") from error
            paths.append(path)
    return tuple(paths)


def _undated(file_format: FigureFormat) -> dict[str, Any]:
    """The file says nothing of when it was drawn."""
    return {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[file_format]
