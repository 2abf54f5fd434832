"""Builds an engine from its parts, runs it, and closes the parts in the right order."""

import contextlib
import gc
import importlib.metadata
import logging
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

from rsoconsole.base import ConfigError, InstrumentError, SessionError, report_waits_to
from rsoconsole.config import Config
from rsoconsole.control import ControlServer, EngineLock, MountLock, default_socket_path
from rsoconsole.engine.aim.instrument_controller import InstrumentController, Interrupted
from rsoconsole.engine.alerts.process import AlertProcess
from rsoconsole.engine.doctor.doctor_system import read_clock
from rsoconsole.engine.doctor.mount_lacks import MissingAbility, missing_abilities
from rsoconsole.engine.loop.loop import Engine
from rsoconsole.engine.machine.machine import hide_notify_socket, notify_systemd
from rsoconsole.engine.machine.medium import disk_outlook
from rsoconsole.engine.operator.arming import (
    arming_checks,
    gather_facts,
    refusal_text,
    unknown_words,
)
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.engine.service.machine_watch import MachineWatch
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.engine.tasks.session_log import (
    WarningsOnRecord,
    keep_uncorrelated,
    read_earlier_tracks,
)
from rsoconsole.instruments import (
    Instruments,
    MountPort,
    client_library,
    connect_instruments,
    return_freed_blocks_at_once,
)
from rsoconsole.pipeline import Reduction, open_reducer, recorded_pixels
from rsoconsole.session import SessionWriter, find_cut_off_session, new_session_folder
from rsoconsole.sky import day_of
from rsoconsole.words import shutter_words

log = logging.getLogger(__name__)

START_AGAIN_US = 60_000_000
"""Time that is added to the service manager's wait while an engine reports why it waits, us."""
DEFINED_S = 2.0
VERSIONS_OF = ("rsoconsole", "ai-edge-litert", "astrometry", "numpy")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """Settings of one run of the engine."""

    title: str
    session: Path | None = None
    """Folder of the session; None: a new folder under the configured root."""
    frames: int | None = None
    """Number of frames after which the run ends; None: no such end."""
    is_armed: bool = False
    lifted: frozenset[str] = frozenset()
    listens: bool = True
    socket: Path | None = None


def run_engine(
    config: Config,
    settings: RunSettings,
    *,
    on_cycle: Callable[[Engine, Reduction], None] | None = None,
    on_start: Callable[[Path], None] | None = None,
) -> Path:
    """Run the engine until it is to end; return the session's folder.

    SIGTERM and SIGINT end it safely: the mount stops and the session is closed. Raises
    InstrumentError, ModelError, SolverError, SessionError or ControlError where it cannot start.
    """
    return_freed_blocks_at_once()
    hide_notify_socket()
    queue = CommandQueue()
    with contextlib.ExitStack() as stack:
        starting = stack.enter_context(contextlib.ExitStack())
        starting.enter_context(report_waits_to(_notify_service_manager))
        # Let go of last of all: a second SIGTERM must not cut the first one's safe end short.
        heed_signals = stack.enter_context(_signals(queue))
        path = settings.socket or default_socket_path()
        if settings.listens:
            # Before anything else: two engines must never speak to one mount.
            lock = stack.enter_context(EngineLock(path))
        mount_lock = stack.enter_context(MountLock(config.indi, path))
        reducer, model_sha256 = stack.enter_context(open_reducer(config))
        reducer.make_ready()
        instruments = stack.enter_context(connect_instruments(config))
        lacks, site_fault = _mount_faults(instruments.mount, config)
        now_ns = instruments.clock.now_utc_ns()
        cut_off = _cut_off_session(config, instruments)
        folder = settings.session or new_session_folder(config.session.root, settings.title, now_ns)
        about = {
            "title": settings.title,
            "t_started_utc_ns": now_ns,
            "is_simulated": instruments.clock.is_simulated,
            "model_sha256": model_sha256,
            "clock_offset_s": None if instruments.clock.is_simulated else read_clock().offset_s,
            "versions": _versions(config),
            "pid": os.getpid(),
            "continues": None if cut_off is None else str(cut_off),
        }
        writer = SessionWriter.create(folder, config, about, on_fault=log.error)
        past, past_fault = read_earlier_tracks(is_simulated=instruments.clock.is_simulated)
        if not instruments.clock.is_simulated:
            stack.callback(keep_uncorrelated, folder)  # behind the session's end
        alerts = stack.enter_context(_alerts(config, folder, instruments))  # it tells of the end
        stack.callback(writer.close)
        engine = Engine(
            config=config,
            instrument_controller=InstrumentController(
                instruments, config, lambda: queue.is_interrupt_wanted
            ),
            reducer=reducer,
            record=writer,
            queue=queue,
            on_cycle=on_cycle,
            pixels_of=partial(recorded_pixels, folder),
            past=past,
        )
        stack.enter_context(WarningsOnRecord(engine.session_log, "rsoconsole.instruments"))
        if config.exposure.calibrated:
            engine.session_log.say("info", shutter_words(config.exposure, day_of(now_ns)))
        _say_faults(
            engine,
            *(_cut_off_words(cut_off), site_fault, past_fault, alerts.fault),
            *(lack.text for lack in lacks),
        )
        _load_ahead(config)
        _say_outlook(engine, config, folder, now_ns)
        machine = MachineWatch(folder, partial(engine.session_log.say, topic="machine"))
        stack.callback(machine.close)
        machine.start()
        if settings.listens:
            command_handler = CommandHandler(
                engine,
                queue,
                folder,
                lambda: writer.faults,
                writer.flush,
                machine=lambda: machine.state,
                lacks=lacks,
            )
            stack.enter_context(
                ControlServer(
                    path,
                    command_handler.begin,
                    lock=lock,
                    stamp=lambda: queue.stops,
                    locks=(mount_lock,),
                    on_found=partial(engine.session_log.say, "warning"),
                )
            )
        alerts.start(engine.watch.is_loop_alive)
        heed_signals()
        starting.close()
        notify_systemd("READY=1")
        stack.callback(notify_systemd, "STOPPING=1")
        if on_start is not None:
            on_start(folder)
        if settings.is_armed:
            _arm(engine, settings, folder)
        engine.run(settings.frames)
        engine.leaping.forget("the run is over")
    return folder


