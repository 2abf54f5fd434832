"""A what-if in words: the figures as recorded beside those that would have been."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rsoconsole.words import counted, number

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures, shown
    from rsoconsole.pipeline.batch import Answer

LABEL, COLUMN = 22, 20


def answer_lines(session: str, answer: "Answer") -> Iterator[str]:
    """Lines of at most 80 columns, but for long names."""
    assert answer.recorded is not None
    assert answer.what_if is not None
    yield session
    for name, value in answer.changes.items():
        yield f"  tried  {name}: {_plain(answer.before.get(name))} → {_plain(value)}"
    if not answer.changes:
        yield "  nothing tried: the recorded settings"
    if answer.rerun is not None:
        kept, gone = answer.rerun.rerun, answer.rerun.not_kept + answer.rerun.unreadable
        rest = f"; {gone} without their pixels stay as recorded" if gone else ""
        yield f"  {counted(kept, 'frame')} reduced again{rest}"
    if not answer.is_reproduced:
        yield (
            "  the recorded settings do not give the recorded track: another version"
            " recorded it, or the session was cut off"
        )
    yield from figures_lines(answer.recorded, answer.what_if)
    carried = answer.recorded.carried_by_orbit
    if carried and answer.changes:
        yield (
            f"  that night the orbit carried the track on {carried} times where the filter failed;"
            " from the first other frame on the filter stands alone here"
        )
    if answer.branch is not None:
        yield f"  kept as {answer.branch}"


def figures_lines(then: "TrackFigures", now: "TrackFigures") -> Iterator[str]:
    """Both side by side, with a word where one is better."""
    yield f"  {'':{LABEL}}{'recorded':>{COLUMN}}{'what if':>{COLUMN}}"
    for (label, words), worth in _rows():
        mark = _mark(None if worth is None else (worth(then), worth(now)))
        yield f"  {label:{LABEL}}{words(then):>{COLUMN}} {words(now):>{COLUMN - 1}}{mark}".rstrip()
    for state in sorted({*then.states, *now.states}):
        counts = then.states.get(state, 0), now.states.get(state, 0)
        yield f"  {'frames in ' + state:{LABEL}}{counts[0]:>{COLUMN}}{counts[1]:>{COLUMN}}"


def _mark(worth: tuple[float | None, float | None] | None) -> str:
    then, now = worth or (None, None)
    if then is None or now is None:
        return ""
    if math.isclose(then, now, rel_tol=1e-3, abs_tol=1e-9):
        return ""
    return "  + better" if now > then else "  - worse"


def _locked(figures: "TrackFigures") -> str:
    if figures.locked_after_frames is None:
        return "never"
    return f"frame {figures.locked_after_frames}, {number(figures.locked_after_s, '.0f', ' s')}"


def _nis_worth(figures: "TrackFigures") -> float | None:
    """0 in the band; outside, the further the worse."""
    if figures.nis_mean is None or figures.nis_band is None:
        return None
    low, high = figures.nis_band
    nis = max(figures.nis_mean, 1e-12)
    return -max(math.log(low / nis), math.log(nis / high), 0.0)


def _inside_worth(figures: "TrackFigures") -> float | None:
    """A sound filter's is 0.995; more is no gain, and what is not shown is none."""
    return None if figures.inside_3sigma is None else round(min(figures.inside_3sigma, 0.99), 2)


def _minus(value: float | None) -> float | None:
    return None if value is None else -value


_Worth = Callable[["TrackFigures"], float | None]


def _rows() -> list[tuple["shown.Figure", _Worth | None]]:
    from rsoconsole.night import shown

    return [
        (shown.Figure("frames", lambda f: str(f.frames)), None),
        (shown.Figure("locked after", _locked), lambda f: _minus(f.locked_after_s)),
        (shown.Figure("lock held", lambda f: number(f.lock_held, ".1%")), lambda f: f.lock_held),
        (shown.UPDATES, lambda f: float(f.updates)),
        (shown.MISSES, lambda f: -float(f.misses)),
        (shown.Figure("lost", lambda f: str(f.losses)), lambda f: -float(f.losses)),
        (shown.RMS, lambda f: _minus(f.residual_rms_arcsec)),
        (shown.Figure("  east", lambda f: number(f.residual_east_rms_arcsec, ".2f", "″")), None),
        (shown.Figure("  north", lambda f: number(f.residual_north_rms_arcsec, ".2f", "″")), None),
        (shown.NIS_MEAN, _nis_worth),
        (shown.BAND, None),
        (shown.INSIDE, _inside_worth),
        (shown.Figure("widest 3σ", lambda f: number(f.max_3sigma_arcmin, ".3g", "′")), None),
        (shown.STATE, None),
    ]


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
