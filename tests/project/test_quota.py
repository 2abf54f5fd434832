"""The throttle of the benches holds what it is set to, by either means."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.quota import CgroupQuota, DutyCycleQuota, Quota, cpu_s, family, open_quota

SHARE = 0.25
BURN_S = 2.0
SLACK_S = 0.2
"""Two periods on two processors, and the ticks in which processor time is counted."""
BURN = "while True: pass"


def cgroup() -> Quota:
    quota = open_quota(SHARE)
    if not isinstance(quota, CgroupQuota):
        quota.close()
        pytest.skip("no control group with a CPU quota can be made here")
    return quota


@pytest.fixture(params=[cgroup, lambda: DutyCycleQuota(SHARE)], ids=["cgroup", "duty cycle"])
def quota(request: pytest.FixtureRequest) -> Iterator[Quota]:
    with contextlib.closing(request.param()) as made:
        yield made


def test_a_process_and_its_child_share_what_they_are_given(quota: Quota) -> None:
    both = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {BURN!r}])\n{BURN}"
    began_s = time.monotonic()
    with subprocess.Popen(quota.command([sys.executable, "-c", both])) as process:
        quota.began(process.pid)
        try:
            time.sleep(BURN_S)
            members = family({process.pid}, set())
            used_s = sum(cpu_s(pid) or 0.0 for pid in members)
            lasted_s = time.monotonic() - began_s
        finally:
            for pid in family({process.pid}, set()):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
    assert len(members) == 2
    # However busy the machine is, it is never more; without a quota the two took two cores.
    assert 0.0 < used_s < SHARE * lasted_s + SLACK_S


def test_a_process_that_is_let_out_leaves_its_group() -> None:
    with (
        contextlib.closing(cgroup()) as quota,
        subprocess.Popen(
            quota.command([sys.executable, "-c", "input()"]), stdin=subprocess.PIPE
        ) as process,
    ):
        groups = Path(f"/proc/{process.pid}/cgroup")
        assert "quota-" in _once_in(groups, "quota-")
        quota.let_out(process.pid)
        assert "quota-" not in groups.read_text()
        process.communicate(b"\n")


def _once_in(groups: Path, word: str) -> str:
    """The process enters by itself."""
    for _ in range(1000):
        if word in (text := groups.read_text()):
            return text
        time.sleep(0.01)
    return groups.read_text()
