"""Where made-up satellites stand over the Earth."""

import erfa
import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import TimeLike, jd_ut1
from rsoconsole.sky.times import jd_tt


def gmst_deg(t_utc_ns: TimeLike) -> FloatArray:
    """Greenwich mean sidereal time, 0 to 360 (IAU 2006)."""
    return np.asarray(np.degrees(erfa.gmst06(*jd_ut1(t_utc_ns), *jd_tt(t_utc_ns))))
