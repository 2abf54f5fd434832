"""A user of their own in whose house the commands of the pages are run as they are printed.

Home, working folder, runtime folder and PATH are the house's; a shell runs the line with the
program that is installed. Nothing of a line is changed but names in capitals, which stand for
things, and absolute paths, which lead into the house. In a ``NearHouse`` the shell only says what
the program is given, which then runs in the process of the tests.
"""

import contextlib
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.rigs.in_process import environment_of, run_here
from tests.rigs.terminal import Terminal
from tests.rigs.whole_engine import EVERY_S, processes_of

PROGRAM = Path(sys.executable).with_name("rsoconsole")
PATIENCE_S = 240.0
"""Only on a machine that is held up does anything here take a tenth of it."""
SEAT = (120, 40)
_IN_CAPITALS = re.compile(r"\[?[A-Z]+(-or-[A-Z]+)?(\.\.\.)?\]?")
_OUTSIDE = ("/media/usb", "/var/lib/node_exporter", "/usr/share/astrometry")
"""Absolute paths of the pages."""
_NOT_PASSED_ON = ("XDG_", "RSOCONSOLE_", "NOTIFY_", "_TYPER", "COLUMNS", "LINES")


@dataclass(frozen=True)
class Done:
    """What a command printed before it ended well."""

    stdout: str
    stderr: str

    @property
    def objects(self) -> list[dict[str, Any]]:
        """Its JSON, one object a line."""
        return [json.loads(line) for line in self.stdout.splitlines()]

    @property
    def object(self) -> dict[str, Any]:
        """The only one of its JSON."""
        (only,) = self.objects
        return only


