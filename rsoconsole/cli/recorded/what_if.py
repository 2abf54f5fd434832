"""The verb what-if: a recorded session with different settings, and a proposal of Q and R."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import (
    NoDaskOption,
    SchedulerOption,
    SerialOption,
    WorkersOption,
    progress_bar,
    resolved_paths,
)
from rsoconsole.cli.words.options import (
    JsonOption,
    PresetOption,
    SessionsArgument,
    TauOption,
    number_or_text,
)
from rsoconsole.words import settings_words, utc_ns_to_iso

if TYPE_CHECKING:
    from rsoconsole.pipeline import BatchWhatIf, Branch, WorkerPool

SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME VALUE",
        help="Any setting of 'config show', also as NAME=VALUE; may be repeated.",
        autocompletion=completion.setting_names,
    ),
]
SHARED_FROM = 8
"""Number of sessions from which running the filter alone is worth several processes."""


class SetOptionCommand(TyperCommand):
    """Command with a repeatable ``--set NAME VALUE``, which typer itself does not allow."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Join each ``--set NAME VALUE`` to NAME=VALUE, then parse the command line."""
        joined: list[str] = []
        rest = iter(args)
        for arg in rest:
            joined.append(arg)
            if arg == "--set" and "=" not in (name := next(rest, "")):
                joined.append(f"{name}={next(rest, '')}")
            elif arg == "--set":
                joined.append(name)
        return super().parse_args(ctx, joined)


def what_if(
    sessions: SessionsArgument,
    *,
    tau: TauOption = None,
    q: Annotated[float | None, typer.Option("--q", help="Factor on Q.")] = None,
    r: Annotated[float | None, typer.Option("--r", help="Factor on R.")] = None,
    sigma: Annotated[
        float | None, typer.Option(help="Sigma of preset paper, in arcseconds.")
    ] = None,
    gate: Annotated[float | None, typer.Option(help="NIS above which nothing is taken.")] = None,
    preset: PresetOption = None,
    set_: SetOption = None,
    detector: Annotated[
        bool, typer.Option("--detector", help="Detect again in the frames that were kept.")
    ] = False,
    solver: Annotated[
        bool, typer.Option("--solver", help="Plate-solve again the frames that were kept.")
    ] = False,
    propose: Annotated[
        bool, typer.Option("--propose", help="Seek the likeliest Q and R, with the evidence.")
    ] = False,
    save: Annotated[
        str | None, typer.Option(metavar="NAME", help="Keep the result as a branch of the session.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a branch of that name.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="Show the session's branches.")] = False,
    drop: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Delete a branch of the session.",
            autocompletion=completion.branches,
        ),
    ] = None,
    workers: WorkersOption = None,
    serial: SerialOption = False,
    scheduler: SchedulerOption = None,
    no_dask: NoDaskOption = False,
    json_: JsonOption = False,
) -> None:
    """Compute a recorded night with other settings; the record stays as it is.

    The filter runs again over the measurements; --detector, --solver over kept frames.
    Example: rsoconsole what-if sessions/intelsat-14 --q 4 --r 0.5 --save calmer

    --propose seeks Q and R by the likelihood of the innovations, of several sessions together.
    Example: rsoconsole what-if sessions/intelsat-14 --propose

    A branch lies in SESSION/branches/NAME and can be shown, drawn and exported like a session.
    """
    from rsoconsole.pipeline import BatchWhatIf, choose_pool

    named = {
        "detector.tau": tau,
        "filter.q_multiplier": q,
        "filter.r_multiplier": r,
        "filter.sigma_arcsec": sigma,
        "filter.gate_nis": gate,
        "filter.preset": preset,
    }
    changes: dict[str, float | str] = {k: v for k, v in named.items() if v is not None}
    for pair in set_ or ():
        name, _, value = pair.partition("=")
        if not name or not value:
            raise typer.BadParameter("it takes a name and a value", param_hint="--set")
        changes[name] = number_or_text(value)
    if sum((bool(changes) or detector or solver, propose, list_, drop is not None)) > 1:
        raise typer.BadParameter("--propose, --list, --drop and settings to try exclude each other")
    if (list_ or drop is not None) and len(sessions) > 1:
        raise typer.BadParameter("--list and --drop look at one session")
    if list_:
        _list_branches(sessions[0], json_)
        return
    if drop is not None:
        _drop_branch(sessions[0], drop, json_)
        return
    if propose:
        _propose(sessions, save, json_, force=force)
        return
    questions = [
        BatchWhatIf(
            session=path, changes=changes, detector=detector, solver=solver, save=save, force=force
        )
        for path in sessions
    ]
    is_shared = detector or solver or workers is not None or len(sessions) >= SHARED_FROM
    pool = choose_pool(
        len(sessions),
        workers=workers,
        scheduler=scheduler,
        is_serial=serial or not is_shared,
        is_dask_wanted=not no_dask,
    )
    _answer(questions, pool, json_)


