"""The real console over an engine that says what it is told, as a program for a pseudo-terminal.

    python -m tests.rigs.made_up_console SESSION SENT

``SENT``: file to which each command that it sends is added, a JSON list a line.
"""

import json
import sys
import threading
from pathlib import Path

from rsoconsole.console import run
from rsoconsole.control import Command, Outcome
from tests.rigs.seat_rig import PREVIEW, FakeWire


class WritingWire(FakeWire):
    """An engine whose commands another process can read."""

    def __init__(self, session: Path, sent: Path) -> None:
        super().__init__(session)
        self.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)
        self._file, self._written, self._turn = sent, 0, threading.Lock()

    def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
        outcome = super().send(command, timeout_s=timeout_s)
        # Threads send beside each other: each command is written once.
        with self._turn, self._file.open("a", encoding="utf-8") as file:
            for entry in self.sent[self._written :]:
                file.write(json.dumps(entry) + "\n")
                self._written += 1
        return outcome


def main() -> None:
    """Open the console."""
    wire = WritingWire(Path(sys.argv[1]), Path(sys.argv[2]))
    run.ControlClient = lambda *_, **__: wire  # type: ignore[assignment,misc]
    run.run_console()


if __name__ == "__main__":
    main()
