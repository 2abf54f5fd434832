"""Settings tried in a process of their own: the same figures, and nothing of it is left behind."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import cast

import pytest

from rsoconsole.base import ConfigError, RsoconsoleError, SessionError
from rsoconsole.config import Config
from rsoconsole.pipeline import WhatIfProcess, WhatIfQuestion, what_if
from rsoconsole.session import SessionReader
from tests.nights.samples import SAMPLE
from tests.rigs.whole_engine import wait_for

CONFIG = SessionReader(SAMPLE).config()
WIDER = {"filter.r_multiplier": 2.0}


@pytest.fixture
def process():
    process = WhatIfProcess()
    yield process
    process.close()


@pytest.fixture(scope="module")
def lasting():
    """One for all tests that leave it as it is."""
    process = WhatIfProcess()
    yield process
    process.close()


def question(changes=WIDER, **more):
    return WhatIfQuestion(folder=SAMPLE, config=CONFIG, changes=changes, **more)


def test_the_figures_are_those_computed_here(lasting):
    log = [(seq, record) for seq, _, record in SessionReader(SAMPLE).records()]
    half = log[len(log) // 2][0]
    for until, last in ((None, None), (half, None), (None, 5), (half, 5)):
        records = [record for seq, record in log if until is None or seq <= until]
        expected = what_if(records, CONFIG, WIDER, last)
        assert lasting.ask(question(until_seq=until, last=last)) == expected


def test_one_process_answers_all_and_what_cannot_be_tried_is_said(lasting):
    lasting.ask(question())
    pid = lasting.pid
    with pytest.raises(ConfigError, match="must be above 0"):
        lasting.ask(question({"filter.q_multiplier": -1.0}))
    with pytest.raises(SessionError, match="holds no session"):
        lasting.ask(WhatIfQuestion(folder=SAMPLE.parent, config=CONFIG, changes=WIDER))
    lasting.ask(question())
    assert lasting.pid == pid


def test_it_ends_when_nobody_asks_and_comes_back_with_the_next_question():
    process = WhatIfProcess(idle_s=0.2)
    first = process.ask(question())
    wait_for(lambda: process.pid is None, "its end")
    assert process.ask(question()) == first
    process.close()
    assert process.pid is None


@pytest.mark.nightly("starts one more process")
def test_one_that_is_started_ahead_answers_and_ends_like_any_other():
    process = WhatIfProcess(idle_s=0.5)
    process.start()
    pid = process.pid
    assert pid is not None
    process.ask(question())
    assert process.pid == pid
    wait_for(lambda: process.pid is None, "its end")
    process.close()
    process.start()
    assert process.pid is None


def test_what_breaks_there_is_in_the_log_here_and_the_operator_hears_one_line(lasting, caplog):
    with pytest.raises(SessionError, match="the effect cannot be computed") as caught:
        lasting.ask(WhatIfQuestion(folder=SAMPLE, config=cast(Config, None), changes=WIDER))
    assert "Traceback" not in str(caught.value)
    assert "Traceback" in caplog.text
    lasting.ask(question())


def test_one_that_dies_is_said_to_and_the_next_question_has_another(process):
    first = process.ask(question())
    os.kill(process.pid, signal.SIGSTOP)
    pid = process.pid
    killer = threading.Timer(0.3, os.kill, (pid, signal.SIGKILL))
    killer.start()
    with pytest.raises(SessionError, match="try once more"):
        process.ask(question())
    assert process.ask(question()) == first
    assert process.pid != pid


def test_closing_ends_a_wait(process):
    process.ask(question())
    os.kill(process.pid, signal.SIGSTOP)
    said = []

    def ask():
        try:
            process.ask(question())
        except RsoconsoleError as error:
            said.append(str(error))

    asking = threading.Thread(target=ask)
    asking.start()
    process.close()
    asking.join(20.0)
    assert not asking.is_alive()
    assert said


@pytest.mark.nightly("starts a second program")
def test_it_does_not_outlive_a_parent_that_is_killed():
    program = (
        "import sys; from tests.pipeline.test_what_if_process import *\n"
        "process = WhatIfProcess(); process.ask(question()); print(process.pid, flush=True)\n"
        "import time; time.sleep(60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    wait_for(lambda: not is_alive(pid), "the end of the child")


def is_alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_the_console_reads_what_was_recorded_without_the_filters_libraries():
    program = (
        "import sys; from pathlib import Path; import rsoconsole.console.screens.live\n"
        "from rsoconsole.session import SessionReader\n"
        "from rsoconsole.night import recorded_figures\n"
        f"log = SessionReader(Path({str(SAMPLE)!r})).records()\n"
        "assert recorded_figures(r for _, _, r in log).updates > 10\n"
        "print(sorted({'scipy', 'filterpy', 'astropy', 'cv2'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "[]", done.stderr
