"""The figures of a session as SVG that lies inside an HTML page and takes the page's colours."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
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


@dataclass(frozen=True, slots=True, kw_only=True)
class InlineFigure:
    """One figure of the report."""

    name: str
    svg: str
    """Well-formed, without any reference out of the page."""
    title: str
    caption: str
    alt: str


_Drawing = tuple[str, str, str, Callable[[Any, DrawnNight], None], float]
_CONFIDENCE: _Drawing = (
    "confidence",
    "Confidence",
    "Confidence of the measurement that the track took in each frame, of the others, and the"
    " threshold τ. Frames in which the followed object was missed are shaded.",
    draw_confidence,
    2.8,
)
_WITH_TRACK: tuple[_Drawing, ...] = (
    (
        "track",
        "The track",
        "Right ascension and declination against time: measured (squares), updated (triangles),"
        " predicted (circles), 3 σ bounds of the state dashed.",
        draw_track,
        4.6,
    ),
    (
        "about_line",
        "The track about a straight line",
        "The same after the straight line through the updated states is taken out, in seconds of"
        " arc on the sky; bars are one sigma of a measurement as it says of itself.",
        draw_about_line,
        4.6,
    ),
    (
        "residuals",
        "Residuals",
        "Innovations, measured minus predicted, within ± 3 √S. A sound filter has 99.7 % of them"
        " inside on each axis, and no run on one side.",
        draw_residuals,
        4.6,
    ),
    (
        "nis",
        "Normalised innovation squared",
        "NIS of every update with its 95 % band for two degrees of freedom, and its running mean"
        " over twelve updates with the band of that mean. Its mean is 2 for a sound filter.",
        draw_nis,
        2.8,
    ),
)


def inline_figures(
    night: DrawnNight, alts: dict[str, str], with_firsts: DrawnNight
) -> tuple[InlineFigure, ...]:
    """The paper's figures; a night without a track has the confidences alone.

    ``alts``: what each says, in words, by name, for those who cannot see it. ``with_firsts``: the
    same night where what began a track counts as taken by it, for the confidences.
    """
    drawings = [_CONFIDENCE]
    if any(frame.updated is not None for frame in night.frames):
        drawings += _WITH_TRACK
    return tuple(
        InlineFigure(
            name=name,
            svg=_inlined(
                _drawn(draw, with_firsts if name == "confidence" else night, height_in), name
            ),
            title=title,
            caption=caption,
            alt=alts.get(name, caption),
        )
        for name, title, caption, draw, height_in in drawings
    )


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
