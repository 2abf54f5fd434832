"""A what-if in words: the recorded figures beside those with the changed settings."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from rsoconsole.words import count_words, number

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures, merit
    from rsoconsole.pipeline import FilterConsistency, Proposal, WhatIf, WhatIfFigures

LABEL, COLUMN = 22, 20


def what_if_lines(session: str, answer: "WhatIfFigures") -> Iterator[str]:
    """Lines on a session's what-if, at most 80 columns wide except for long names."""
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
        yield f"  {count_words(kept, 'frame')} reduced again{rest}"
    if not answer.is_reproduced:
        yield (
            "  the recorded settings do not give the recorded track: another version"
            " recorded it, or the session was cut off"
        )
    yield from compared_figures_lines(answer.recorded, answer.what_if)
    carried = answer.recorded.carried_by_orbit
    if carried and answer.changes:
        yield (
            f"  that night the filter failed {count_words(carried, 'time')} and the orbit's"
            " prediction was used; here it is not, once a frame differs from the record"
        )
    if answer.branch is not None:
        yield f"  kept as {answer.branch}"


def compared_figures_lines(then: "TrackFigures", now: "TrackFigures") -> Iterator[str]:
    """Yield lines of recorded and what-if figures, the latter marked better or worse."""
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
    """Merit of the mean NIS: 0 in the band; outside, the further the worse."""
    if figures.nis_mean is None or figures.nis_band is None:
        return None
    low, high = figures.nis_band
    nis = max(figures.nis_mean, 1e-12)
    return -max(math.log(low / nis), math.log(nis / high), 0.0)


def _inside_worth(figures: "TrackFigures") -> float | None:
    """Merit of the share inside 3 sigma, two digits: a sound filter's is 0.995, more is no gain."""
    return None if figures.inside_3sigma is None else round(min(figures.inside_3sigma, 0.99), 2)


def _minus(value: float | None) -> float | None:
    return None if value is None else -value


_Worth = Callable[["TrackFigures"], float | None]


def _rows() -> list[tuple["merit.MeritFigure", _Worth | None]]:
    from rsoconsole.night import merit

    return [
        (merit.MeritFigure("frames", lambda f: str(f.frames)), None),
        (merit.MeritFigure("locked after", _locked), lambda f: _minus(f.locked_after_s)),
        (
            merit.MeritFigure("lock held", lambda f: number(f.lock_held, ".1%")),
            lambda f: f.lock_held,
        ),
        (merit.UPDATES, lambda f: float(f.updates)),
        (merit.MISSES, lambda f: -float(f.misses)),
        (merit.MeritFigure("lost", lambda f: str(f.losses)), lambda f: -float(f.losses)),
        (merit.RMS, lambda f: _minus(f.residual_rms_arcsec)),
        (
            merit.MeritFigure("  east", lambda f: number(f.residual_east_rms_arcsec, ".2f", "″")),
            None,
        ),
        (
            merit.MeritFigure("  north", lambda f: number(f.residual_north_rms_arcsec, ".2f", "″")),
            None,
        ),
        (merit.NIS_MEAN, _nis_worth),
        (merit.BAND, None),
        (merit.INSIDE, _inside_worth),
        (merit.MeritFigure("widest 3σ", lambda f: number(f.max_3sigma_arcmin, ".3g", "′")), None),
        (merit.STATE, None),
    ]


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def proposal_lines(proposal: "Proposal", effects: "Sequence[WhatIf]") -> Iterator[str]:
    """Lines on a proposal of Q and R: result, parameters, evidence, effects and next step."""
    number = len(proposal.sessions)
    yield ", ".join(str(folder) for folder in proposal.sessions)
    tracks = f"{proposal.tracks} track{'' if proposal.tracks == 1 else 's'}"
    nights = f" of {number} sessions together" if number > 1 else ""
    yield f"  preset {proposal.preset}, {proposal.innovations} innovations, {tracks}{nights}"
    yield f"  {proposal.words}"
    if proposal.before is None or proposal.after is None:
        return
    yield ""
    yield f"  {'':20}{'recorded':>11}{'likeliest':>11}  {'68 % interval':20}{'proposed':>11}"
    for each in proposal.parameters:
        low, high = each.interval_68
        interval = f"{low:.2g} to {high:.2g}"
        proposed = "as it is" if each.proposed == each.recorded else f"{each.proposed:.3g}"
        yield (
            f"  {each.label:20}{each.recorded:>11.3g}{each.likeliest:>11.3g}"
            f"  {interval:20}{proposed:>11}"
        )
    for term in proposal.terms:
        if not term.is_taken:
            gains = f"gains {term.gain:.1f} of {term.needed:.1f}"
            yield f"  {term.label}: no value of its own ({gains})"
    yield ""
    yield from _evidence(proposal, proposal.before, proposal.after)
    for warning in proposal.warnings:
        yield f"  ! {warning}"
    if not proposal.changes:
        return
    for effect in effects:
        yield ""
        yield f"  {effect.session} with what is proposed:"
        yield from compared_figures_lines(effect.recorded, effect.what_if)
    yield ""
    yield "  to use it, in the configuration:"
    yield "    [filter]"
    for name, value in proposal.changes.items():
        yield f"    {name.removeprefix('filter.')} = {value:g}"


def _evidence(
    proposal: "Proposal", before: "FilterConsistency", after: "FilterConsistency"
) -> Iterator[str]:
    low, high = before.nis_band
    bound = proposal.autocorrelation_bound or 0.0
    yield f"  {'the same innovations':34}{'recorded':>11}{'proposed':>11}"
    rows = (
        (
            "log L",
            before.log_likelihood,
            after.log_likelihood,
            ".1f",
            f"{after.log_likelihood - before.log_likelihood:+.1f}, higher is better",
        ),
        ("NIS mean", before.nis_mean, after.nis_mean, ".3g", f"sound: {low:.2f} to {high:.2f}"),
        *(
            (
                f"autocorrelation, {axis}",
                getattr(before, f"autocorrelation_{axis}"),
                getattr(after, f"autocorrelation_{axis}"),
                "+.2f",
                f"white: within ±{bound:.2f}",
            )
            for axis in ("east", "north")
        ),
    )
    for label, then, now, form, words in rows:
        yield f"  {label:34}{format(then, form):>11}{format(now, form):>11}  {words}".rstrip()
    held = proposal.hold_out
    if held is not None:
        yield (
            f"  fitted to the first half, log L of the second ({held.innovations}) gains"
            f" {held.gain:+.1f}; its NIS {held.nis_mean_before:.2f} → {held.nis_mean_after:.2f}"
        )
