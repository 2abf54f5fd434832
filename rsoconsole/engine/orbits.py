"""The engine's part in orbits: after each frame, while the mount is on its way to the next."""

import logging
from typing import Any

from rsoconsole.config import Config
from rsoconsole.engine.chronicle import Chronicle
from rsoconsole.engine.guide import Guide
from rsoconsole.errors import OrbitError
from rsoconsole.pipeline.naming import Naming
from rsoconsole.pipeline.orbit_online import OnlineOrbit
from rsoconsole.records import OrbitEstimate

log = logging.getLogger(__name__)


class Orbits:
    """Refines the orbit of what is followed, asks for its name, and puts both on record.

    No track and no slew depends on whether that succeeds.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._online = OnlineOrbit(config)
        self._naming = Naming(config)
        self._faults: set[str] = set()
        self.last: OrbitEstimate | None = None
        """On record."""
        self.guide = Guide(self._online, config)

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        self._config = config
        for part in (self._online, self._naming, self.guide):
            part.configure(config)

    def hear(self, record: Any) -> None:
        """One record of the log, from the loop's own thread."""
        self._online.hear(record)

    def forget(self) -> None:
        """The clock was wrong until now."""
        self._online.forget()
        self.last = None

    def refine(self, frame_id: int, chronicle: Chronicle) -> None:
        """Everything that is to be done after a frame."""
        try:
            refined = self._online.refine(frame_id)
            if refined is None:
                return
            self.last = refined.estimate
            chronicle.append(refined.estimate)
            for words in refined.words:
                chronicle.say("info", words)
            seen = self._online.seen
            name = None if seen is None else self._naming.ask(frame_id, seen)
            if name is not None:
                chronicle.append(name)
        except OrbitError as error:
            self._complain(f"it has no name: {error}", chronicle)
        except Exception as error:  # the telescope goes on without an orbit
            log.exception("the orbit could not be refined")
            self._complain(f"its orbit could not be refined ({error}): see the log", chronicle)

    def _complain(self, words: str, chronicle: Chronicle) -> None:
        """Once for each fault."""
        if words not in self._faults:
            self._faults.add(words)
            chronicle.say("warning", words)
