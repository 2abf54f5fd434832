"""Kinds of orbits, and what may be believed of them before one is seen. Pure.

Figures of the catalogue of 2023-06-22, at noon of that day. Of 364 geostationary satellites held
over the equator (inclination below 0.35 deg on GCRS axes, axis within 15 km of 42,166) the
osculating semi-major axis scattered by 0.62 km about 42,165.9, 95 in 100 within 1.2 km, one beyond
3.6; 98 in 100 had an eccentricity below 6.9e-4. The prior ``slot`` has twice that scatter, for
tails longer than a normal error's. Of all 1,632 objects near that axis three quarters had an
eccentricity below 2.1e-3, but one in eight has more than 6e-3: to those the prior ``geo`` is a lie,
which only a longer arc finds out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rsoconsole.orbits.determination.fit import Prior
from rsoconsole.orbits.first import State
from rsoconsole.orbits.motion import axis_and_inclination

PriorName = Literal["auto", "none", "slot", "geo", "meo"]
AUTOMATIC: tuple[PriorName, ...] = ("slot", "geo", "meo")
"""Which regimes ``auto`` tries, in this order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Regime:
    """Where orbits of a kind are, and what is believed of them."""

    words: str
    """The belief."""
    prior: Prior
    lowest_a_km: float
    highest_a_km: float
    highest_i_deg: float = 180.0
    """Along GCRS axes, from whose equator that of date is 0.15 deg off."""

    @property
    def dimensions(self) -> int:
        """Of the belief."""
        return 2 if self.prior.a_km is None else 3

    def holds(self, state: State) -> bool:
        """Whether an orbit is of this kind."""
        a_km, i_deg = axis_and_inclination(*state)
        return self.lowest_a_km <= a_km <= self.highest_a_km and i_deg <= self.highest_i_deg


REGIMES: Mapping[str, Regime] = {
    "slot": Regime(
        words="held over the equator: a 42,166 km to 1.2 km, eccentricity about 4e-4",
        prior=Prior(sigma_e=4e-4, a_km=42_165.9, sigma_a_km=1.2),
        lowest_a_km=42_150.0,
        highest_a_km=42_180.0,
        highest_i_deg=0.4,
    ),
    "geo": Regime(
        words="eccentricity about 0.002",
        prior=Prior(sigma_e=2e-3),
        lowest_a_km=40_164.0,
        highest_a_km=44_164.0,
    ),
    "meo": Regime(
        words="eccentricity about 0.02",
        prior=Prior(sigma_e=2e-2),
        lowest_a_km=18_000.0,
        highest_a_km=34_000.0,
    ),
}
"""By the names of priors."""
