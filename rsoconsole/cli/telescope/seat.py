"""The verb console."""

from pathlib import Path
from typing import Annotated

import typer

from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.options import GraphicsOption, SocketOption
from rsoconsole.instruments import stop_past_engine
from rsoconsole.words import ENGINE_ENDS


def console(
    session: Annotated[
        Path | None,
        typer.Option(
            help="Show this session's folder, read-only, without an engine.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Only look; STOP works all the same.")
    ] = False,
    graphics: GraphicsOption = None,
    socket: SocketOption = None,
) -> None:
    """The operator's console: attaches to the running engine and shows its whole night.

    Leaving it, or losing it, changes nothing for the telescope.

    x or ctrl+x is STOP, q leaves, F1 shows every other key, ctrl+p finds each
    action by its name; a keymap.toml beside the configuration gives actions
    other keys. Works from 40 x 12 on, at its best from 80 x 24; NO_COLOR=1 is
    heeded, ctrl+t changes the colours (night: red only). Pictures are drawn by
    the terminal's own graphics, or by the finest characters that it draws;
    --graphics chooses.

    Example: rsoconsole console
    """
    from rsoconsole.console import run_console

    ending = run_console(
        socket=socket,
        session=session,
        read_only=read_only,
        stop_directly=stop_past_engine,
        graphics=graphics,
    )
    if ending == "stop engine":
        output.complain(ENGINE_ENDS)
