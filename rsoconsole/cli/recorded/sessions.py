"""The verb sessions: lists, verifies, repairs, archives and prunes recorded sessions."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer

from rsoconsole.base import SessionError
from rsoconsole.cli.words import completion, output, sessions_words
from rsoconsole.cli.words.batch_options import byte_progress
from rsoconsole.cli.words.options import ConfigOption, JsonOption, SessionsArgument
from rsoconsole.config import load_config

BYTES_A_GB = 1e9

sessions_app = typer.Typer(invoke_without_command=True)
RootOption = Annotated[
    Path | None, typer.Option(help="Folder of the sessions, if not session.root.")
]


@sessions_app.callback()
def sessions(
    context: typer.Context,
    root: RootOption = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """List recorded sessions, one a line: begin, length, frames, share followed, size.

    The share is the fraction of frames in which the followed object was measured.
    "cut off" means that the engine ended without closing the session: nothing that was
    acknowledged is lost, and 'rsoconsole sessions repair' closes it. Rescue sessions,
    which continue a session that could not be written, come last and name it.

    Example: rsoconsole sessions --root /media/usb/sessions
    """
    if context.invoked_subcommand is not None:
        if root is not None or config is not None or json_:
            raise typer.BadParameter(f"give options behind the verb: {context.invoked_subcommand}")
        return
    list_(root, config, json_=json_)


@sessions_app.command("list")
def list_(
    root: RootOption = None, config: ConfigOption = None, *, json_: JsonOption = False
) -> None:
    """List recorded sessions: the same as 'rsoconsole sessions' alone.

    Example: rsoconsole sessions list --json
    """
    from rsoconsole.session import find_rescues, list_sessions, summarise

    folder = _root(root, config)
    found = list_sessions(folder)
    own = {each.folder.resolve() for each in found}
    rescues = (each for each in find_rescues() if each.resolve() not in own)
    # One that does not say of which session it is a rescue is listed everywhere.
    found += tuple(
        each
        for each in map(summarise, rescues)
        if root is None or each.rescues is None or each.rescues.resolve().parent == root.resolve()
    )
    if found and not json_:
        output.say(sessions_words.HEADER)
    for each in found:
        schemas = sessions_words.schema_keys(each.schema)
        output.print_answer(json_, each, sessions_words.summary_words, **schemas)
    if not found:
        output.print_to_stderr(f"no session is kept in {folder}")


@sessions_app.command()
def verify(
    places: Annotated[
        list[Path],
        typer.Argument(
            metavar="SESSION...",
            help="Sessions' folders, or their archives (.tar).",
            autocompletion=completion.sessions,
        ),
    ],
    *,
    json_: JsonOption = False,
) -> None:
    """Verify that sessions are as written: database, log and every file are read.

    The log is compared with the digest it was closed with, every file with its
    hash; each finding says where it is and what to do. Nothing is changed.
    Exit 1 when anything is damaged; a session that was cut off is not damaged.

    Example: rsoconsole sessions verify NIGHT NIGHT.tar
    """
    from rsoconsole.session import verify_session

    def verified(place: Path) -> bool:
        with byte_progress() as report:
            found = verify_session(place, lambda done, total: report("verifying", done, total))
        schemas = sessions_words.schema_keys(found.schema)
        output.print_answer(json_, found, sessions_words.verification_lines, **schemas)
        return found.is_sound

    _each(places, verified, "not sound", json_)


@sessions_app.command()
def repair(places: SessionsArgument, *, json_: JsonOption = False) -> None:
    """Repair a session after a loss of power, or save what is readable of a damaged one.

    Closes the session with the digest of its log, adds complete frame files that the
    log does not have yet, and removes half-written files. No record is changed. A
    damaged database stays as it is: what can be read of it goes into a new session
    beside it, NAME.recovered. A rescue session is merged into its session, read
    back, and only then removed. On a repaired session the verb does nothing.

    Example: rsoconsole sessions repair NIGHT
    """
    from rsoconsole.session import repair_session

    def repaired(place: Path) -> bool:
        output.print_answer(
            json_, repair_session(place, time.time_ns()), sessions_words.repair_lines
        )
        return True

    _each(places, repaired, "not repaired", json_)


@sessions_app.command()
def archive(
    places: SessionsArgument,
    *,
    out: Annotated[
        Path | None, typer.Option(help="Where the archive goes; default: beside the session.")
    ] = None,
    remove: Annotated[
        bool, typer.Option("--remove", help="Remove the original once the archive is verified.")
    ] = False,
    json_: JsonOption = False,
) -> None:
    """Pack sessions into one plain tar each, with the hash of every file in it.

    The session is verified first, the archive is read back afterwards; only then
    is the original removed, and only with --remove. 'tar xf' restores the session;
    'sha256sum -c MANIFEST.sha256' and 'sessions verify' check it.

    Example: rsoconsole sessions archive NIGHT --out /media/usb --remove
    """
    from rsoconsole.session import archive_session

    def archived(place: Path) -> bool:
        target = place.resolve().parent if out is None else out
        with byte_progress() as report:
            made = archive_session(place, target, time.time_ns(), remove=remove, on_bytes=report)
        output.print_answer(json_, made, sessions_words.archive_words)
        return True

    _each(places, archived, "not archived", json_)


@sessions_app.command()
def prune(
    *,
    keep_days: Annotated[
        float | None, typer.Option(min=0, help="Leave sessions younger than this, in days.")
    ] = None,
    keep_last: Annotated[
        int | None, typer.Option(min=0, help="Number of newest sessions to leave.")
    ] = None,
    free: Annotated[
        float | None,
        typer.Option(min=0, metavar="GB", help="The oldest first, until so much disk is free."),
    ] = None,
    what: Annotated[
        Literal["frames", "previews", "all"],
        typer.Option(help="What goes; the log stays for ever, but with all."),
    ] = "frames",
    with_branches: Annotated[
        bool, typer.Option("--with-branches", help="Also sessions with a what-if branch.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do it; else it is only shown.")] = False,
    root: RootOption = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Free disk space by rules: shows what would be removed, and removes it with --yes.

    Something of a session is removed only if every rule allows it. Never touched: live sessions,
    those that need a repair, those marked by 'sessions keep', and those with a what-if branch
    (but see --with-branches). Each removal is recorded in the session's upkeep.jsonl.

    Example: rsoconsole sessions prune --keep-days 30 --keep-last 5 --free 20
    """
    from rsoconsole.session import PruningPolicy, plan_pruning
    from rsoconsole.session import prune as prune_sessions

    if keep_days is None and keep_last is None and free is None:
        raise typer.BadParameter("say what may go: --keep-days, --keep-last or --free")
    folder = _root(root, config)
    policy = PruningPolicy(
        keep_days=keep_days,
        keep_last=keep_last,
        free_bytes=None if free is None else round(free * BYTES_A_GB),
        what=what,
        with_branches=with_branches,
    )
    now_utc_ns = time.time_ns()
    steps = plan_pruning(folder, policy, now_utc_ns)
    if yes:
        prune_sessions(steps, policy, now_utc_ns)
    for step in steps:
        output.print_answer(
            json_, step, sessions_words.pruning_step_words, what=what, is_done=yes and step.goes
        )
    if not json_:
        sessions_words.print_pruning_total(steps, folder, what, yes)


