"""The terms on the screen, each explained in two or three lines: a page of the help."""

import textwrap
from collections.abc import Iterator

INDENT = 13
TERMS: tuple[tuple[str, str], ...] = (
    ("confidence", "Probability that a detection is a real streak of the sky, from 0 to 1."),
    (
        "τ (tau)",
        "The lowest confidence that counts as a detection. Lower: fainter streaks, and more that"
        " are none.",
    ),
    (
        "Q",
        "How much the filter expects the object to deviate from its motion model. Larger: it"
        " follows the measurements more closely, and its bounds grow faster while it coasts.",
    ),
    (
        "R",
        "How noisy a measurement is believed to be. Larger: the filter smooths more and relies"
        " on its prediction. Q× and R× multiply the preset's own values: Q of every motion, R all"
        " that is believed of a measurement's error.",
    ),
    (
        "learning",
        "What presets adaptive and tuned learn of the night's noise by themselves. On auto it is"
        " held as it is while a factor of Q or R is not 1, so that it cannot take the factor back;"
        " l in the tuning pane changes that.",
    ),
    (
        "gain",
        "Share of a residual by which an update moves the place: near 0 the filter trusts its"
        " prediction, near 1 the measurement. The tuning pane says where gain and bounds settle by"
        " the settings in force and on trial, and after how many frames.",
    ),
    (
        "residual",
        "Measured minus predicted, before the update (the innovation), on each axis in arcsec.",
    ),
    (
        "NIS",
        "Normalised innovation squared: 2 on average when Q and R are right; /40: the mean of 40."
        " '95% 0.05-7.4' is where 19 of 20 lie then. Not sufficient: residuals must also not"
        " resemble those of the frame before: 'lag-1' in the orbit's pane, their correlation.",
    ),
    (
        "log L",
        "Tuning: how likely the residuals are under the bounds that the filter gave them (mean log"
        " likelihood of an update). The higher, the better; only over the same measurements.",
    ),
    (
        "motion",
        "Preset adaptive, under the NIS plot: which way of moving fits best (parallel: as a"
        " satellite that keeps its slot; great circle, any orbit, changing orbit: freer), and how"
        " much the instants scatter (timing ±, a shutter late at random), also in arcsec.",
    ),
    (
        "matched",
        "Stars under the picture: those of the catalogue that the plate is fitted to. Fewer than"
        " the frame's stars, which a cloud is judged by: the catalogue is not as deep.",
    ),
    (
        "3σ bounds",
        "The shaded band in the residual plots, where it goes beyond the axis with an open arrow"
        " at the edge; a dashed line: the bounds by the settings on trial. Of one axis they hold"
        " 99.7 % of the residuals when Q and R are right; the ellipse of both axes in the picture"
        " holds 98.9 %.",
    ),
    (
        "σ (sigma)",
        "A standard deviation; of what, the word before it says: bounds of a residual, prediction"
        " of where it is now. 1σ under the close-up, east and north: its measured middle. 'RMS'"
        " under the picture: how far the stars lie from the plate.",
    ),
    (
        "solve RMS",
        "How far the stars lie from the catalogue's places after the fit, in arcsec: a small"
        " part of a pixel is good.",
    ),
    (
        "FWHM",
        "Width of the stars at half their height, in pixels: focus and seeing. Smaller is sharper.",
    ),
    (
        "ZP",
        "Transparency: the magnitude of a star that would give one count of the camera in a second"
        " (zero point). It drops by 1 where cloud or haze takes 60 % of the light.",
    ),
    (
        "mag",
        "Apparent magnitude of the object in Johnson V by the frame's catalogue stars; ± is noise"
        " and zero point, what its unknown colour adds is said apart. 'inst': no zero point is"
        " known, 0 is one count of the camera in a second. '<': saturated, brighter than that.",
    ),
    ("background", "Light of the empty sky in a pixel, in the camera's counts (ADU)."),
    ("coast", "Nothing was measured: the track goes on by its prediction, and its bounds grow."),
    ("gate", "How large a NIS may be for a measurement to belong to the track."),
    ("prior", "What is assumed of an orbit before it is measured, e.g. a geostationary slot."),
    ("free", "Orbit: the measurements alone determine it. The others below say what it rests on."),
    (
        "constrained by prior",
        "Orbit: the measurements alone leave it open; the prior (given in brackets) decides what"
        " they do not. Trust it as far as the prior holds.",
    ),
    (
        "weak geometry",
        "Orbit: the arc is too short or too straight for its distance. Directions in the next"
        " minutes are good, elements are not.",
    ),
    ("not observable", "Orbit: many quite different orbits fit alike; a longer arc tells more."),
    (
        "runner-up",
        "The catalogued object that fits second best. The wider apart the two, the surer the name.",
    ),
    (
        "pointing offset",
        "How far the stars lie from where the mount says it looks. It is measured in each solved"
        " frame and taken into account; the mount is never synchronised.",
    ),
    (
        "no guiding",
        "The telescope goes to its aim before each exposure and then tracks at the sidereal rate:"
        " nothing guides while the shutter is open.",
    ),
)
"""(term, meaning) pairs, in the order in which a screen shows the terms."""


def glossary_text(columns: int = 70) -> str:
    """Return all terms with their meanings as text, wrapped to ``columns``."""
    return "\n".join(line for term, words in TERMS for line in _entry(term, words, columns))


def _entry(term: str, words: str, columns: int) -> Iterator[str]:
    head, rest = f"{term:<{INDENT}}", " " * INDENT
    if len(term) >= INDENT:
        yield term
        head = rest
    yield from textwrap.wrap(words, columns, initial_indent=head, subsequent_indent=rest)
