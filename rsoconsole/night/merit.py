"""Figures of merit of a night: the label and the wording of each, wherever they are shown."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from rsoconsole.words import number


class Figure(NamedTuple):
    """Figure of merit of a night: its label, and the format of its value."""

    label: str
    words: Callable[[Any], str]


SOUND: Mapping[bool | None, str] = {True: " ✓", False: " ✗", None: ""}
RMS = Figure("residual rms", lambda f: number(f.residual_rms_arcsec, ".2f", "″"))
NIS_MEAN = Figure("NIS mean (2)", lambda f: number(f.nis_mean, ".2f") + SOUND[f.is_nis_sound])
BAND = Figure("its band", lambda f: "{:.2f} to {:.2f}".format(*f.nis_band) if f.nis_band else "-")
INSIDE = Figure("3σ holds", lambda f: number(f.inside_3sigma, ".0%"))
LOG_L = Figure("log L ↑ is better", lambda f: number(f.log_likelihood_mean, "+.2f"))
LOCK = Figure(
    "lock",
    lambda f: "never" if f.locked_after_frames is None else f"after {f.locked_after_frames} frames",
)
UPDATES = Figure("updates", lambda f: str(f.updates))
MISSES = Figure("misses", lambda f: str(f.misses))
STATE = Figure("state", lambda f: f.state or "-")

TUNED = (RMS, NIS_MEAN, LOG_L, INSIDE, MISSES, STATE)
"""Figures compared for a setting on trial over the last frames."""
NIGHT = (LOCK, UPDATES, MISSES, RMS, NIS_MEAN, BAND, INSIDE)
"""Figures compared for a setting on trial over a whole night."""
