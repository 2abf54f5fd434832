"""What an orbit said of a measurement before it was fitted to it. Pure."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.determination import Orbit
from rsoconsole.orbits.motion import predict
from rsoconsole.pipeline.cycle import Score
from rsoconsole.records import Measurement, Site
from rsoconsole.sky import wrap_180


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """How an orbit fared with one measurement."""

    short: Score
    innovation_arcsec: tuple[float, float]
    """East, north."""
    sigma_arcsec: tuple[float, float]
    """Of the innovation."""


def predicted_by(orbit: Orbit, site: Site, measured: Measurement) -> Predicted | None:
    """The innovation of a measurement by an orbit; None where the orbit tells nothing there."""
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
    return Predicted(
        short=Score(
            nis=float(off @ np.linalg.solve(s, off)), log_size=float(np.linalg.slogdet(s)[1])
        ),
        innovation_arcsec=(float(off[0]), float(off[1])),
        sigma_arcsec=(math.sqrt(ee), math.sqrt(nn)),
    )
