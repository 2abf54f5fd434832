"""The verb review: a recorded night, moment by moment."""

from pathlib import Path
from typing import Annotated

import typer

from rsoconsole.cli.words import completion
from rsoconsole.cli.words.options import GraphicsOption, SocketOption
from rsoconsole.cli.words.usage import as_usage_error
from rsoconsole.config import load_config
from rsoconsole.instruments import stop_without_engine


def review(
    session: Annotated[
        Path | None,
        typer.Argument(
            help="A session's folder, or its name under session.root; without it: choose from a "
            "list.",
            autocompletion=completion.session_names,
            show_default=False,
        ),
    ] = None,
    at: Annotated[
        str, typer.Option(metavar="FRAME|UTC", help="Begin there: 128, 03:14 or 03:14:22.")
    ] = "",
    graphics: GraphicsOption = None,
    sample: Annotated[
        bool,
        typer.Option(
            "--sample", help="The sample session that comes with the program, copied to yours."
        ),
    ] = False,
    socket: SocketOption = None,
) -> None:
    """Look through a recorded night: the console's screen as it was at any moment.

    The line at the bottom is the night; a click goes to any moment of it. space
    plays, [ ] changes the speed, , . steps by frame, < > jumps to the next miss,
    rejection, loss, action, note or alarm (E chooses which), g goes to a frame
    or a UTC time, K keeps a moment and compares it with another, B blinks
    between the two, / searches the log, t tries other settings on what was
    recorded, r lists the sessions, F1 shows every key, q leaves.

    Nothing that was recorded is changed. A running night can be reviewed
    too, here or by r in its console; STOP (x) works there as always.

    Example: rsoconsole review sessions/intelsat-14 --at 12

    Example: rsoconsole review --sample
    """
    from rsoconsole.console import parse_place, run_review

    if at:
        with as_usage_error("--at"):
            parse_place(at)
    if sample:
        if session is not None:
            raise typer.BadParameter("--sample is a session itself: leave the other one out")
        from rsoconsole.session import get_or_copy_sample_session

        session = get_or_copy_sample_session(load_config().session.root)
    if session is not None and not session.exists() and len(session.parts) == 1:
        named = load_config().session.root / session
        session = named if named.exists() else session
    run_review(
        session, start=at, socket=socket, stop_directly=stop_without_engine, graphics=graphics
    )