@contextlib.contextmanager
def _alerts(config: Config, folder: Path, instruments: Instruments) -> Iterator[AlertProcess]:
    """Yield the process that sends alerts; it sends none where nothing is configured."""
    where = config.site.name + (" (simulated)" if instruments.clock.is_simulated else "")
    alerts = AlertProcess(config.alerts, folder, title=f"rsoconsole {where}")
    try:
        yield alerts
    finally:
        alerts.close()


def _cut_off_words(session: Path | None) -> str | None:
    if session is None:
        return None
    return (
        f"the engine before this one ended without closing its session {session.name}: it is kept"
        " as it is, this one goes on in a new session"
    )


def _say_faults(engine: Engine, *faults: str | None) -> None:
    for fault in faults:
        if fault is not None:
            engine.session_log.say("warning", fault)


def _notify_service_manager(words: str) -> None:
    """Extend the service manager's time limit: a slow start is none that hangs."""
    notify_systemd(f"STATUS={words}\nEXTEND_TIMEOUT_USEC={START_AGAIN_US}")


def _arm(engine: Engine, settings: RunSettings, folder: Path) -> None:
    """Arm at the start where the checklist allows it; a run of a given number of frames insists.

    Raises InstrumentError with what is missing when the run is bounded; else the engine reports it
    and waits to be armed.
    """
    if unknown := unknown_words(settings.lifted):
        raise ConfigError(unknown)
    checks = arming_checks(
        gather_facts(engine.instrument_controller.instruments, engine.config, folder), engine.config
    )
    refused = refusal_text(checks, settings.lifted)
    if refused is None:
        with contextlib.suppress(Interrupted):  # the engine is to end already
            engine.arm("configuration", settings.lifted)
    elif settings.frames is not None:
        raise InstrumentError(refused)
    else:
        engine.session_log.say("alarm", refused)


def _say_outlook(engine: Engine, config: Config, folder: Path, now_ns: int) -> None:
    with contextlib.suppress(OSError):
        outlook = disk_outlook(config, shutil.disk_usage(folder).free, now_ns)
        if outlook.warning is not None:
            engine.session_log.say("warning", outlook.warning)


def _cut_off_session(config: Config, instruments: Instruments) -> Path | None:
    """Return the last session of this telescope where its engine did not live to close it."""
    try:
        return find_cut_off_session(
            config.session.root, is_simulated=instruments.clock.is_simulated
        )
    except SessionError as error:
        log.warning("%s", error)
        return None


def _load_ahead(config: Config) -> None:
    """Load in the background what would delay the first frame with two satellites by a second.

    What is loaded by now stays for good: no collection walks through it at each frame.
    """
    if config.filter.uses_filter_bank and config.filter.most_tracks > 1:
        name = "scipy.optimize"
        threading.Thread(target=import_module, args=(name,), daemon=True, name=name).start()
    gc.freeze()


def _mount_faults(
    mount: MountPort, config: Config
) -> tuple[tuple[MissingAbility, ...], str | None]:
    """Return the abilities that the mount's driver lacks, and the fault of its site."""
    return _mount_lacks(mount, config), _site_fault(mount, config)


def _mount_lacks(mount: MountPort, config: Config) -> tuple[MissingAbility, ...]:
    """Return the abilities that the driver lacks; a newly connected one defines them bit by bit."""
    ends_s = time.monotonic() + DEFINED_S
    while lacks := missing_abilities(mount.abilities(), config.mount):
        if time.monotonic() > ends_s:
            break
        time.sleep(DEFINED_S / 10.0)
    return lacks


def _site_fault(mount: MountPort, config: Config) -> str | None:
    """Return the fault of the mount's site; one without a site is given ours, never overwritten.

    A driver that accepts no site has its own, or needs none.
    """
    site = config.site.to_site()
    check = mount.check_site(site)
    if check.reported is None:
        if mount.abilities().has_site:
            try:
                mount.set_site(site)
            except InstrumentError as error:
                return f"the mount does not tell its site and takes none: {error}"
        return None
    if check.is_consistent:
        return None
    return f"{check.detail}; 'rsoconsole doctor' tells how, until then arming is refused"


@contextlib.contextmanager
def _signals(queue: CommandQueue) -> Iterator[Callable[[], None]]:
    """Make SIGTERM and SIGINT end the engine safely, and a lost line (SIGHUP) have no effect.

    This begins when the yielded function is called and lasts until the context ends; before, they
    end the process as usual. Only the main thread may handle signals. The handler sets a plain
    flag, which the loop sees within a second.
    """

    def end(_number: int, _frame: FrameType | None) -> None:
        queue.request_shutdown()

    wanted: dict[int, Any] = {
        signal.SIGTERM: end,
        signal.SIGINT: end,
        signal.SIGHUP: signal.SIG_IGN,
    }
    before: dict[int, Any] = {}

    def heed() -> None:
        if threading.current_thread() is threading.main_thread():
            before.update({number: signal.signal(number, wanted[number]) for number in wanted})

    try:
        yield heed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _versions(config: Config) -> dict[str, str]:
    versions = {}
    names = [*VERSIONS_OF]
    with contextlib.suppress(InstrumentError):
        names.append(client_library(config.indi.client).package)
    for name in names:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions
