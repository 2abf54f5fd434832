"""The orbit as it could have been known at a place of a session's log that holds none."""

from collections.abc import Sequence

from rsoconsole.config import OrbitConfig
from rsoconsole.orbits.elements import CatalogueEntry
from rsoconsole.pipeline.cycle import TracksTaken
from rsoconsole.pipeline.orbits.element_errors_of import errors_of
from rsoconsole.pipeline.orbits.naming import identified
from rsoconsole.pipeline.orbits.orbit_online import OnlineOrbit
from rsoconsole.pipeline.orbits.sightings_of import longest_arc
from rsoconsole.records import FrameTaken, Identified, OrbitEstimate
from rsoconsole.session.reading import SessionReader


def recorded_orbit(
    reader: SessionReader,
    until_seq: int,
    entries: Sequence[CatalogueEntry] = (),
    *,
    gate_deg: float = 0.2,
) -> tuple[OrbitEstimate, Identified | None] | None:
    """Orbit and name of the last lead up to a place of the log; None where there is none.

    ``entries``: a catalogue to name it by. Raises SessionError.
    """
    config = reader.config().model_copy(update={"orbit": OrbitConfig()})
    online = OnlineOrbit(config)
    for seq, _, record in reader.records(kinds=(FrameTaken, *TracksTaken.KINDS)):
        if seq > until_seq:
            break
        online.receive(record)
    refined = online.refine()
    if not refined:
        return None
    estimate = refined[0].estimate
    if not entries:
        return estimate, None
    arc, site = longest_arc(refined[0].seen), config.site.to_site()
    name = identified(
        estimate.frame_id,
        estimate.track_id,
        arc,
        site,
        entries,
        gate_deg=gate_deg,
        errors=errors_of(config.catalogue),
    )
    return estimate, name
