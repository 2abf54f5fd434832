"""Variance scales and timing scatters that a bank of filters weighs. Pure."""

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.tracking.filters.motions import MOTIONS

VARIANCE_SCALES = np.array([0.5, 1.0, 2.2, 5.0, 12.0, 30.0, 80.0])
"""Factors on a measurement's own variances, across the motion as well as along it."""
MAX_SCATTER_S = 3.0
MIN_SCATTER_S = 0.005
SCATTERS_S = np.geomspace(MIN_SCATTER_S, MAX_SCATTER_S, 14)
"""Timing scatters of the filters, s, beyond the scatter in the measurements' covariances."""


@dataclass(frozen=True, eq=False)
class FilterGrid:
    """Variance scales and timing scatters that a bank weighs against each other."""

    variance_scales: FloatArray
    """(V,) factors on the measured variances."""
    scatters_s: FloatArray
    """(S,) timing scatters, s."""

    @property
    def filters_per_motion(self) -> int:
        """Number of filters of each motion."""
        return len(self.variance_scales) * len(self.scatters_s)

    @functools.cached_property
    def filter_timing_scatters_s(self) -> FloatArray:
        """(N,) timing scatter of each filter of a bank, in the bank's order, s."""
        return np.tile(self.scatters_s, len(MOTIONS) * len(self.variance_scales))

    @functools.cached_property
    def filter_variance_scales(self) -> FloatArray:
        """(N,) factor of each filter on the measured variances, in the bank's order."""
        each = np.repeat(self.variance_scales, len(self.scatters_s))
        return np.tile(each, len(MOTIONS))

    @functools.cached_property
    def filter_motions(self) -> npt.NDArray[np.intp]:
        """(N,) index of each filter's motion in ``MOTIONS``."""
        return np.repeat(np.arange(len(MOTIONS)), self.filters_per_motion)


FINE = FilterGrid(VARIANCE_SCALES, SCATTERS_S)
COARSE = FilterGrid(VARIANCE_SCALES[1::2], SCATTERS_S[1::2])
"""Grid for tracks beside the lead where there are many: every second scale and scatter."""
