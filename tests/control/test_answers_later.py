"""An answer that waits for the mount keeps nobody else waiting: no STOP, no status, no command."""

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.control import (
    AskStatus,
    ControlClient,
    ControlServer,
    Goto,
    Note,
    Outcome,
    Sender,
    Stop,
)
from rsoconsole.control.server import MAX_LATER
from rsoconsole.control.wire import DEFAULT_TIMEOUT_S
from rsoconsole.engine.service._command_handler import MOUNT_WORD_S, SENT, WAITS
from tests.rigs.engine_rig import START_DEG, Rig, command_handler_of, rig

ASIDE = {"ra_icrs_deg": START_DEG[0] + 1.0, "dec_icrs_deg": START_DEG[1]}
WORD_S = 1.0
AT_ONCE_S = 0.5
"""Less than the answers' wait, more than a busy machine needs."""


class SilentMount:
    """A mount that answers when it is told to, and the loop that waits for it."""

    def __init__(self, folder: Path) -> None:
        self.r: Rig = rig(set())
        self.socket = folder / "engine.sock"
        self.answers, self.is_asked = threading.Event(), threading.Event()
        self.refusal = ""
        self.ends = threading.Event()
        self.r.mount.slew = self._slew  # type: ignore[method-assign]
        self._loop = threading.Thread(target=self._run, daemon=True)

    def _slew(self, *_arguments: object) -> None:
        self.is_asked.set()
        assert self.answers.wait(20.0)
        if self.refusal:
            raise InstrumentError(self.refusal)

    def _run(self) -> None:
        while not self.ends.wait(0.005):
            with contextlib.suppress(Exception):  # a STOP cuts in
                self.r.engine.commands.heed_alarms()
                self.r.engine.commands.execute_waiting()

    def client(self) -> ControlClient:
        return ControlClient(self.socket, sender=Sender(name="test"))

    @contextlib.contextmanager
    def runs(self, *, loops: bool = True) -> Iterator[None]:
        handler = command_handler_of(self.r, WORD_S)
        with ControlServer(self.socket, handler.begin, stamp=lambda: self.r.queue.stops):
            if loops:
                self._loop.start()
            try:
                yield
            finally:
                self.answers.set()
                self.ends.set()
                if loops:
                    self._loop.join(20.0)

    def goto(self) -> "tuple[threading.Thread, list[tuple[Outcome, float]]]":
        """Sent from a thread of its own; what came, and after how long."""
        came: list[tuple[Outcome, float]] = []

        def send() -> None:
            began_s = time.monotonic()
            came.append((self.client().send(Goto(**ASIDE)), time.monotonic() - began_s))

        thread = threading.Thread(target=send, daemon=True)
        thread.start()
        return thread, came


@pytest.fixture
def silent(tmp_path: Path) -> SilentMount:
    return SilentMount(tmp_path)


def test_a_sender_waits_longer_than_the_engine_for_the_mount():
    assert DEFAULT_TIMEOUT_S > MOUNT_WORD_S
    assert Goto.answer_s > MOUNT_WORD_S


def test_a_mount_that_does_not_answer_is_told_so_in_time(silent: SilentMount):
    with silent.runs():
        thread, came = silent.goto()
        thread.join(20.0)
        ((outcome, took_s),) = came
        assert (outcome.ok, outcome.message) == (True, SENT)
        assert WORD_S <= took_s < WORD_S + AT_ONCE_S


def test_stop_status_and_other_commands_do_not_wait_behind_it(silent: SilentMount):
    with silent.runs():
        thread, came = silent.goto()
        assert silent.is_asked.wait(20.0)
        for command in (Stop(), AskStatus(), Note(text="clouds in the west")):
            began_s = time.monotonic()
            silent.client().send(command)
            assert time.monotonic() - began_s < AT_ONCE_S, command
            assert not came
        assert silent.r.mount.aborts >= 1
        silent.answers.set()
        thread.join(20.0)


def test_the_refusal_comes_as_soon_as_the_mount_has_given_it(silent: SilentMount):
    silent.refusal = "the mount refused to slew: below its horizon"
    with silent.runs():
        thread, came = silent.goto()
        assert silent.is_asked.wait(20.0)
        silent.answers.set()
        thread.join(20.0)
        ((outcome, took_s),) = came
        assert (outcome.ok, outcome.message) == (False, silent.refusal)
        assert took_s < WORD_S


def test_the_answer_is_there_before_its_sender_gives_up(silent: SilentMount):
    with silent.runs(loops=False):
        outcome = silent.client().send(Goto(**ASIDE), timeout_s=0.2)
        assert (outcome.ok, outcome.message) == (True, WAITS)


def test_more_than_can_wait_are_answered_at_once_with_what_is_known(silent: SilentMount):
    line = json.dumps({"id": 1, "verb": "goto", "arguments": ASIDE}).encode() + b"\n"
    asked = MAX_LATER + 5
    with silent.runs(loops=False), socket.socket(socket.AF_UNIX) as wire:
        wire.connect(str(silent.socket))
        wire.settimeout(20.0)
        wire.sendall(line * asked)
        answers = wire.makefile()
        began_s = time.monotonic()
        first = [json.loads(answers.readline()) for _ in range(5)]
        assert time.monotonic() - began_s < WORD_S
        rest = [json.loads(answers.readline()) for _ in range(MAX_LATER)]
        assert {each["message"] for each in first + rest} == {WAITS}
