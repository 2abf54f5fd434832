"""The figures of a session as SVG that lies inside an HTML page and takes the page's colours."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from rsoconsole.notebook.figures import (
    draw_about_line,
    draw_confidence,
    draw_nis,
    draw_residuals,
    draw_track,
)
from rsoconsole.notebook.night import DrawnNight

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


_DRAWN: Mapping[str, tuple[Callable[[Any, DrawnNight], None], float]] = {
    "confidence": (draw_confidence, 2.8),
    "track": (draw_track, 4.6),
    "about_line": (draw_about_line, 4.6),
    "residuals": (draw_residuals, 4.6),
    "nis": (draw_nis, 2.8),
}
"""What draws each, and how high it is in inches; the page has their titles and captions."""


def inline_figures(night: DrawnNight, with_firsts: DrawnNight) -> dict[str, str]:
    """The paper's figures as SVG by name; a night without a track has the confidences alone.

    Well-formed, without any reference out of the page. ``with_firsts``: the same night where what
    began a track counts as taken by it, for the confidences.
    """
    has_track = any(frame.updated is not None for frame in night.frames)
    drawn = {}
    for name, (draw, height_in) in _DRAWN.items():
        if name == "confidence":
            drawn[name] = _inlined(_drawn(draw, with_firsts, height_in), name)
        elif has_track:
            drawn[name] = _inlined(_drawn(draw, night, height_in), name)
    return drawn


def _drawn(draw: Callable[[Any, DrawnNight], None], night: DrawnNight, height_in: float) -> str:
    # Half a second of imports: only who draws pays for them. No window system is asked for.
    from rsoconsole.notebook.figures import NightFigure, styled

    salt = night.title
    # Nothing of it is shown; a dollar in a title would begin a formula.
    night = replace(night, title="")
    with styled(salt):
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
