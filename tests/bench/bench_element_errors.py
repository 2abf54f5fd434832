"""How far three geostationary satellites were from where older element sets had put them.

Run: ``python -m tests.bench.bench_element_errors``. The table stands in
``rsoconsole/orbits/identification/element_errors.py``.
"""

from pathlib import Path

import numpy as np

from rsoconsole.orbits import ElementSet, Satellite, parse_elements
from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_DAY

HISTORY = Path(__file__).parents[3] / "shared" / "data" / "tles" / "geo_3sats_history_2019_2025.tle"
AGES_DAYS = ((3, 7), (7, 14), (14, 20), (20, 25), (25, 35), (35, 60))
LOOKED_AHEAD = 7
MEAN_MOTION_RAD_S = 7.2921e-5


def measured_errors() -> FloatArray:
    """(N, 7): age in days; true minus predicted (radial, along, across) km and their rates, km/s.

    True is where the newer set puts the satellite at its own epoch.
    """
    sets = parse_elements(HISTORY.read_text(encoding="ascii"), HISTORY.name)
    rows = []
    for norad_id in sorted({each.norad_id for each in sets}):
        own = sorted(
            {each.epoch_utc_ns: each for each in sets if each.norad_id == norad_id}.values(),
            key=lambda each: each.epoch_utc_ns,
        )
        for place, older in enumerate(own):
            rows += [_error(older, newer) for newer in own[place + 1 : place + 1 + LOOKED_AHEAD]]
    return np.array(rows)


def _error(older: ElementSet, newer: ElementSet) -> list[float]:
    at = np.array([newer.epoch_utc_ns])
    (r,), (v,) = Satellite(newer).position_gcrs(at)
    (r_old,), (v_old,) = Satellite(older).position_gcrs(at)
    radial = r / np.linalg.norm(r)
    pole = np.cross(r, v)
    pole /= np.linalg.norm(pole)
    frame = np.array([radial, np.cross(pole, radial), pole])
    place = frame @ (r - r_old)
    rate = frame @ (v - v_old) - np.cross([0.0, 0.0, MEAN_MOTION_RAD_S], place)
    return [(newer.epoch_utc_ns - older.epoch_utc_ns) / NS_PER_DAY, *place, *rate]


def main() -> None:
    """Print the table."""
    errors = measured_errors()
    print("age, days   sets   radial 68/95 %   along 68/95 %   across 68/95 %  km")
    for low, high in AGES_DAYS:
        chosen = np.abs(errors[(errors[:, 0] >= low) & (errors[:, 0] < high), 1:4])
        words = "   ".join(
            f"{np.percentile(column, 68):6.1f} {np.percentile(column, 95):6.1f}"
            for column in chosen.T
        )
        print(f"{low:4d}-{high:<4d} {len(chosen):6d}   {words}")


if __name__ == "__main__":
    main()
