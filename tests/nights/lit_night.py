"""A made-up night whose streaks have a brightness, and its track an orbit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from rsoconsole.records import Measurement, OrbitEstimate, Photometry, StreakLight
from rsoconsole.session import SessionWriter
from tests.nights.export_nights import T0, written_night
from tests.nights.orbit_night import estimate_of

SATURATED, INSTRUMENTAL, WITHOUT_LIGHT = 3, 4, 5
"""Frames that differ from the others."""
MAG, MAG_SIGMA, COLOUR_SIGMA = 12.4, 0.03, 0.04
ZERO_POINT_MAG, ZERO_POINT_SIGMA_MAG, LIMITING_MAG = 21.25, 0.02, 14.5


def light_of(measured: Measurement) -> StreakLight:
    frame_id = measured.frame_id
    is_in_v = frame_id != INSTRUMENTAL
    return StreakLight(
        measurement_id=measured.measurement_id,
        flux_adu=9000.0,
        flux_sigma_adu=90.0,
        rate_adu_s=900.0,
        rate_sigma_adu_s=9.0,
        band="V" if is_in_v else "instrumental",
        mag=MAG + 0.01 * frame_id if is_in_v else -7.4,
        mag_sigma=MAG_SIGMA,
        mag_sigma_colour=COLOUR_SIGMA if is_in_v else None,
        is_saturated=frame_id == SATURATED,
    )


def photometry_of(frame_id: int, measured: tuple[Measurement, ...]) -> Photometry:
    nothing = Photometry(frame_id=frame_id, streaks=tuple(map(light_of, measured)))
    if frame_id == INSTRUMENTAL:
        return nothing
    if frame_id == WITHOUT_LIGHT:
        nothing = replace(nothing, streaks=())
    return replace(
        nothing,
        zero_point_mag=ZERO_POINT_MAG,
        zero_point_sigma_mag=ZERO_POINT_SIGMA_MAG,
        zero_point_stars=31,
        limiting_mag=LIMITING_MAG,
    )


def orbit_of(frame_id: int, **changes: Any) -> OrbitEstimate:
    """Of a geostationary satellite; it says nothing of where the streaks are."""
    return estimate_of(frame_id, **({"epoch_utc_ns": T0} | changes))


def lit_night(folder: Path, *, label: str = "constrained by prior", about: Any = None) -> Path:
    """A closed session; ``label``: of the track's orbits."""

    def more(frame_id: int, measured: tuple[Measurement, ...]) -> tuple[Any, ...]:
        light = photometry_of(frame_id, measured)
        return (orbit_of(frame_id, label=label), light) if frame_id > 4 else (light,)

    writer: SessionWriter = written_night(folder, about=about, more=more)
    writer.close()
    assert writer.faults == ()
    return folder
