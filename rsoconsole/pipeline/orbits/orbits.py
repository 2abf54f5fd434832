"""Orbits, catalogue names and relative motion of the tracks, computed after each frame.

Catalogued objects that should be in the frame and have no track are found too.
"""

import logging
from collections.abc import Mapping, Sequence

from rsoconsole.base import OrbitError
from rsoconsole.config import Config
from rsoconsole.pipeline.orbits._naming import TrackIdentifier
from rsoconsole.pipeline.orbits._pairs import TrackPairs
from rsoconsole.pipeline.orbits.expected import UntrackedObjects
from rsoconsole.pipeline.orbits.orbit_online import OnlineOrbit, RefinedOrbit
from rsoconsole.pipeline.orbits.uncorrelated_tracks import Past
from rsoconsole.records import Event, OrbitEstimate, Record

log = logging.getLogger(__name__)


class Orbits:
    """Computes orbits, catalogue names and relative motion of the tracks after each frame.

    Tracking does not depend on it: a fault is reported once as an event, and nothing is raised.
    """

    def __init__(self, config: Config, past: Past | None = None) -> None:
        """``past``: uncorrelated tracks of earlier nights, to compare unknown tracks with."""
        self.online = OnlineOrbit(config)
        self._naming = TrackIdentifier(config, past)
        self.pairs = TrackPairs(config)
        self.expected = UntrackedObjects(config, self._naming.entries)
        self._faults: set[str] = set()
        self.last: Mapping[int, OrbitEstimate] = {}
        """Last orbit on record by track id; replaced, never changed, as frames keep it."""
        self.names: Mapping[int, str] = {}
        """Names of identified tracks by id; replaced, never changed, as other threads read it."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from now on."""
        self.online.configure(config)
        self._naming.configure(config)
        self.pairs.configure(config)
        self.expected.configure(config, self._naming.entries)

    def receive(self, record: Record) -> None:
        """Process the next record of the log."""
        self.online.receive(record)
        self.pairs.receive(record)
        self.expected.receive(record)

    def forget(self) -> None:
        """Forget all measurements, orbits and names: the clock was wrong until now."""
        self.online.forget()
        self._naming.forget()
        self.pairs.forget()
        self.last = {}

    def derive_frame_records(self) -> tuple[Record, ...]:
        """Return the new records after a frame.

        They are OrbitEstimate, Identified, PairMotions, ExpectedMembers, and events about these.
        """
        records: list[Record] = []
        try:
            refined = self.online.refine()
            for each in refined:
                estimate = each.estimate
                self.last = {**self.last, estimate.track_id: estimate}
                records += [estimate, *each.events]
            records += self._names_of(refined)
        except Exception as error:  # the telescope goes on without an orbit
            log.exception("the orbit could not be refined")
            records += self._complaint(f"its orbit could not be refined ({error}): see the log")
        return (*records, *self._others())

    def _others(self) -> Sequence[Record]:
        """Return the records that concern all tracks together."""
        records: list[Record] = []
        try:
            records += self.pairs.derive_frame_records()
            records += self.expected.derive_frame_records()
        except OrbitError as error:
            records += self._complaint(f"nobody is expected by the catalogue: {error}")
        except Exception as error:  # the telescope goes on without them
            log.exception("the field could not be looked over")
            records += self._complaint(f"the field could not be looked over ({error}): see the log")
        return records

    def _names_of(self, refined: Sequence[RefinedOrbit]) -> Sequence[Record]:
        if not refined:
            return ()
        frame_id = max(each.estimate.frame_id for each in refined)
        seen = {each.estimate.track_id: each.seen for each in refined}
        try:
            found = self._naming.identify_due_tracks(frame_id, seen, self.online.track_ids)
        except OrbitError as error:
            return self._complaint(f"it has no name: {error}")
        for name in found:
            names = {n: each for n, each in self.names.items() if n != name.track_id}
            if name.verdict == "identified" and name.matches:
                best = name.matches[0]
                names[name.track_id] = best.name or str(best.norad_id)
            elif name.ledger is not None and name.ledger.is_sure:
                names[name.track_id] = name.ledger.name
            self.names = names
            self.expected.receive(name)
        return found

    def _complaint(self, words: str) -> tuple[Event, ...]:
        """Return a warning, once for each fault."""
        if words in self._faults:
            return ()
        self._faults.add(words)
        return (Event(level="warning", text=words),)
