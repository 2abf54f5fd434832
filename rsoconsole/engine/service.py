"""Puts an engine together, runs it, and takes it apart in the right order."""

import contextlib
import importlib.metadata
import logging
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from rsoconsole.config import Config
from rsoconsole.control import ControlServer, default_socket_path
from rsoconsole.engine.desk import Desk
from rsoconsole.engine.doctor_system import read_clock
from rsoconsole.engine.hands import Hands
from rsoconsole.engine.intentions import Intentions
from rsoconsole.engine.loop import Engine
from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.connect import connect_instruments
from rsoconsole.instruments.ports import MountPort
from rsoconsole.pipeline.open import open_reducer
from rsoconsole.pipeline.reduce import Reduction
from rsoconsole.session.store import new_session_folder
from rsoconsole.session.writer import SessionWriter

log = logging.getLogger(__name__)

VERSIONS_OF = ("rsoconsole", "ai-edge-litert", "astrometry", "numpy", "pyindi-client")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """How one engine is run."""

    title: str
    session: Path | None = None
    """None: a new folder under the configured root."""
    frames: int | None = None
    """None: until it is told to end."""
    is_armed: bool = False
    listens: bool = True
    """Whether it opens the control socket."""
    socket: Path | None = None


def run_engine(
    config: Config,
    settings: RunSettings,
    *,
    on_cycle: Callable[[Engine, Reduction], None] | None = None,
    on_start: Callable[[Path], None] | None = None,
) -> Path:
    """Run the telescope; returns the session's folder.

    SIGTERM and SIGINT are a safe stop: the mount stops, the session is closed. Raises
    InstrumentError, ModelError, SolverError, SessionError or ControlError before it starts.
    """
    intentions = Intentions()
    with contextlib.ExitStack() as stack:
        reducer, model_sha256 = stack.enter_context(open_reducer(config))
        instruments = stack.enter_context(connect_instruments(config))
        _agree_on_site(instruments.mount, config)
        now_ns = instruments.clock.now_utc_ns()
        folder = settings.session or new_session_folder(config.session.root, settings.title, now_ns)
        about = {
            "title": settings.title,
            "t_started_utc_ns": now_ns,
            "is_simulated": instruments.clock.is_simulated,
            "model_sha256": model_sha256,
            "clock_offset_s": None if instruments.clock.is_simulated else read_clock().offset_s,
            "versions": _versions(),
        }
        writer = SessionWriter.create(folder, config, about, on_fault=log.error)
        stack.callback(writer.close)
        hands = Hands(instruments, config, lambda: intentions.is_wanted)
        engine = Engine(
            config=config,
            hands=hands,
            reducer=reducer,
            record=writer,
            intentions=intentions,
            on_cycle=on_cycle,
        )
        if settings.listens:
            desk = Desk(engine, instruments.mount, intentions, lambda: writer.faults)
            path = settings.socket or default_socket_path()
            stack.enter_context(ControlServer(path, desk.handle))
        stack.enter_context(_signals(intentions))
        if on_start is not None:
            on_start(folder)
        if settings.is_armed:
            engine.arm("configuration")
        engine.run(settings.frames)
    return folder


def _agree_on_site(mount: MountPort, config: Config) -> None:
    """Tell the mount its site where it knows none; never overwrite another one unasked."""
    site = config.site.to_site()
    check = mount.check_site(site)
    if check.reported is None:
        mount.set_site(site)
    elif not check.is_consistent:
        raise InstrumentError(check.detail)


@contextlib.contextmanager
def _signals(intentions: Intentions) -> Iterator[None]:
    """SIGTERM and SIGINT end the engine safely, a lost line (SIGHUP) means nothing to it.

    Only the main thread may listen to signals. The handler sets a plain flag, which the loop
    sees within a second.
    """

    def end(_number: int, _frame: FrameType | None) -> None:
        intentions.request_shutdown()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    wanted: dict[int, Any] = {
        signal.SIGTERM: end,
        signal.SIGINT: end,
        signal.SIGHUP: signal.SIG_IGN,
    }
    before: dict[int, Any] = {
        number: signal.signal(number, handler) for number, handler in wanted.items()
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _versions() -> dict[str, str]:
    versions = {}
    for name in VERSIONS_OF:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions
