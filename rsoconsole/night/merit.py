"""Figures of merit of a night: label and wording of each, for all places that show them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rsoconsole.words import number


class MeritFigure(NamedTuple):
    """A figure of merit: its label, and the function that formats its value."""

    label: str
    words: Callable[[Any], str]


SOUND: Mapping[bool | None, str] = {True: " ✓", False: " ✗", None: ""}
RMS = MeritFigure("residual rms", lambda f: number(f.residual_rms_arcsec, ".2f", "″"))
NIS_MEAN = MeritFigure("NIS mean (2)", lambda f: number(f.nis_mean, ".2f") + SOUND[f.is_nis_sound])
BAND = MeritFigure(
    "its band", lambda f: "{:.2f} to {:.2f}".format(*f.nis_band) if f.nis_band else "-"
)
INSIDE = MeritFigure("3σ holds", lambda f: number(f.inside_3sigma, ".0%"))
LOG_L = MeritFigure("log L ↑", lambda f: number(f.log_likelihood_mean, "+.2f"))
LOCK = MeritFigure(
    "lock",
    lambda f: "never" if f.locked_after_frames is None else f"after {f.locked_after_frames} frames",
)
UPDATES = MeritFigure("updates", lambda f: str(f.updates))
MISSES = MeritFigure("misses", lambda f: str(f.misses))
STATE = MeritFigure("state", lambda f: f.state or "-")

TUNED = (RMS, NIS_MEAN, LOG_L, INSIDE, MISSES, STATE)
"""Figures of merit that compare settings over the last frames."""
NIGHT = (LOCK, UPDATES, MISSES, RMS, NIS_MEAN, BAND, INSIDE)
"""Figures of merit that compare settings over a whole night."""
