"""What ``process`` does with whole nights: sessions made of them, several at once."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.cli.words import output, progress

if TYPE_CHECKING:
    from rsoconsole.pipeline.batch import Night, NightOutcome, WorkerPool


def process_nights(
    nights: "tuple[Night, ...]", root: Path, pool_of: "Callable[[int], WorkerPool]", json_: bool
) -> None:
    """Make a session of each, say what became of it, and exit 1 where one is not whole."""
    from rsoconsole.pipeline.batch import batch_nights

    is_whole = True
    with batch_nights.working_in(root), progress("nights", len(nights)) as bar:
        for outcome in batch_nights.process_nights(nights, pool_of, on_done=bar):
            is_whole = is_whole and outcome.error is None and not outcome.unreadable
            with bar.aside():
                _say(outcome, json_)
    output.exit_where(not is_whole)


def _say(outcome: "NightOutcome", json_: bool) -> None:
    output.emit_json(_night_report(outcome)) if json_ else output.say(_night_words(outcome))
    for words in (*outcome.unreadable, *filter(None, (outcome.error,))):
        output.complain(f"rsoconsole: {outcome.source.name}: {words}")


_AS_IT_IS = (
    *("frames", "unreadable", "detections", "measurements", "misses", "locked_after_frames"),
)
"""Keys that are the outcome's own."""


def _night_report(outcome: "NightOutcome") -> dict[str, Any]:
    return {
        "night": str(outcome.source),
        "session": None if outcome.state == "failed" else str(outcome.session),
        "outcome": outcome.state,
        "error": outcome.error,
        **{name: getattr(outcome, name) for name in _AS_IT_IS},
        "state": outcome.last_state,
    }


def _night_words(outcome: "NightOutcome") -> str:
    if outcome.state == "failed":
        return f"{outcome.source.name}: failed"
    locked = outcome.locked_after_frames
    followed = "nothing locked" if locked is None else f"locked after frame {locked}"
    already = ", done already" if outcome.state == "skipped" else ""
    return (
        f"{outcome.source.name}: {outcome.frames} frames, {outcome.measurements} measurements,"
        f" {followed}, {outcome.misses} missed{already}  {outcome.session}"
    )
