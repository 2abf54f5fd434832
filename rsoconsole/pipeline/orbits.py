"""The orbit and the name of what is followed, frame by frame, as they go on record."""

import logging

from rsoconsole.config import Config
from rsoconsole.errors import OrbitError
from rsoconsole.pipeline.naming import Naming
from rsoconsole.pipeline.orbit_online import OnlineOrbit
from rsoconsole.records import Event, OrbitEstimate, Record

log = logging.getLogger(__name__)


class Orbits:
    """Hears the log, and makes of it what belongs behind a frame.

    No track depends on whether that succeeds: what fails is said once.
    """

    def __init__(self, config: Config) -> None:
        self.online = OnlineOrbit(config)
        self._naming = Naming(config)
        self._faults: set[str] = set()
        self.last: OrbitEstimate | None = None
        """On record."""

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        self.online.configure(config)
        self._naming.configure(config)

    def hear(self, record: Record) -> None:
        """One record of the log."""
        self.online.hear(record)

    def forget(self) -> None:
        """The clock was wrong until now."""
        self.online.forget()
        self.last = None

    def refine(self) -> tuple[Record, ...]:
        """What belongs on record behind a frame: OrbitEstimate, Identified, and words on both."""
        records: list[Record] = []
        try:
            refined = self.online.refine()
            if refined is None:
                return ()
            self.last, frame_id = refined.estimate, refined.estimate.frame_id
            records.append(refined.estimate)
            records += [Event(level="info", text=w, frame_id=frame_id) for w in refined.words]
            seen = self.online.seen
            track_id = refined.estimate.track_id
            name = None if seen is None else self._naming.ask(frame_id, track_id, seen)
            if name is not None:
                records.append(name)
        except OrbitError as error:
            records += self._complaint(f"it has no name: {error}")
        except Exception as error:  # the telescope goes on without an orbit
            log.exception("the orbit could not be refined")
            records += self._complaint(f"its orbit could not be refined ({error}): see the log")
        return tuple(records)

    def _complaint(self, words: str) -> tuple[Event, ...]:
        """Once for each fault."""
        if words in self._faults:
            return ()
        self._faults.add(words)
        return (Event(level="warning", text=words),)
