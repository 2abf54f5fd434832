"""Which catalogued object is followed, asked again and again while more of it is seen."""

import threading
from collections.abc import Sequence
from pathlib import Path

from rsoconsole.config import Config
from rsoconsole.errors import OrbitError
from rsoconsole.orbit.catalogue import CatalogueEntry
from rsoconsole.orbit.identify import Identification, Match, identify
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.pipeline.catalogue_files import read_catalogue
from rsoconsole.pipeline.sightings_of import longest_arc
from rsoconsole.records import CatalogueMatch, Identified, Site

FIRST_AT = 3
_MORE = 1.5
"""Asked again with so many times as many directions."""
_MOST_MATCHES = 3


class Catalogue:
    """The element sets of the configuration's files, read beside whatever else is done."""

    def __init__(self, files: Sequence[Path]) -> None:
        self._files = tuple(files)
        self._entries: tuple[CatalogueEntry, ...] = ()
        self._fault: OrbitError | None = None
        self._reading = threading.Thread(target=self._read, name="catalogue", daemon=True)
        self._reading.start()

    @property
    def files(self) -> tuple[Path, ...]:
        """Where it is from."""
        return self._files

    def entries(self) -> tuple[CatalogueEntry, ...]:
        """All of them, as soon as they are read. Raises OrbitError for a file that cannot be."""
        self._reading.join()
        if self._fault is not None:
            raise self._fault
        return self._entries

    def _read(self) -> None:
        try:
            self._entries = read_catalogue(self._files)
        except OrbitError as error:
            self._fault = error
        except Exception as error:  # whoever asks hears of it
            self._fault = OrbitError(f"the catalogue cannot be read: {error}")


class Naming:
    """Knows with how many directions each track is to be asked of next."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._catalogue = Catalogue(config.catalogue.tle_files)
        self._due: dict[int, tuple[int, int]] = {}
        """By track id: when its first direction was seen, and how many are needed."""

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        if config.catalogue.tle_files != self._catalogue.files:
            self._catalogue = Catalogue(config.catalogue.tle_files)
            self._due = {}
        self._config = config

    def ask(self, frame_id: int, track_id: int, seen: Sightings) -> Identified | None:
        """A name for what a track saw, where it is time to ask and there is a catalogue.

        Raises OrbitError where the catalogue cannot be read.
        """
        begun_utc_ns = int(seen.t_utc_ns[0])
        of, due = self._due.get(track_id, (begun_utc_ns, FIRST_AT))
        if of != begun_utc_ns:
            due = FIRST_AT
        if not self._catalogue.files or len(seen) < due:
            return None
        self._due[track_id] = (begun_utc_ns, max(round(_MORE * len(seen)), len(seen) + 1))
        return identified(
            frame_id,
            track_id,
            longest_arc(seen),
            self._config.site.to_site(),
            self._catalogue.entries(),
            gate_deg=self._config.catalogue.gate_deg,
        )


def identified(
    frame_id: int,
    track_id: int,
    seen: Sightings,
    site: Site,
    entries: Sequence[CatalogueEntry],
    *,
    gate_deg: float,
) -> Identified:
    """What is put on record of an identification."""
    found: Identification = identify(seen, site, entries, gate_deg=gate_deg)
    return Identified(
        frame_id=frame_id,
        track_id=track_id,
        verdict=found.verdict,
        reason=found.reason,
        hint=found.hint,
        observations=len(seen),
        catalogued=found.catalogued,
        matches=tuple(_match(each) for each in found.matches[:_MOST_MATCHES]),
    )


def _match(match: Match) -> CatalogueMatch:
    return CatalogueMatch(
        norad_id=match.norad_id,
        name=match.name,
        separation_arcsec=match.separation_arcsec,
        along_track_s=match.along_track_s,
        cross_track_arcsec=match.cross_track_arcsec,
        rate_difference_percent=match.rate_difference_percent,
        tle_age_days=match.tle_age_days,
        score=match.score,
        probability=match.probability,
    )
