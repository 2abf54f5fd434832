"""The orbit and the name of each track, frame by frame, as they go on record."""

import logging
from collections.abc import Mapping, Sequence

from rsoconsole.config import Config
from rsoconsole.errors import OrbitError
from rsoconsole.pipeline.naming import Naming
from rsoconsole.pipeline.orbit_online import OnlineOrbit, Refined
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
        self.last: Mapping[int, OrbitEstimate] = {}
        """The last one of each track on record, by track id; never changed, frames keep theirs."""
        self.names: Mapping[int, str] = {}
        """Of those that are identified, by track id; never changed, other threads look in."""

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
        self.last = {}

    def refine(self) -> tuple[Record, ...]:
        """What belongs on record behind a frame: OrbitEstimate, Identified, and words on both."""
        records: list[Record] = []
        try:
            for refined in self.online.refine():
                estimate = refined.estimate
                self.last = {**self.last, estimate.track_id: estimate}
                records.append(estimate)
                for words in refined.words:
                    records.append(Event(level="info", text=words, frame_id=estimate.frame_id))
                records += self._name_of(refined)
        except Exception as error:  # the telescope goes on without an orbit
            log.exception("the orbit could not be refined")
            records += self._complaint(f"its orbit could not be refined ({error}): see the log")
        return tuple(records)

    def _name_of(self, refined: Refined) -> Sequence[Record]:
        frame_id, track_id = refined.estimate.frame_id, refined.estimate.track_id
        try:
            name = self._naming.ask(frame_id, track_id, refined.seen)
        except OrbitError as error:
            return self._complaint(f"it has no name: {error}")
        if name is None:
            return ()
        if name.verdict == "identified" and name.matches:
            best = name.matches[0]
            self.names = {**self.names, track_id: best.name or str(best.norad_id)}
        return (name,)

    def _complaint(self, words: str) -> tuple[Event, ...]:
        """Once for each fault."""
        if words in self._faults:
            return ()
        self._faults.add(words)
        return (Event(level="warning", text=words),)
