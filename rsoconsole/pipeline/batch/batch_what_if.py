"""What-ifs over many sessions: one question a session, answered wherever there is a core."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rsoconsole.errors import RsoconsoleError
from rsoconsole.night import TrackFigures
from rsoconsole.pipeline.replay import RerunCounts, check_name, save_branch, what_if_session


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What is asked of one session; arguments as ``what_if_session``'s and ``save_branch``'s."""

    session: Path
    changes: Mapping[str, float | str] = field(default_factory=dict)
    detector: bool = False
    solver: bool = False
    save: str | None = None
    force: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The figures without the night itself, which may be large."""

    changes: Mapping[str, float | str]
    before: Mapping[str, object] = field(default_factory=dict)
    recorded: TrackFigures | None = None
    what_if: TrackFigures | None = None
    is_reproduced: bool = False
    rerun: RerunCounts | None = None
    branch: Path | None = None
    error: str | None = None
    """Why there is none."""


def answer(question: Question, on_frame: Callable[[], None] = lambda: None) -> Answer:
    """Try, and keep the result where a name is given; never raises for what is broken."""
    try:
        if question.save is not None:
            check_name(question.session, question.save, force=question.force)
        found = what_if_session(
            question.session,
            question.changes,
            detector=question.detector,
            solver=question.solver,
            # Frames that were reduced again are not reduced a second time to be written.
            keep=question.save is not None and (question.detector or question.solver),
            on_frame=on_frame,
        )
        branch = None
        if question.save is not None:
            branch = save_branch(found, question.save, force=question.force)
    except (RsoconsoleError, OSError) as error:
        return no_answer(question, str(error))
    return Answer(
        changes=dict(found.changes),
        before=dict(found.before),
        recorded=found.recorded,
        what_if=found.what_if,
        is_reproduced=found.is_reproduced,
        rerun=found.rerun,
        branch=branch,
    )


def no_answer(question: Question, reason: str) -> Answer:
    """For a question that came to nothing."""
    return Answer(changes=dict(question.changes), error=reason)
