"""Opens the console over the running engine, or over one session."""

import gc
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.base import ControlError, RsoconsoleError
from rsoconsole.config import Config, Graphics, default_config_path, load_config, state_dir
from rsoconsole.control import AskStatus, ControlClient, Sender, default_socket_path, engine_pid
from rsoconsole.session import SessionReader

if TYPE_CHECKING:
    from rsoconsole.console.app import StopDirectly

ATTACH_S = 10.0
"""Most seconds to wait for an engine's answer: it may be on a busy machine."""


def run_console(
    *,
    socket: Path | None = None,
    session: Path | None = None,
    read_only: bool = False,
    owns_engine: bool = False,
    stop_directly: "StopDirectly | None" = None,
    graphics: Graphics | None = None,
) -> str:
    """Open the console, and when it is left return "quit" or "stop engine".

    ``socket``: path of the engine's socket; None: the default one.
    ``session``: folder of a session to show instead, read-only and as it grows, without an engine.
    ``read_only``: True where no command but STOP may be sent.
    ``owns_engine``: True where the engine has just been started, so that it is waited for.
    ``stop_directly``: stops the mount if the engine does not; its argument is the session's INDI
        settings, or None.
    ``graphics``: how to draw pictures; None: as configured.

    Raises ControlError when there is no engine, ConfigError for an invalid keymap, SessionError
    when ``session`` holds none, RsoconsoleError where there is no terminal.
    """
    config, keymap = load_config(), _keymap()
    if session is not None:
        SessionReader(session)
    elif not owns_engine:
        _require_engine(socket)
    _require_terminal("'rsoconsole status' and 'rsoconsole stop' work without one")
    from rsoconsole.console.dialogs.tour import TourMemory

    seat = _seat()
    return _run(
        config,
        socket,
        seat,
        graphics,
        session=session,
        read_only=read_only,
        stop_directly=stop_directly,
        keymap=keymap,
        seat_name=seat.name,
        tour=TourMemory(state_dir()),
    )


def run_review(
    session: Path | None,
    *,
    start: str = "",
    socket: Path | None = None,
    stop_directly: "StopDirectly | None" = None,
    graphics: Graphics | None = None,
) -> None:
    """Open a review and stay until it is left.

    ``session``: None: the review asks for one.
    ``start``: the frame or UTC time to show first; empty: the first frame.
    ``socket``: the engine's, to which STOP is sent; nothing else is asked of it.
    ``stop_directly``: stops the mount where the engine does not.
    ``graphics``: how to draw pictures; None: as configured.

    Raises ConfigError for an invalid keymap, SessionError when ``session`` holds none,
    RsoconsoleError where there is no terminal.
    """
    config, keymap = load_config(), _keymap()
    if session is not None:
        SessionReader(session)
    _require_terminal("'rsoconsole export' and 'rsoconsole figures' work without one")
    review = (session, start)
    _run(
        config, socket, _seat(), graphics, review=review, stop_directly=stop_directly, keymap=keymap
    )


def _keymap() -> dict[str, str]:
    from rsoconsole.console.commands.keymap import load_keymap

    return load_keymap(default_config_path().with_name("keymap.toml"))


def _run(
    config: Config, socket: Path | None, seat: Sender, graphics: Graphics | None, **more: Any
) -> str:
    """Run the application to its end, in a process of its own; return its result.

    ``more``: further arguments of ``ConsoleApp``.
    """
    from rsoconsole.console.app import ConsoleApp
    from rsoconsole.console.commands.key_parser import install_parser
    from rsoconsole.console.picture.graphics import choose_drawing_mode

    drawn = choose_drawing_mode(graphics or config.console.graphics)
    app = ConsoleApp(
        lambda: ControlClient(socket, sender=seat),
        settings=config.console,
        sessions_root=config.session.root,
        graphics=drawn.graphics,
        blocks=drawn.blocks,
        **more,
    )
    install_parser()
    # Under nohup it would be ignored, and a console without a terminal would stay for ever.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    # What the libraries have made stays for good: a collection that walks all of it again and
    # again would hold up the effect of a key for a tenth of a second.
    gc.freeze()
    ending = app.run()
    if app.failure is not None:
        raise app.failure
    return ending or "quit"


def _require_terminal(without: str) -> None:
    """Raise RsoconsoleError where nothing can be drawn; Textual draws on stderr.

    ``without``: words on what works without a terminal.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty() and sys.stderr.isatty()):
        raise RsoconsoleError(
            f"the console needs a terminal for input, output and errors: {without}"
        )
    if os.environ.get("TERM", "") in {"dumb", "unknown"}:
        raise RsoconsoleError(
            f"a terminal of type {os.environ['TERM']!r} can draw no screen: {without}"
        )


def _seat() -> Sender:
    """Return this console's operator and terminal, by which other consoles name it."""
    try:
        terminal = os.ttyname(sys.stdin.fileno()).removeprefix("/dev/")
    except OSError:
        terminal = str(os.getpid())
    return Sender.at(terminal)


def _require_engine(socket: Path | None) -> None:
    try:
        outcome = ControlClient(socket, sender=Sender(name="console")).send(
            AskStatus(), timeout_s=ATTACH_S
        )
    except ControlError as error:
        is_absent = isinstance(error.__cause__, FileNotFoundError | ConnectionRefusedError)
        if is_absent and engine_pid(socket or default_socket_path()) is None:
            raise ControlError(
                "no engine is running: start one with 'rsoconsole engine', or 'rsoconsole demo' "
                "for a simulated night; --session DIR shows a recorded one"
            ) from error
        raise
    if not outcome.ok:
        raise ControlError(outcome.message)
