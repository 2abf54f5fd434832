"""How far along and across its path an object may be: seconds and kilometres. Pure.

By the error model of ``element_errors``, assumed from the literature or measured, in three cases
whose shares add up to 1: it has kept to its orbit, it has been moved since its epoch, or something
that no model knows (a decay in a magnetic storm, elements of a wrong instant): low ones are then
tens of seconds off.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.identification.element_errors import (
    ASSUMED,
    ERROR_REGIMES,
    ElementErrors,
    manoeuvred_probabilities,
    position_sigmas_km,
)
from rsoconsole.records import FloatArray

GATE_SIGMAS = 3.0
OLDEST_DAYS = 60.0
"""Beyond it nothing is known of how elements err."""
LOW_GATE_S = 60.0
"""Low objects are sought at least so far along their path."""
MOST_GATE_S = 600.0
_STRANGE_SHARE = 0.03
_STRANGE_TIMES = 2.0
"""What no model knows is so much wider than a manoeuvre."""
_STRANGE_LOW_KM = 200.0
"""27 s along the path of a low orbit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementSpread:
    """Of M objects in three cases, (M, 3) each: kept to the orbit, moved, strange."""

    share: FloatArray
    radial_km: FloatArray
    """One sigma, as the others."""
    along_km: FloatArray
    across_km: FloatArray
    gate_along_km: FloatArray
    """(M,)"""

    def of(self, chosen: npt.NDArray[np.intp]) -> "ElementSpread":
        """The same of some of the objects."""
        return ElementSpread(
            share=self.share[chosen],
            radial_km=self.radial_km[chosen],
            along_km=self.along_km[chosen],
            across_km=self.across_km[chosen],
            gate_along_km=self.gate_along_km[chosen],
        )


def element_spread(
    regimes: npt.NDArray[np.intp],
    age_days: FloatArray,
    speed_km_s: FloatArray,
    errors: ElementErrors = ASSUMED,
) -> ElementSpread:
    """Of objects (M,) in those regimes, with elements so old, at that speed."""
    count = len(regimes)
    share, radial, along, across = (np.zeros((count, 3)) for _ in range(4))
    for number, regime in enumerate(ERROR_REGIMES):
        here = np.flatnonzero(regimes == number)
        age = age_days[here]
        moved = manoeuvred_probabilities(regime, age)
        known = 1.0 - _STRANGE_SHARE
        share[here] = np.stack(
            [known * (1.0 - moved), known * moved, np.full(len(here), _STRANGE_SHARE)], axis=-1
        )
        for case in range(2):
            sigmas = position_sigmas_km(errors.of(regime, is_moved=case == 1), age)
            radial[here, case], along[here, case], across[here, case] = sigmas
        for each in (radial, along, across):
            each[here, 2] = _STRANGE_TIMES * each[here, 1]
        if regime == "LEO":
            # What is late by drag keeps its plane.
            across[here, 2] = across[here, 1]
            along[here, 2] = np.maximum(_STRANGE_LOW_KM, along[here, 1])
    gate = GATE_SIGMAS * np.maximum(along[:, 1], along[:, 0])
    gate = np.where(
        regimes == ERROR_REGIMES.index("LEO"), np.maximum(gate, LOW_GATE_S * speed_km_s), gate
    )
    return ElementSpread(
        share=share,
        radial_km=radial,
        along_km=along,
        across_km=across,
        gate_along_km=np.minimum(gate, MOST_GATE_S * speed_km_s),
    )
