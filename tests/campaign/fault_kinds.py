"""What can befall a night: each kind does its harm, and mends what a person would mend.

After a kind has returned the engine gets no more help than arming, and a restart where it is gone.
"""

import contextlib
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from rsoconsole.instruments import IndiWire
from tests.campaign.fault_night import FaultNight, Row
from tests.rigs.stop_situations import full_disk
from tests.rigs.whole_engine import COMMAND, OVERRIDES, wait_for

Kind = Callable[[FaultNight, Row], None]
_LONG_STOP_S = 3.0
_GARBAGE_BYTES = 400


def _kill(child: str) -> Kind:
    def kill(night: FaultNight, _row: Row) -> None:
        pid = night.engine.child(child)
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    return kill


def _suspend(child: str) -> Kind:
    def suspend(night: FaultNight, row: Row) -> None:
        pid = night.engine.child(child)
        if pid is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGSTOP)
        time.sleep(night.random.uniform(0.5, _LONG_STOP_S))
        night.look(row)
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    return suspend


def engine_suspended(night: FaultNight, _row: Row) -> None:
    """SIGSTOP of the engine alone."""
    os.kill(night.pid, signal.SIGSTOP)
    time.sleep(night.random.uniform(0.5, _LONG_STOP_S))
    os.kill(night.pid, signal.SIGCONT)


def all_suspended(night: FaultNight, _row: Row) -> None:
    """The engine and its children, as of a machine that sleeps."""
    family = night.family()
    for sign in (signal.SIGSTOP, signal.SIGCONT):
        for pid in family:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, sign)
        if sign == signal.SIGSTOP:
            time.sleep(night.random.uniform(0.5, 2.0 * _LONG_STOP_S))


def engine_killed(night: FaultNight, _row: Row) -> None:
    """kill -9."""
    night.engine.kill()


def engine_ended(night: FaultNight, row: Row) -> None:
    """SIGTERM at any instant: a safe end, exit status 0."""
    assert night.engine.process is not None
    night.engine.process.send_signal(signal.SIGTERM)
    try:
        code = night.engine.process.wait(30)
    except subprocess.TimeoutExpired:
        row.wrong.append("the engine did not end within 30 s of SIGTERM")
        night.engine.kill()
        return
    if code != 0:
        row.wrong.append(f"ended by SIGTERM with {code}")


def wire_cut(night: FaultNight, _row: Row) -> None:
    """Every connection to the INDI server breaks."""
    night.wire.cut()


def server_away(night: FaultNight, row: Row) -> None:
    """And for some seconds nobody takes a new one."""
    night.wire.cut(away_s=night.random.uniform(1.0, 5.0))
    night.look(row)


def wire_stalled(night: FaultNight, row: Row) -> None:
    """Nothing arrives any more, and nothing breaks."""
    for_s = night.random.uniform(1.0, 6.0)
    night.wire.stall(for_s)
    night.look(row)
    time.sleep(for_s)


def wire_slow(night: FaultNight, _row: Row) -> None:
    """Everything comes in crumbs."""
    for_s = night.random.uniform(0.5, 2.0)
    night.wire.trickle(for_s)
    time.sleep(for_s)


def _garbage(night: FaultNight) -> bytes:
    return night.random.randbytes(_GARBAGE_BYTES)


