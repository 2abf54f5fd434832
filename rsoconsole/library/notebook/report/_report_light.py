"""Brightness of the tracks for the report."""

from collections.abc import Sequence
from dataclasses import dataclass

from rsoconsole.night import NightFrame, light_of_track, tracks_with_light
from rsoconsole.records import Band
from rsoconsole.words import false_alarm_words, glint_words, no_period_words, period_words

MAX_TRACKS = 20
"""Largest number of tracks in the table, those of the most streaks; the session has all."""
MAX_GLINTS = 5
"""Largest number of glints of a track in the table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GlintLine:
    """A glint in the table."""

    t_utc_ns: int
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LightLine:
    """Brightness of one track in the table."""

    track: int
    band: Band
    streaks: int
    mag: float | None
    """Median magnitude."""
    brightest_mag: float | None
    faintest_mag: float | None
    period: str
    """The period, or why there is none, in words."""
    glints: tuple[GlintLine, ...]
    glints_left_out: int


def summarise_light(frames: Sequence[NightFrame]) -> tuple[LightLine, ...]:
    """Return the brightness of all tracks that have any, those of the most streaks first."""
    return tuple(_line(frames, number) for number in tracks_with_light(frames))


def _line(frames: Sequence[NightFrame], number: int) -> LightLine:
    found = light_of_track(frames, number)
    assert found is not None
    search, period = found.search, found.search.period
    words = no_period_words(
        search.points, search.false_alarm_probability, search.min_period_s, search.max_period_s
    )
    if period is not None:
        words = (
            f"{period_words(period.period_s, period.sigma_s)}, {period.amplitude_mag:.2f} mag,"
            f" false-alarm probability {false_alarm_words(search.false_alarm_probability)};"
            f" half {period.half_s:.6g} s, double {period.double_s:.6g} s"
        )
    return LightLine(
        track=number,
        band=found.curve.band,
        streaks=len(found.curve.points),
        mag=found.mag,
        brightest_mag=found.brightest_mag,
        faintest_mag=found.faintest_mag,
        period=words,
        glints=tuple(
            GlintLine(
                t_utc_ns=each.t_utc_ns,
                words=glint_words(
                    each.height_mag, each.duration_s, is_within_frame=each.is_within_frame
                ),
            )
            for each in found.glints[:MAX_GLINTS]
        ),
        glints_left_out=max(len(found.glints) - MAX_GLINTS, 0),
    )
