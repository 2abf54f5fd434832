"""A matplotlib figure that a notebook displays by itself, with any backend or none.

It uses neither a window system nor pyplot: nothing is shown twice, nothing needs closing.
"""

import io
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rsoconsole.library.notebook.figures.draw_sky import STYLE

SHOWN_DPI = 100
SAVED_DPI = 144
"""Resolution of the saved picture, for fine screens; ``SHOWN_DPI`` gives the displayed size."""


def figure_style(salt: str | None = None) -> AbstractContextManager[None]:
    """Return a context in which matplotlib draws in the program's fonts and colours.

    ``salt``: seed of the ids in an SVG, so that equal drawings give equal files; None: random
    ids.
    """
    style: Any = STYLE if salt is None else {**STYLE, "svg.hashsalt": salt}
    return mpl.rc_context(style)


class NightFigure(Figure):
    """A matplotlib figure in the program's fonts and colours."""

    def __init__(self, width_in: float, height_in: float) -> None:
        with figure_style():
            super().__init__(figsize=(width_in, height_in))
        FigureCanvasAgg(self)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """The picture, and the size at which it is shown."""
        buffer = io.BytesIO()
        with figure_style():
            self.savefig(buffer, format="png", dpi=SAVED_DPI, metadata={"Software": None})
        width_in, height_in = self.get_size_inches()
        size: dict[str, Any] = {
            "width": round(width_in * SHOWN_DPI),
            "height": round(height_in * SHOWN_DPI),
        }
        return buffer.getvalue(), size
