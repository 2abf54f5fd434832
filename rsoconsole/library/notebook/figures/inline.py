"""A matplotlib figure that shows itself in a notebook, whichever backend is set, or none.

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
"""Resolution for screens with small pixels; the size shown is by ``SHOWN_DPI``."""


def figure_style(salt: str | None = None) -> AbstractContextManager[None]:
    """Context in which matplotlib draws in the product's type and colours.

    ``salt``: with it the same drawing gives the same SVG.
    """
    style: Any = STYLE if salt is None else {**STYLE, "svg.hashsalt": salt}
    return mpl.rc_context(style)


class NightFigure(Figure):
    """A figure with the product's own type and colours."""

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
