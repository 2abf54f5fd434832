"""A whole pass before its first leap: how many leaps, where it is cut, and where to wait for it.

Pure. A German mount changes sides where a target lies past the meridian, which takes most of a
minute; near the pole its polar axis cannot follow. Both are in the leaps themselves, so the plan of
a pass is its leaps, one after another, as this mount would do them.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion import SkyPath
from rsoconsole.pipeline.leaps.leaps import Leap, NoLeap, Telescope, next_leap
from rsoconsole.records import Site
from rsoconsole.sky import NS_PER_S, site_gcrs, unit_to_direction
from rsoconsole.sky.limits import Pose

_MOST = 500
CLOSED_S = 0.05
"""From the end of an exposure until the shutter has surely closed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PassPlan:
    """All leaps of a pass, if each is met."""

    leaps: tuple[Leap, ...]
    end: NoLeap
    """Why there is none after the last."""

    @property
    def flips(self) -> int:
        """How often the mount changes the side of its pier."""
        return sum(each.flips for each in self.leaps)

    @property
    def longest_gap_s(self) -> float:
        """Between two exposures; 0 with fewer than two."""
        middles = [each.t_mid_utc_ns for each in self.leaps]
        return float(np.max(np.diff(middles))) / NS_PER_S if len(middles) > 1 else 0.0


def plan_pass(
    path: SkyPath,
    start: Pose,
    now_utc_ns: int,
    telescope: Telescope,
    *,
    first: Leap | None = None,
    sure_from: int | None = None,
) -> PassPlan:
    """Leap after leap until it sets or a limit ends it.

    ``first``: the one under way. From the ``sure_from``-th on the next slew is ordered when the
    shutter has closed, before that, or with None, when the frame has been read out.
    """
    leaps: list[Leap] = []
    pose, now = start, now_utc_ns
    while len(leaps) < _MOST:
        found = next_leap(path, pose, now, telescope) if leaps or first is None else first
        if isinstance(found, NoLeap):
            return PassPlan(leaps=tuple(leaps), end=found)
        leaps.append(found)
        waits = sure_from is None or len(leaps) < sure_from
        pause_s = telescope.terms.readout_s if waits else CLOSED_S
        now = found.t_close_utc_ns + round(pause_s * NS_PER_S)
        ra, dec = found.place.direction_deg
        pose = Pose(t_utc_ns=now, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=found.side)
    return PassPlan(leaps=tuple(leaps), end=NoLeap(kind="it sets"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stare:
    """Where to wait for a pass: at a point of its orbit, until it has surely gone by."""

    t_through_utc_ns: int
    """When it goes through that point, if it keeps its time."""
    from_utc_ns: int
    until_utc_ns: int
    point_gcrs_km: tuple[float, float, float]

    def direction_deg(self, site: Site, t_utc_ns: int) -> tuple[float, float]:
        """Where that point of the orbit is seen: early or late, it comes through there.

        Light time and aberration (20 arcsec at most) are left out.
        """
        places, _ = site_gcrs(site, np.array([t_utc_ns]))
        ra, dec = unit_to_direction(np.array(self.point_gcrs_km) - places[0])
        return float(ra), float(dec)


def duty(exposure_s: float, latency_s: float, readout_s: float) -> float:
    """Share of the time for which the shutter is open while exposures follow each other."""
    return exposure_s / (exposure_s + latency_s + readout_s)
