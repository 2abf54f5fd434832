"""A share of one core for some processes and all that they start, as a slow machine has it.

``open_quota`` takes the kernel's own means where they can be used (a control group with a CPU
quota, version 1 or 2), else a throttle that stops and continues the processes by what they have
used. Both let a process out again: what only simulates the world has its own time.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from pathlib import Path

PERIOD_S = 0.1
CGROUP_V1 = Path("/sys/fs/cgroup/cpu")
CGROUP_V2 = Path("/sys/fs/cgroup")
_US = 1_000_000
_TICK_S = 0.01
_ENTER = "import os, sys; open(sys.argv[1], 'w').write(str(os.getpid())); os.execvp(sys.argv[2], "
_ENTER += "sys.argv[2:])"


class Quota(ABC):
    """A share of one core; a process that enters takes all its later children with it."""

    means: str
    """What holds it, in words."""

    @abstractmethod
    def command(self, command: list[str]) -> list[str]:
        """The command line of a program that is under the quota from its first instruction on."""

    @abstractmethod
    def began(self, pid: int) -> None:
        """That program runs now."""

    @abstractmethod
    def let_out(self, pid: int) -> None:
        """A process that is under no quota from now on, nor are its later children."""

    @abstractmethod
    def used_s(self) -> float:
        """Processor seconds taken under it."""

    @abstractmethod
    def close(self) -> None:
        """No quota for anybody any more."""


class CgroupQuota(Quota):
    """A control group of the kernel's."""

    def __init__(self, share: float, parent: Path, version: int) -> None:
        """Raises OSError where the group cannot be made."""
        self.means = f"cgroup v{version}, {share:g} of a core in {PERIOD_S * 1e3:g} ms"
        self._parent, self._group = parent, parent / f"quota-{os.getpid()}"
        self._group.mkdir()
        quota_us, period_us = round(share * PERIOD_S * _US), round(PERIOD_S * _US)
        try:
            if version == 1:
                (self._group / "cpu.cfs_period_us").write_text(str(period_us))
                (self._group / "cpu.cfs_quota_us").write_text(str(quota_us))
            else:
                with contextlib.suppress(OSError):
                    (parent / "cgroup.subtree_control").write_text("+cpu")
                (self._group / "cpu.max").write_text(f"{quota_us} {period_us}")
        except OSError:
            self._group.rmdir()
            raise
        self._lost_s, self._seen_s = 0.0, dict[int, float]()
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._count, daemon=True)
        self._thread.start()

    def command(self, command: list[str]) -> list[str]:
        return [sys.executable, "-c", _ENTER, str(self._group / "cgroup.procs"), *command]

    def began(self, pid: int) -> None:
        """The program has entered by itself."""

    def let_out(self, pid: int) -> None:
        (self._parent / "cgroup.procs").write_text(str(pid))

    def used_s(self) -> float:
        return self._lost_s + sum(self._seen_s.values())

    def throttled_s(self) -> float:
        """How long it was held up, all processors together."""
        told = dict(line.split() for line in (self._group / "cpu.stat").read_text().splitlines())
        if "throttled_time" in told:
            return int(told["throttled_time"]) / 1e9
        return int(told.get("throttled_usec", 0)) / 1e6

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()
        for _ in range(100):
            for pid in self._members():
                with contextlib.suppress(OSError):
                    self.let_out(pid)
            with contextlib.suppress(OSError):
                self._group.rmdir()
                return
            time.sleep(_TICK_S)

    def _members(self) -> list[int]:
        return [int(pid) for pid in (self._group / "cgroup.procs").read_text().split()]

    def _count(self) -> None:
        while not self._is_over.wait(1.0):
            now = {pid: used for pid in self._members() if (used := cpu_s(pid)) is not None}
            self._lost_s += sum(s for pid, s in self._seen_s.items() if pid not in now)
            self._seen_s = now


class DutyCycleQuota(Quota):
    """Stops the processes while they have used more than their share, and lets them go on."""

    def __init__(self, share: float) -> None:
        self.means = f"stopped and continued by use, {share:g} of a core"
        self._share = share
        self._roots: set[int] = set()
        self._out: set[int] = set()
        self._seen_s: dict[int, float] = {}
        self._used_s = 0.0
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def command(self, command: list[str]) -> list[str]:
        return command

    def began(self, pid: int) -> None:
        self._roots.add(pid)

    def let_out(self, pid: int) -> None:
        self._out.add(pid)
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)

    def used_s(self) -> float:
        return self._used_s

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()

    def _run(self) -> None:
        budget_s, last_s = 0.0, time.monotonic()
        members: list[int] = []
        while not self._is_over.wait(_TICK_S):
            members = family(self._roots, self._out)
            used_s = sum(self._newly_used_s(pid) for pid in members)
            now_s = time.monotonic()
            # What was not used is not saved up: a slow processor saves nothing either.
            budget_s = min(budget_s + self._share * (now_s - last_s), self._share * PERIOD_S)
            budget_s, last_s = budget_s - used_s, now_s
            self._used_s += used_s
            _tell(members, signal.SIGSTOP if budget_s < 0.0 else signal.SIGCONT)
        _tell(members, signal.SIGCONT)

    def _newly_used_s(self, pid: int) -> float:
        used_s = cpu_s(pid)
        if used_s is None:
            return 0.0
        before_s, self._seen_s[pid] = self._seen_s.get(pid, 0.0), used_s
        return max(0.0, used_s - before_s)


def open_quota(share: float) -> Quota:
    """The best means there is on this machine."""
    ways: list[tuple[Path, int]] = []
    if (CGROUP_V1 / "cpu.cfs_quota_us").exists() or (CGROUP_V1 / "cpu.cfs_period_us").exists():
        ways.append((CGROUP_V1, 1))
    if (CGROUP_V2 / "cgroup.controllers").exists():
        ways.append((CGROUP_V2, 2))
    for parent, version in ways:
        with contextlib.suppress(OSError):
            return CgroupQuota(share, parent, version)
    return DutyCycleQuota(share)


@contextlib.contextmanager
def exempt(quota: Quota, root: int, module: str) -> Iterator[list[int]]:
    """Let every process that runs a module out as soon as it is there; the list of them."""
    found: list[int] = []
    is_over = threading.Event()

    def look() -> None:
        while not is_over.wait(_TICK_S):
            for pid in family({root}, set()):
                if pid not in found and module in command_of(pid):
                    with contextlib.suppress(OSError):
                        quota.let_out(pid)
                        found.append(pid)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield found
    finally:
        is_over.set()
        thread.join()


def family(roots: Iterable[int], without: set[int]) -> list[int]:
    """Living processes with their descendants; ``without`` those and theirs."""
    children: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (parent := _parent_of(int(entry.name))) is not None:
            children.setdefault(parent, []).append(int(entry.name))
    waiting, found = list(roots), []
    while waiting:
        pid = waiting.pop()
        if pid not in without:
            found.append(pid)
            waiting += children.get(pid, [])
    return found


def command_of(pid: int) -> list[str]:
    """The words of its command line; none where it is gone."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    return []


def cpu_s(pid: int) -> float | None:
    """Processor seconds that a process has taken; None where it is gone."""
    with contextlib.suppress(OSError, IndexError):
        ns = 0
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError):
                ns += int((task / "schedstat").read_text().split()[0])
        if ns:
            return ns / 1e9
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return None


def _parent_of(pid: int) -> int | None:
    with contextlib.suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
    return None


def _tell(members: Iterable[int], number: int) -> None:
    for pid in members:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
