"""An orbit and where it leads from an instant on: computed by the outlook's thread, then shown."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.config import Config
from rsoconsole.records import OrbitEstimate

if TYPE_CHECKING:
    from rsoconsole.pipeline.orbits import OrbitOutlook

AHEAD_S = (600, 3600, 86_400)


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitAhead:
    """Where an orbit leads."""

    folder: Path | None
    """The session that it belongs to."""
    estimate: OrbitEstimate
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
) -> OrbitAhead:
    """Where it leads from that instant on, seen from the configured site; about half a second."""
    # Late: the sky's computation loads slowly, and the first paint does not wait for it.
    from rsoconsole.orbits.motion import orbit_from_record
    from rsoconsole.pipeline.orbits import orbit_outlook
    from rsoconsole.pipeline.words import element_sigmas, elements_by_name

    orbit = orbit_from_record(estimate)
    return OrbitAhead(
        folder=folder,
        estimate=estimate,
        from_utc_ns=from_utc_ns,
        outlook=orbit_outlook(orbit, config.site.to_site(), config.limits, from_utc_ns, AHEAD_S),
        elements=elements_by_name(orbit.r_km, orbit.v_km_s),
        sigmas=element_sigmas(orbit),
    )
