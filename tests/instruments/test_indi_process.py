"""What the parent makes of a child that breaks off, dies, babbles or answers too late."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_process import IndiProcess

FAR_TOO_LONG_S = 100.0
"""A request that waits this long runs into the test's own time-out."""


@pytest.fixture
def heard() -> list[dict[str, Any]]:
    return []


@pytest.fixture
def child(tmp_path: Path, heard: list[dict[str, Any]]) -> Iterator[IndiProcess]:
    def receive(message: dict[str, Any]) -> None:
        if message["event"] == "unusable":
            raise TypeError("what is this?")
        heard.append(message)

    process = IndiProcess(
        name="camera",
        module="tests.children.faltering_child",
        settings={},
        log_path=tmp_path / "camera.log",
        on_event=receive,
    )
    process.start()
    yield process
    process.close()


@pytest.mark.timeout(30)
@pytest.mark.parametrize("verb", ["die", "break off", "fall silent"])
def test_a_child_that_ends_in_the_middle_answers_with_an_error_at_once_and_works_again(child, verb):
    with pytest.raises(InstrumentError, match="process ended"):
        child.request(verb, FAR_TOO_LONG_S)
    assert child.request("work", 10.0)["echo"] == "work"


@pytest.mark.timeout(30)
def test_every_open_request_hears_of_the_death(child):
    ends: list[str] = []

    def ask() -> None:
        try:
            child.request("wait for ever", FAR_TOO_LONG_S)
        except InstrumentError as error:
            ends.append(str(error))

    asking = [threading.Thread(target=ask) for _ in range(3)]
    for thread in asking:
        thread.start()
    while len(child._open) < 3:
        time.sleep(0.01)
    os.kill(child.pid, signal.SIGKILL)
    for thread in asking:
        thread.join()
    assert len(ends) == 3
    assert all("process ended (status -9)" in end for end in ends)
    assert not child._open


@pytest.mark.timeout(30)
def test_who_waits_for_an_event_hears_of_the_death(child):
    threading.Timer(0.1, os.kill, (child.pid, signal.SIGKILL)).start()
    with pytest.raises(InstrumentError, match="process ended"):
        child.wait(lambda: False, FAR_TOO_LONG_S)


def test_lines_that_are_none_are_passed_over_and_unusable_events_too(child, heard):
    assert child.request("babble", 10.0)["echo"] == "babble"
    assert heard == [{"event": "usable"}]
    assert child.request("work", 10.0)["echo"] == "work"


def test_an_answer_that_comes_too_late_is_forgotten(child):
    with pytest.raises(InstrumentError, match="did not answer 'be late'"):
        child.request("be late", 0.1, after_s=0.5)
    # The child sends its late answer before this one.
    assert child.request("be late", 10.0, after_s=1.0)["echo"] == "be late"
    assert child._answers == {}
    assert child._open == set()
