"""Identification of the tracks with catalogued objects, repeated as their measurements grow."""

import logging
import threading
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from rsoconsole.base import OrbitError
from rsoconsole.config import Config
from rsoconsole.orbits import (
    CatalogueComparison,
    CatalogueEntry,
    Identification,
    MeasuredDirections,
    ObjectMatch,
    compare_with_catalogue,
    identify_compared_tracks,
)
from rsoconsole.pipeline.orbits.elements_used import read_catalogue
from rsoconsole.pipeline.orbits.expected import catalogue_errors
from rsoconsole.pipeline.orbits.track_measurements import longest_arc
from rsoconsole.pipeline.orbits.uncorrelated_tracks import Past
from rsoconsole.records import CatalogueMatch, Identified, LedgerName
from rsoconsole.words import ledger_words

log = logging.getLogger(__name__)
FIRST_AT = 3
_MORE = 1.5
"""Growth of the number of directions after which a track is compared again."""
_MAX_MATCHES = 3
_MAX_TRACKS = 24
"""Most tracks that are named together, the latest compared."""


class Catalogue:
    """Element sets of the configured files, read in a thread of their own."""

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = tuple(files)
        self._entries: tuple[CatalogueEntry, ...] = ()
        self._fault: OrbitError | None = None
        self._reading = threading.Thread(target=self._read, name="catalogue", daemon=True)
        self._reading.start()

    def entries(self) -> tuple[CatalogueEntry, ...]:
        """Wait for all element sets and return them. Raises OrbitError for a faulty file."""
        self._reading.join()
        if self._fault is not None:
            raise self._fault
        return self._entries

    def _read(self) -> None:
        try:
            sets = read_catalogue(self.files)
            self._entries = sets.entries
            if words := sets.not_used_words:
                log.warning("%s", words)
        except OrbitError as error:
            self._fault = error
        except Exception as error:  # the caller is given it
            self._fault = OrbitError(f"the catalogue cannot be read: {error}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Asked:
    """Track as last compared with the catalogue."""

    begun_utc_ns: int
    due: int
    """Number of directions with which it is compared again."""
    compared: CatalogueComparison
    said: tuple[str, int | None] = ("", None)
    """Result and best match that are on record."""


class TrackIdentifier:
    """Identifies all tracks together; a track is compared again as its directions grow."""

    def __init__(self, config: Config, past: Past | None = None) -> None:
        """``past``: uncorrelated tracks of earlier nights, to compare unknown tracks with."""
        self._config = config
        self._past = past
        self._catalogue = Catalogue(config.catalogue.tle_files)
        self._errors = catalogue_errors(config.catalogue)
        self._asked: dict[int, _Asked] = {}

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from now on."""
        if config.catalogue.tle_files != self._catalogue.files:
            self._catalogue = Catalogue(config.catalogue.tle_files)
            self._asked = {}
        self._config, self._errors = config, catalogue_errors(config.catalogue)

    def forget(self) -> None:
        """Forget all comparisons: the clock was wrong until now."""
        self._asked = {}

    def entries(self) -> tuple[CatalogueEntry, ...]:
        """Return the element sets of the catalogue. Raises OrbitError where it cannot be read."""
        return self._catalogue.entries()

    def identify_due_tracks(
        self, frame_id: int, seen: Mapping[int, MeasuredDirections], tracks: Collection[int]
    ) -> tuple[Identified, ...]:
        """Identify the tracks that are due for comparison with the catalogue.

        ``seen``: directions of the tracks with a new measurement, by track id; ``tracks``: ids of
        all tracks so far. Other tracks whose identification changes thereby are returned too; ()
        without a catalogue. Raises OrbitError where the catalogue cannot be read.
        """
        if not self._catalogue.files:
            return ()
        due = [track_id for track_id, each in seen.items() if self._is_due(track_id, each)]
        if not due:
            return ()
        entries, gate_deg = self._catalogue.entries(), self._config.catalogue.gate_deg
        for track_id in due:
            arc = longest_arc(seen[track_id])
            self._asked.pop(track_id, None)  # the latest last
            self._asked[track_id] = _Asked(
                begun_utc_ns=int(seen[track_id].t_utc_ns[0]),
                due=max(round(_MORE * len(seen[track_id])), len(seen[track_id]) + 1),
                compared=compare_with_catalogue(
                    arc,
                    self._config.site.to_site(),
                    entries,
                    gate_deg=gate_deg,
                    errors=self._errors,
                ),
            )
        kept = [each for each in self._asked if each in tracks or each in due][-_MAX_TRACKS:]
        self._asked = {track_id: self._asked[track_id] for track_id in kept}
        compared = [each.compared for each in self._asked.values()]
        answers = identify_compared_tracks(compared, gate_deg=gate_deg)
        return tuple(self._said(frame_id, due, dict(zip(kept, answers, strict=True))))

    def _is_due(self, track_id: int, seen: MeasuredDirections) -> bool:
        asked = self._asked.get(track_id)
        if asked is None or asked.begun_utc_ns != int(seen.t_utc_ns[0]):
            return len(seen) >= FIRST_AT
        return len(seen) >= asked.due

    def _said(
        self, frame_id: int, due: Collection[int], answers: Mapping[int, Identification]
    ) -> Iterator[Identified]:
        unknown = {n: self._asked[n].compared.seen for n in due if answers[n].verdict == "unknown"}
        past = self._past.ledger_names(unknown, self._config.site.to_site()) if self._past else {}
        for track_id, found in answers.items():
            best = found.matches[0].norad_id if found.matches else None
            said, asked = (found.verdict, best), self._asked[track_id]
            if track_id in due or said != asked.said:
                self._asked[track_id] = replace(asked, said=said)
                name = identification_record(frame_id, track_id, found, len(asked.compared.seen))
                yield _with_past(name, past.get(track_id))


def identification_record(
    frame_id: int, track_id: int, found: Identification, observations: int
) -> Identified:
    """Return the record of a track's identification in a frame.

    ``observations``: number of directions that were compared.
    """
    return Identified(
        frame_id=frame_id,
        track_id=track_id,
        verdict=found.verdict,
        reason=found.reason,
        hint=found.hint,
        observations=observations,
        catalogued=found.catalogued,
        matches=tuple(_match(each) for each in found.matches[:_MAX_MATCHES]),
        not_catalogued=found.not_catalogued,
        named_with=found.named_with,
    )


def _with_past(name: Identified, past: LedgerName | None) -> Identified:
    """Return an unknown track's identification with its name in the ledger."""
    if past is None or name.verdict != "unknown":
        return name
    return replace(name, ledger=past, reason=f"{ledger_words(past)}: {name.reason}")


def _match(match: ObjectMatch) -> CatalogueMatch:
    return CatalogueMatch(**{f.name: getattr(match, f.name) for f in fields(CatalogueMatch)})