def _answer(questions: "list[BatchWhatIf]", pool: "WorkerPool", json_: bool) -> None:
    from dataclasses import replace

    from rsoconsole.cli.words.what_if_words import what_if_lines
    from rsoconsole.pipeline import failed_what_if, run_tasks, run_what_if

    failures = 0
    is_alone = len(questions) == 1
    if is_alone and (questions[0].detector or questions[0].solver):
        with progress_bar("frames looked through") as on_frame:
            answers = [run_what_if(questions[0], on_frame)]
    else:
        paths = resolved_paths([each.session for each in questions])
        whole = [replace(q, session=path) for q, path in zip(questions, paths, strict=True)]
        with progress_bar("sessions", len(questions)) as on_done:
            found_of = run_tasks(
                run_what_if, whole, pool, failed=failed_what_if, paths=paths, on_done=on_done
            )
            answers = list(found_of)
    for question, found in zip(questions, answers, strict=True):
        shown = str(question.session)
        if found.error is not None:
            failures += 1
            output.report_fault(json_, found.error, session=shown)
        else:
            output.print_answer(json_, found, partial(what_if_lines, shown), session=shown)
    output.exit_if(failures)


def _propose(sessions: list[Path], save: str | None, json_: bool, *, force: bool) -> None:
    from rsoconsole.cli.words.what_if_words import proposal_lines
    from rsoconsole.pipeline import new_branch_folder, propose, save_branch, what_if_session

    if save is not None:
        for session in sessions:
            new_branch_folder(session, save, force=force)
    with progress_bar("filter run") as on_evaluation:
        found = propose(sessions, on_evaluation=on_evaluation)
    effects = [what_if_session(folder, found.changes) for folder in found.sessions]
    branches: list[Path] = []
    if save is not None and found.changes:
        branches = [save_branch(effect, save, force=force) for effect in effects]
    if json_:
        figures = [
            {"session": each.session, "recorded": each.recorded, "what_if": each.what_if}
            for each in effects
        ]
        output.emit_json(found, branches=branches, effects=figures)
        return
    output.say(*proposal_lines(found, effects), *(f"  kept as {folder}" for folder in branches))
    if save is not None and not branches:
        output.say("  nothing is proposed that could be kept")


def _list_branches(session: Path, json_: bool) -> None:
    from rsoconsole.pipeline import branches_of
    from rsoconsole.session import SessionReader

    SessionReader(session)  # says so where it is none
    for branch in branches_of(session):
        output.print_answer(json_, branch, _branch_line, session=session)


def _branch_line(branch: "Branch") -> str:
    made = branch.t_made_utc_ns
    changes = settings_words(branch.changes)
    when = "" if made is None else f"{utc_ns_to_iso(made, 0)}  "
    return f"{branch.name:20} {when}{branch.fault or changes or 'nothing tried'}"


def _drop_branch(session: Path, name: str, json_: bool) -> None:
    from rsoconsole.pipeline import drop_branch

    folder = drop_branch(session, name)
    found = {"session": str(session), "dropped": name, "folder": str(folder)}
    output.print_answer(json_, found, lambda _: f"{folder} is deleted")