class House:
    """Folders, environment, and the commands that have been run there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.home, self.here = folder / "home", folder / "here"
        self._bin, self._runtime = folder / "bin", folder / "run"
        for each in (self.home, self.here, self._bin, folder / "tmp"):
            each.mkdir()
        self._runtime.mkdir(mode=0o700)
        own = {k: v for k, v in os.environ.items() if not k.startswith(_NOT_PASSED_ON)}
        places = f"{self._bin}:{PROGRAM.parent}:{os.environ['PATH']}"
        self.environment = {
            **own,
            "PATH": places,
            "HOME": str(self.home),
            "TMPDIR": str(folder / "tmp"),
            "LC_ALL": "C.UTF-8",
            "XDG_RUNTIME_DIR": str(self._runtime),
        }
        self.ran: set[str] = set()
        """Commands as the pages have them."""

    @property
    def config(self) -> Path:
        """The user's configuration."""
        return self.home / ".config" / "rsoconsole" / "config.toml"

    @property
    def data(self) -> Path:
        """The user's data folder."""
        return self.home / ".local" / "share" / "rsoconsole"

    @property
    def state(self) -> Path:
        """The user's state folder."""
        return self.home / ".local" / "state" / "rsoconsole"

    @property
    def socket(self) -> Path:
        """Where an engine of this user listens."""
        return self._runtime / "rsoconsole" / "engine.sock"

    def configure(self, text: str) -> None:
        """Write the configuration."""
        self.config.parent.mkdir(parents=True, exist_ok=True)
        self.config.write_text(text, encoding="utf-8")

    def program(self, name: str, script: str) -> None:
        """A program of the house, before all others of that name."""
        path = self._bin / name
        path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
        path.chmod(0o755)

    def inside(self, path: str) -> Path:
        """Where an absolute path leads to here; its folder is there."""
        place = self.folder / path.lstrip("/")
        place.mkdir(parents=True, exist_ok=True)
        return place

    def typed(self, command: str, things: Mapping[str, str] | None = None) -> str:
        """The line as it is given to the shell."""
        given = dict(things or {})
        for name in given:
            assert _IN_CAPITALS.fullmatch(name), f"{name} is no name in capitals"
            assert name in command, (name, command)
        given |= {path: shlex.quote(str(self.inside(path))) for path in _OUTSIDE if path in command}
        if not given:
            return command
        longest_first = sorted(given, key=len, reverse=True)
        either = "|".join(rf"(?<!\w){re.escape(name)}(?!\w)" for name in longest_first)
        return re.sub(either, lambda found: given[found[0]], command)

    def run(
        self, command: str, things: Mapping[str, str] | None = None, *, expect: int = 0
    ) -> Done:
        """Run a command of a page to its end."""
        line = self.typed(command, things)
        done = self._done(line)
        assert done.returncode == expect, f"{line}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr
        self.ran.add(command)
        return Done(done.stdout, done.stderr)

    def _done(self, line: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-o", "pipefail", "-c", line],
            cwd=self.here,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    @contextlib.contextmanager
    def running(
        self, command: str, things: Mapping[str, str] | None = None
    ) -> Iterator[Callable[[], str]]:
        """A command that goes on until it is told to end, which must be before the block's end.

        Gives what it has said so far.
        """
        said = self.folder / f"said-{len(list(self.folder.glob('said-*')))}.txt"
        with said.open("w", encoding="utf-8") as stream:
            process = subprocess.Popen(
                ["bash", "-c", f"exec {self.typed(command, things)}"],
                cwd=self.here,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=stream,
                start_new_session=True,
            )
        try:
            yield (
                lambda: (
                    said.read_text(encoding="utf-8")
                    + (
                        f"\nit has ended: {process.returncode}"
                        if process.poll() is not None
                        else ""
                    )
                )
            )
            assert process.wait(PATIENCE_S) == 0, said.read_text(encoding="utf-8")
            self.ran.add(command)
        finally:
            process.kill()
            process.wait()

    @contextlib.contextmanager
    def seat(self, command: str, things: Mapping[str, str] | None = None) -> Iterator[Terminal]:
        """A command in a terminal, which must end well of itself once the block has left it."""
        line = f"cd {shlex.quote(str(self.here))} && exec {self.typed(command, things)}"
        with Terminal(["bash", "-c", line], self.environment, SEAT) as terminal:
            yield terminal
            seen(terminal, lambda: terminal.process.poll() is not None, "its end")
            assert terminal.process.returncode == 0, terminal.text[-3000:]
            self.ran.add(command)

    def clear(self) -> None:
        """End whatever was left running here."""
        while left := processes_of(self._runtime):
            for pid in left:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(EVERY_S)


class NearHouse(House):
    """A house whose program runs in the process of the tests."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._given = folder / "given"
        self._given.mkdir()
        # The default is that of the user for whom the tests' process was started.
        self.environment["RSOCONSOLE_SESSION__ROOT"] = str(self.data / "sessions")
        place = shlex.quote(str(self._given))
        self.program(
            PROGRAM.name,
            f"printf '%s\\0' \"$@\" > {place}/words; env -0 > {place}/environment;"
            f" cat > {place}/input",
        )

    def _done(self, line: str) -> subprocess.CompletedProcess[str]:
        assert not is_piped_on(line), f"nothing reads what it prints: {line}"
        of_the_shell = super()._done(line)
        assert of_the_shell.returncode == 0, of_the_shell.stderr
        words = self._zero_ended("words")
        environment = dict(each.split("=", 1) for each in self._zero_ended("environment"))
        with environment_of(environment, self.here):
            return run_here(*words, stdin=(self._given / "input").read_bytes())

    def _zero_ended(self, name: str) -> list[str]:
        return (self._given / name).read_text(encoding="utf-8").split("\0")[:-1]


def is_piped_on(command: str) -> bool:
    """Whether another program reads what ours prints."""
    return "|" in command.partition(PROGRAM.name)[2]


def seen(terminal: Terminal, is_so: Callable[[], Any], what: str) -> Any:
    """Wait for something in a terminal; its value."""
    ends_s = time.monotonic() + PATIENCE_S
    while not (found := is_so()):
        assert time.monotonic() < ends_s, f"no sign of: {what}; {terminal.text[-3000:]}"
        time.sleep(EVERY_S)
    return found


@contextlib.contextmanager
def a_house(folder: Path) -> Iterator[House]:
    """One in which nothing is left running."""
    house = House(folder)
    try:
        yield house
    finally:
        house.clear()


Recipe = Callable[[House, str], None]


class Recipes(dict[str, Recipe]):
    """How each command is run, by the command as it is printed."""

    def of(self, *commands: str) -> Callable[[Recipe], Recipe]:
        """Runs these commands."""

        def keep(recipe: Recipe) -> Recipe:
            for each in commands:
                assert each not in self, each
                self[each] = recipe
            return recipe

        return keep

    def one_of_each(self) -> list[str]:
        """The first command of each recipe, but those that print into another program."""
        first = {recipe: command for command, recipe in reversed(self.items())}
        return [each for each in reversed(first.values()) if not is_piped_on(each)]