@sessions_app.command()
def keep(
    places: SessionsArgument,
    *,
    why: Annotated[str, typer.Option(help="Why, for anyone who finds the mark.")] = "",
    release: Annotated[bool, typer.Option("--release", help="Take the mark away again.")] = False,
) -> None:
    """Mark sessions so that 'sessions prune' never touches them: a file KEEP in the folder.

    Example: rsoconsole sessions keep NIGHT --why "first light"
    """
    from rsoconsole.session import SessionReader
    from rsoconsole.session.files import upkeep_log as upkeep

    for place in places:
        SessionReader(place)
        upkeep.allow_pruning(place) if release else upkeep.protect_from_pruning(place, why)
        output.say(f"{place}: {'may be pruned' if release else 'kept'}")


def _each(places: list[Path], is_well: Callable[[Path], bool], what_else: str, json_: bool) -> None:
    """Work on sessions one after another; a fault of one does not stop the next.

    Exit 1 where one is not well, or cannot be worked on, which is said with its reason.
    """
    failed = 0
    for place in places:
        try:
            failed += not is_well(place)
        except SessionError as error:
            failed += 1
            output.report_fault(json_, str(error), session=place)
    output.exit_if(failed, f"{failed} {what_else}")


def _root(root: Path | None, config: Path | None) -> Path:
    return root if root is not None else load_config(config).session.root
