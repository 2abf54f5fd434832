"""Order in which orbits are refined: the lead's each frame, a large group's in turn. Pure.

Refining an orbit takes some milliseconds, and in a large group one more direction hardly changes
that of a member. A track that has just been missed is refined at once with all its measurements, so
that its orbit can predict it while it coasts.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits import Orbit, predict
from rsoconsole.pipeline.cycle.predictor_scores import Score
from rsoconsole.pipeline.cycle.track_assignment import Track
from rsoconsole.records import Measurement, Site
from rsoconsole.sky import wrap_180
from rsoconsole.tracking import MANY

AT_ONCE = 2
"""Number of tracks beside the lead whose orbits one frame refines; one above ``MANY``."""
_LATE = 6
"""Number of new measurements after which a track of a large group waits for no missed one."""


def refinement_order(
    tracks: Sequence[Track], known: Sequence[tuple[Measurement, ...]], newest_frame_id: int
) -> list[int]:
    """Return the indices in ``tracks`` of those to refine after a frame, in rising order.

    ``tracks``: the lead first, which is always refined; ``known``: measurements in each track's
    present orbit. Tracks just missed are refined, and of the others those whose number of
    measurements has grown most in proportion.
    """
    if len(tracks) <= 1 + AT_ONCE:
        return list(range(len(tracks)))
    waiting = [n for n in range(1, len(tracks)) if tuple(tracks[n].measurements) != known[n]]
    missed = [n for n in waiting if tracks[n].last.frame_id < newest_frame_id]
    others = [n for n in waiting if n not in missed]
    others.sort(key=lambda n: -len(tracks[n].measurements) / max(len(known[n]), 1))
    room = max(AT_ONCE - len(missed), 1)
    if len(tracks) > MANY:
        late = [n for n in others if len(tracks[n].measurements) - len(known[n]) >= _LATE]
        room = 1 if late or not missed else 0
    return sorted([0, *missed, *others[:room]])


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitInnovation:
    """Innovation of one measurement against an orbit's prediction, with the prediction's score."""

    score: Score
    innovation_arcsec: tuple[float, float]
    """Innovation east and north."""
    sigma_arcsec: tuple[float, float]
    """Sigma of the innovation, east and north."""


def orbit_innovation(orbit: Orbit, site: Site, measured: Measurement) -> OrbitInnovation | None:
    """Innovation of a measurement against an orbit; None where the orbit gives no prediction."""
    ahead = predict(orbit, site, np.array([measured.t_mid_utc_ns]))
    places = ahead.places
    cos_dec = math.cos(math.radians(measured.dec_icrs_deg))
    off_ra = wrap_180(measured.ra_icrs_deg - float(places.ra_icrs_deg[0]))
    off = np.array([off_ra * cos_dec, measured.dec_icrs_deg - float(places.dec_icrs_deg[0])])
    off *= 3600.0
    ee, en, nn = ahead.cov_sky_arcsec2[0] + np.array(measured.cov_sky_arcsec2)
    s = np.array([[ee, en], [en, nn]])
    if not np.all(np.isfinite(s)) or not np.all(np.isfinite(off)):
        return None
    return OrbitInnovation(
        score=Score(
            nis=float(off @ np.linalg.solve(s, off)), log_size=float(np.linalg.slogdet(s)[1])
        ),
        innovation_arcsec=(float(off[0]), float(off[1])),
        sigma_arcsec=(math.sqrt(ee), math.sqrt(nn)),
    )
