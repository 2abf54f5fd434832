"""Outlook of an orbit: places with their sigmas, the site's limit, the Earth's shadow. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits import KnownOrbit, predict
from rsoconsole.pipeline.visibility.passes import margin_deg
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, astrometric_places, icrs_to_altaz, lit_fraction
from rsoconsole.words import NS_PER_S

AHEAD_S = 86_400
_STEP_S = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class FuturePosition:
    """Predicted position of the object at one instant."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    sigma_arcsec: float
    """Half the longer axis of the one-sigma ellipse."""
    altitude_deg: float
    azimuth_deg: float
    range_km: float
    lit: float
    """Visible fraction of the Sun's disc, as seen from the object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitOutlook:
    """Places and events of an object after its last direction."""

    ahead: tuple[FuturePosition, ...]
    is_up: bool
    """True where it is above the telescope's altitude limit at the beginning."""
    sets_utc_ns: int | None
    """Instant at which it next sinks below the altitude limit; None: not within a day."""
    rises_utc_ns: int | None
    eclipse_utc_ns: tuple[int, int | None] | None
    """Begin and end of the next eclipse, partial phase included; None: not within a day."""


def orbit_outlook(
    orbit: KnownOrbit, site: Site, limits: LimitsConfig, from_utc_ns: int, ahead_s: Sequence[int]
) -> OrbitOutlook:
    """Return the places at ``ahead_s`` seconds after an instant, and the events within a day."""
    since = np.arange(0, AHEAD_S + _STEP_S, _STEP_S)
    t = from_utc_ns + since * NS_PER_S
    r, v = orbit.states(t)

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        # In the time that light takes the motion is straight.
        return r + v * ((at - t) / NS_PER_S)[:, None], v

    places = astrometric_places(position_of, site, t)
    altitude_deg, azimuth_deg = icrs_to_altaz(site, places.ra_icrs_deg, places.dec_icrs_deg, t)
    excess_deg = margin_deg(altitude_deg, azimuth_deg, limits)
    lit = lit_fraction(r, t)
    return OrbitOutlook(
        ahead=_ahead(orbit, site, from_utc_ns + np.array(ahead_s, np.int64) * NS_PER_S),
        is_up=bool(excess_deg[0] > 0.0),
        sets_utc_ns=_first(t, (excess_deg[:-1] > 0.0) & (excess_deg[1:] <= 0.0), excess_deg),
        rises_utc_ns=_first(t, (excess_deg[:-1] <= 0.0) & (excess_deg[1:] > 0.0), excess_deg),
        eclipse_utc_ns=_eclipse(t, lit),
    )


def _ahead(orbit: KnownOrbit, site: Site, t_utc_ns: IntArray) -> tuple[FuturePosition, ...]:
    predicted = predict(orbit, site, t_utc_ns)
    places, sigma = predicted.places, predicted.sigma_arcsec
    altitude_deg, azimuth_deg = icrs_to_altaz(
        site, places.ra_icrs_deg, places.dec_icrs_deg, t_utc_ns
    )
    lit = lit_fraction(places.position_gcrs_km, t_utc_ns)
    return tuple(
        FuturePosition(
            t_utc_ns=int(t_utc_ns[n]),
            ra_icrs_deg=float(places.ra_icrs_deg[n]),
            dec_icrs_deg=float(places.dec_icrs_deg[n]),
            sigma_arcsec=float(sigma[n]),
            altitude_deg=float(altitude_deg[n]),
            azimuth_deg=float(azimuth_deg[n]),
            range_km=float(places.range_km[n]),
            lit=float(lit[n]),
        )
        for n in range(len(t_utc_ns))
    )


def _first(t: IntArray, crosses: npt.NDArray[np.bool_], value: FloatArray) -> int | None:
    """Instant at which ``value`` first passes 0, where it ``crosses`` between two steps."""
    found = np.flatnonzero(crosses)
    if not found.size:
        return None
    n = int(found[0])
    share = value[n] / (value[n] - value[n + 1])
    return int(t[n]) + round(float(share) * _STEP_S * NS_PER_S)


def _eclipse(t: IntArray, lit: FloatArray) -> tuple[int, int | None] | None:
    """Return begin and end of the eclipse, to the minute."""
    dimmed = np.flatnonzero(lit < 1.0)
    if not dimmed.size:
        return None
    begin = int(dimmed[0])
    whole = np.flatnonzero(lit[begin:] >= 1.0)
    return int(t[begin]), int(t[begin + whole[0]]) if whole.size else None