def wire_garbage(night: FaultNight, _row: Row) -> None:
    """Random bytes within the stream."""
    noise = _garbage(night)
    night.wire.spoil(lambda chunk: chunk[: len(chunk) // 2] + noise + chunk[len(chunk) // 2 :])


def wire_hostile(night: FaultNight, _row: Row) -> None:
    """Well-formed nonsense: unknown devices, endless names, numbers that are none."""
    text = (
        b'<setNumberVector device="Telescope Simulator" name="EQUATORIAL_EOD_COORD" state="Ok">'
        b'<oneNumber name="RA">nan</oneNumber><oneNumber name="DEC">1e999</oneNumber>'
        b'</setNumberVector><defTextVector device="' + b"x" * 5000 + b'" name="y" perm="rw"'
        b' state="Idle"><defText name="z">' + b"\x1b]52;c;eA==\x07".hex().encode() + b"</defText>"
        b"</defTextVector>"
    )
    night.wire.spoil(lambda chunk: chunk + text if chunk.endswith(b">\n") else chunk)


def frame_cut(night: FaultNight, _row: Row) -> None:
    """A frame ends in the middle, and the connection with it."""
    night.wire.spoil_frame(lambda chunk: chunk[: len(chunk) // 3])
    time.sleep(0.3)
    night.wire.cut()


def frame_spoilt(night: FaultNight, _row: Row) -> None:
    """Some bytes of a frame are others."""
    at, noise = night.random.random(), night.random.randbytes(40).hex().encode()

    def spoil(chunk: bytes) -> bytes:
        begin = int(at * max(len(chunk) - len(noise), 0))
        return chunk[:begin] + noise[: len(chunk) - begin] + chunk[begin + len(noise) :]

    night.wire.spoil_frame(spoil)


def frame_short(night: FaultNight, _row: Row) -> None:
    """A piece of a frame is missing."""
    night.wire.spoil_frame(lambda chunk: chunk[: len(chunk) // 2] + chunk[len(chunk) // 2 + 999 :])


def _mount(night: FaultNight, **faults: float) -> None:
    wire = IndiWire(night.sky.host, night.sky.port)
    try:
        values = {name: repr(float(value)) for name, value in faults.items()}
        wire.new("Number", night.sky.mount_name, "SIM_FAULTS", values)
        time.sleep(0.05)
    finally:
        wire.close()


def mount_silent(night: FaultNight, row: Row) -> None:
    """The driver hangs for some seconds: STOP cannot be answered, and that is said."""
    _mount(night, IS_SILENT=1)
    night.look(row)
    if night.random.random() < 0.5:
        outcome = night.ask("stop")
        if outcome.data.get("is_answered") is True or outcome.data.get("motion") is not None:
            row.wrong.append("STOP answered by a mount that says nothing")
    time.sleep(night.random.uniform(0.5, _LONG_STOP_S))
    _mount(night, IS_SILENT=0)


def slews_ignored(night: FaultNight, _row: Row) -> None:
    """The mount passes over the next slews."""
    _mount(night, IGNORED_SLEWS=night.random.randint(1, 3))


def abort_ignored(night: FaultNight, row: Row) -> None:
    """The mount passes over an abort: STOP sends another."""
    _mount(night, IGNORED_ABORTS=1)
    night.stop(row, is_delayed=True)
    night.measure(row)
    _mount(night, IGNORED_ABORTS=0)


def tracking_returns(night: FaultNight, row: Row) -> None:
    """A driver that turns tracking off with every abort."""
    _mount(night, ABORT_ENDS_TRACKING=1)
    night.stop(row, is_delayed=True)
    night.measure(row)
    _mount(night, ABORT_ENDS_TRACKING=0)


def moved_by_another(night: FaultNight, _row: Row) -> None:
    """Another program slews the mount."""
    night.ear.slew()


def disk_full(night: FaultNight, row: Row) -> None:
    """No file of the engine grows; nothing is acknowledged that is not on disk."""
    with full_disk(night.engine):
        time.sleep(0.2)
        night.note()
        night.look(row)


def descriptors_gone(night: FaultNight, row: Row) -> None:
    """The engine may open no file more, for a moment."""
    before = resource.prlimit(night.pid, resource.RLIMIT_NOFILE)
    now = len(list(Path(f"/proc/{night.pid}/fd").iterdir()))
    resource.prlimit(night.pid, resource.RLIMIT_NOFILE, (now, before[1]))
    try:
        night.note()
        night.look(row)
        time.sleep(0.5)
    finally:
        resource.prlimit(night.pid, resource.RLIMIT_NOFILE, before)


def _log_of(night: FaultNight) -> Path:
    session = night.ask("status").data.get("session")
    return Path(str(session or night.engine.session))


def _lost(harm: Callable[[Path], None], *, with_all: bool) -> Kind:
    """``with_all``: what the log holds is gone with it, not only its name."""

    def lose(night: FaultNight, row: Row) -> None:
        if with_all:
            night.destroy()
        harm(_log_of(night))

        def is_named() -> bool:
            return bool(night.ask("status").data["faults"])

        try:
            wait_for(is_named, "a word on the lost record", 5.0)
        except AssertionError:
            row.wrong.append("status names no fault of the record")
        night.note()
        # A session of its own again.
        night.engine.kill()

    return lose


def _remove(folder: Path) -> None:
    for path in folder.glob("session.db*"):
        path.unlink()


def _cut_short(folder: Path) -> None:
    os.truncate(folder / "session.db", 4096)


def _write_over(folder: Path) -> None:
    with (folder / "session.db").open("r+b") as file:
        file.write(b"\xa5" * 20_000)


def runtime_folder_gone(night: FaultNight, row: Row) -> None:
    """As a logout does: the engine is found again, and no second one starts."""
    shutil.rmtree(night.engine.socket.parent)
    time.sleep(night.random.uniform(0.0, 1.0))
    code, took_s = night.run("status")
    row.slowest_verb_s = max(row.slowest_verb_s, took_s)
    if code != 0:
        row.wrong.append(f"status ends with {code} after the runtime folder went")


def socket_replaced(night: FaultNight, _row: Row) -> None:
    """Something else lies where the socket was."""
    night.engine.socket.unlink(missing_ok=True)
    night.engine.socket.write_text("no socket")
    time.sleep(0.7)


def second_engine(night: FaultNight, row: Row) -> None:
    """Another engine for the same mount is turned away."""
    lifted = [word for name in OVERRIDES for word in ("--override", name)]
    code, took_s = night.run("engine", "--arm", *lifted)
    row.slowest_verb_s = max(row.slowest_verb_s, took_s)
    if code in (None, 0):
        row.wrong.append(f"a second engine ended with {code}")


@contextlib.contextmanager
def _connections(night: FaultNight, number: int) -> Iterator[list[socket.socket]]:
    opened = []
    try:
        for _ in range(number):
            wire = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            opened.append(wire)
            wire.settimeout(2.0)
            with contextlib.suppress(OSError):
                wire.connect(str(night.engine.socket))
        yield opened
    finally:
        for wire in opened:
            wire.close()


def half_open(night: FaultNight, row: Row) -> None:
    """As many connections as there may be, which say nothing: STOP has a place."""
    with _connections(night, 32):
        night.stop(row)
    night.measure(row)


def socket_garbage(night: FaultNight, row: Row) -> None:
    """Random bytes, a line without an end, deep JSON, and somebody who hangs up at once."""
    words = [
        _garbage(night) + b"\n",
        b"x" * 200_000,
        b"[" * 5000 + b"\n",
        b'{"id": 1, "verb": "status"}\n',
        b'{"verb": 7, "arguments": []}\n',
    ]
    with _connections(night, len(words)) as opened:
        for wire, word in zip(opened, words, strict=False):
            with contextlib.suppress(OSError):
                wire.sendall(word)
    night.look(row)


def busy_machine(night: FaultNight, row: Row) -> None:
    """As many other programs as there are cores, and a STOP among them."""
    spin = "import time\nends = time.monotonic() + 20\nwhile time.monotonic() < ends: pass"
    hogs = [subprocess.Popen([sys.executable, "-c", spin]) for _ in range(os.cpu_count() or 1)]
    try:
        time.sleep(0.5)
        night.stop(row)
        night.measure(row)
    finally:
        for each in hogs:
            each.kill()
            each.wait()


def verbs_at_once(night: FaultNight, row: Row) -> None:
    """Three terminals ask at the same time, one of them about the whole session."""
    words = (["status"], ["sessions"], ["status", "--json"])
    begun_s = time.monotonic()
    asked = [
        subprocess.Popen(
            [*COMMAND, *each],
            env=night.engine.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for each in words
    ]
    for each in asked:
        try:
            said, _ = each.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            each.kill()
            each.communicate()
            row.wrong.append("a verb hung")
            continue
        night.said.append(said)
        if each.returncode != 0:
            row.wrong.append(f"a verb ended with {each.returncode}: {said.strip()[-80:]}")
    row.slowest_verb_s = max(row.slowest_verb_s, time.monotonic() - begun_s)


def orders_at_random(night: FaultNight, row: Row) -> None:
    """Orders of any kind, in any state, some of them nonsense."""
    for _ in range(6):
        words = night.random.choice(
            (
                ["set", "detector.tau", "0.2"],
                ["set", "detector.tau", "banana"],
                ["goto", "240", "-5"],
                ["goto", "240", "-80"],
                ["disarm"],
                ["resume"],
                ["park"],
                ["unpark"],
                ["hold"],
                ["note", "a word \x1b[31m in red"],
                ["no-such-verb"],
            )
        )
        code, took_s = night.run(*words)
        row.slowest_verb_s = max(row.slowest_verb_s, took_s)
        if code is None:
            row.wrong.append(f"{words[0]} hung")
    night.run("unpark")


def stop_at_once(night: FaultNight, row: Row) -> None:
    """STOP while it moves, twice."""
    night.stop(row)
    night.stop(row)
    night.measure(row)


KINDS: dict[str, Kind] = {
    "mount's process killed": _kill("mount"),
    "camera's process killed": _kill("camera"),
    "solver's process killed": _kill("solver"),
    "mount's process suspended": _suspend("mount"),
    "camera's process suspended": _suspend("camera"),
    "solver's process suspended": _suspend("solver"),
    "engine suspended": engine_suspended,
    "all suspended": all_suspended,
    "engine killed": engine_killed,
    "engine ended": engine_ended,
    "wire cut": wire_cut,
    "INDI server away": server_away,
    "wire stalled": wire_stalled,
    "wire in crumbs": wire_slow,
    "noise on the wire": wire_garbage,
    "hostile properties": wire_hostile,
    "frame cut off": frame_cut,
    "frame spoilt": frame_spoilt,
    "frame too short": frame_short,
    "mount silent": mount_silent,
    "slews ignored": slews_ignored,
    "abort ignored": abort_ignored,
    "tracking lost with an abort": tracking_returns,
    "moved by another program": moved_by_another,
    "disk full": disk_full,
    "no descriptor left": descriptors_gone,
    "log removed": _lost(_remove, with_all=False),
    "session folder deleted": _lost(shutil.rmtree, with_all=False),
    "log cut short": _lost(_cut_short, with_all=True),
    "log written over": _lost(_write_over, with_all=True),
    "runtime folder deleted": runtime_folder_gone,
    "socket replaced": socket_replaced,
    "second engine": second_engine,
    "half-open connections": half_open,
    "noise on the socket": socket_garbage,
    "both cores busy": busy_machine,
    "several verbs at once": verbs_at_once,
    "orders at random": orders_at_random,
    "STOP twice": stop_at_once,
}
ENDS_IT = (
    "engine killed",
    "engine ended",
    "log removed",
    "session folder deleted",
    "log cut short",
    "log written over",
)
"""After which another engine is started: they come last, so that one lives through the rest."""
