"""Kinds of orbits, and what may be believed of them before one is seen. Pure.

Of the 1,628 catalogued objects with a geostationary semi-major axis on 2023-06-22, three quarters
had an eccentricity below 2.1e-3; of those held over the equator (inclination below 0.2 deg) 99 in
100 had less than 7.5e-4. One in eight has more than 6e-3: to those the prior is a lie, which only a
longer arc finds out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

PriorName = Literal["auto", "none", "geo", "meo"]
AUTOMATIC: tuple[PriorName, ...] = ("geo", "meo")
"""Which regimes ``auto`` tries, in this order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Regime:
    """Where orbits of a kind are, and what is believed of them."""

    sigma_e: float
    """Root mean square of the eccentricity."""
    lowest_a_km: float
    highest_a_km: float


REGIMES: Mapping[str, Regime] = {
    "geo": Regime(sigma_e=2e-3, lowest_a_km=40_164.0, highest_a_km=44_164.0),
    "meo": Regime(sigma_e=2e-2, lowest_a_km=18_000.0, highest_a_km=34_000.0),
}
"""By the names of priors."""
