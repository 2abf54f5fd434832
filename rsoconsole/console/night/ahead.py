"""An orbit and where it leads from an instant on: computed by the outlook's thread, then shown."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.config import Config, load_config
from rsoconsole.errors import RsoconsoleError
from rsoconsole.night import NightView
from rsoconsole.records import Identified, OrbitEstimate
from rsoconsole.session.reading import SessionReader

if TYPE_CHECKING:
    from rsoconsole.orbits.elements import CatalogueEntry
    from rsoconsole.pipeline.orbits import OrbitOutlook

log = logging.getLogger(__name__)

AHEAD_S = (600, 3600, 86_400)
HOLDS_ORBITS_SINCE = 3
"""The schema from which on a session has its orbits on record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitAhead:
    """Where an orbit leads."""

    folder: Path | None
    """The session that it belongs to."""
    seq: int
    """Place of its log up to which that was known."""
    estimate: OrbitEstimate
    identified: Identified | None = None
    """Computed along with it; None where it is for the record to say."""
    is_computed: bool = False
    """The session holds no orbits: this one was found now, from its measurements."""
    from_utc_ns: int
    outlook: "OrbitOutlook | None"
    """None where the orbit leads nowhere."""
    elements: Mapping[str, float] = field(default_factory=dict)
    """By name: ``e``, ``i_deg``, ``raan_deg``, ``argp_deg`` and others."""
    sigmas: Mapping[str, float | None] = field(default_factory=dict)
    """Of the same; None where the orbit does not fix one at all."""


def orbit_ahead(
    estimate: OrbitEstimate,
    config: Config,
    from_utc_ns: int,
    *,
    folder: Path | None = None,
    seq: int = 0,
    identified: Identified | None = None,
    is_computed: bool = False,
) -> OrbitAhead:
    """Where it leads from that instant on, seen from the configured site; about half a second."""
    # Late: the sky's computation loads slowly, and the first paint does not wait for it.
    from rsoconsole.orbits.motion import orbit_from_record
    from rsoconsole.pipeline.orbits import orbit_outlook
    from rsoconsole.pipeline.words import element_sigmas, elements_by_name

    orbit = orbit_from_record(estimate)
    return OrbitAhead(
        folder=folder,
        seq=seq,
        estimate=estimate,
        identified=identified,
        is_computed=is_computed,
        from_utc_ns=from_utc_ns,
        outlook=orbit_outlook(orbit, config.site.to_site(), config.limits, from_utc_ns, AHEAD_S),
        elements=elements_by_name(orbit.r_km, orbit.v_km_s),
        sigmas=element_sigmas(orbit),
    )


def ahead_of_record(night: NightView, from_utc_ns: int) -> OrbitAhead | None:
    """The same for a session that is too old to hold orbits: found from what it measured so far.

    Named by the catalogue of the present configuration. None where there is no orbit.
    """
    if night.folder is None or night.config is None:
        return None
    reader = SessionReader(night.folder)
    if reader.schema_version >= HOLDS_ORBITS_SINCE:
        return None
    from rsoconsole.pipeline.orbits import recorded_orbit

    files, gate_deg = _present_catalogue()
    found = recorded_orbit(reader, night.seq, _entries(files), gate_deg=gate_deg)
    if found is None:
        return None
    estimate, identified = found
    return orbit_ahead(
        estimate,
        night.config,
        from_utc_ns,
        folder=night.folder,
        seq=night.seq,
        identified=identified,
        is_computed=True,
    )


def _present_catalogue() -> tuple[tuple[Path, ...], float]:
    catalogue = load_config().catalogue
    return catalogue.tle_files, catalogue.gate_deg


@lru_cache(maxsize=1)
def _entries(files: tuple[Path, ...]) -> Sequence["CatalogueEntry"]:
    """Of files that cannot be read, none: the orbit is shown all the same."""
    from rsoconsole.pipeline.orbits import read_catalogue

    try:
        return read_catalogue(files)
    except RsoconsoleError as error:
        log.warning("%s", error)
        return ()
