"""Which tracks were seen at the same time, so that they are of different objects. Pure.

A track that is found again after it was lost has a gap in it, in which it was nowhere: another that
was seen only there may be the same object.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.first import Sightings
from rsoconsole.sky import NS_PER_S

GAP_S = 600.0
"""Nothing seen of a track for longer than that: it may have been lost meanwhile."""


def seen_at_once(tracks: Sequence[Sightings]) -> npt.NDArray[np.bool_]:
    """(T, T) whether any two stretches of two tracks overlap, a gap being in neither."""
    stretches = [_stretches(each) for each in tracks]
    found = np.zeros((len(tracks), len(tracks)), bool)
    for one, (begins, ends) in enumerate(stretches):
        for other in range(one + 1):
            starts, lasts = stretches[other]
            overlaps = (begins[:, None] <= lasts[None, :]) & (starts[None, :] <= ends[:, None])
            found[one, other] = found[other, one] = bool(np.any(overlaps))
    return found


def _stretches(seen: Sightings) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last instants of each."""
    t = np.asarray(seen.t_utc_ns, np.int64)
    cuts = np.flatnonzero(np.diff(t) > GAP_S * NS_PER_S)
    return np.concatenate([t[:1], t[cuts + 1]]), np.concatenate([t[cuts], t[-1:]])
