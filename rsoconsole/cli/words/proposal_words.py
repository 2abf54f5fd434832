"""A proposal of Q and R in words."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rsoconsole.cli.words.what_if_words import figures_lines

if TYPE_CHECKING:
    from rsoconsole.pipeline.replay import WhatIf
    from rsoconsole.pipeline.tuning import Proposal, Soundness


def proposal_lines(proposal: "Proposal", effects: "Sequence[WhatIf]") -> Iterator[str]:
    """Verdict, parameters, evidence, effect, and what to do with it."""
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
        yield from figures_lines(effect.recorded, effect.what_if)
    yield ""
    yield "  to use it, in the configuration:"
    yield "    [filter]"
    for name, value in proposal.changes.items():
        yield f"    {name.removeprefix('filter.')} = {value:g}"


def _evidence(proposal: "Proposal", before: "Soundness", after: "Soundness") -> Iterator[str]:
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
