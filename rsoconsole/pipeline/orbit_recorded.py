"""The orbit as it could have been known at a place of a session's log that holds none."""

from collections.abc import Sequence

import numpy as np

from rsoconsole.orbit.catalogue import CatalogueEntry
from rsoconsole.orbit.determine import Orbit, determine
from rsoconsole.orbit.identify import Identification, identify
from rsoconsole.orbit.known import KnownOrbit
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.orbit.two_body import elements_of
from rsoconsole.pipeline.sightings_of import longest_arc, read_last_track
from rsoconsole.records import CatalogueMatch, Identified, OrbitEstimate
from rsoconsole.session.reader import SessionReader


def recorded_orbit(
    reader: SessionReader,
    until_seq: int,
    entries: Sequence[CatalogueEntry] = (),
    *,
    gate_deg: float = 0.2,
) -> tuple[OrbitEstimate, Identified | None] | None:
    """Orbit and name of the last track up to a place of the log; None where there is none.

    ``entries``: a catalogue to name it by. Raises SessionError.
    """
    last = read_last_track(reader, until_seq)
    if last is None:
        return None
    observed, frame_id = last
    orbit = determine(observed.seen)
    if orbit is None:
        return None
    arc = longest_arc(observed.seen)
    found = identify(arc, observed.site, entries, gate_deg=gate_deg) if entries else None
    return (
        _estimate(orbit, observed.seen, frame_id),
        None if found is None else _identified(found, arc, frame_id),
    )


def _estimate(orbit: Orbit, seen: Sightings, frame_id: int) -> OrbitEstimate:
    elements = elements_of(orbit.r_km, orbit.v_km_s)
    return OrbitEstimate(
        frame_id=frame_id,
        label=orbit.label,
        prior=orbit.prior,
        reason=orbit.reason,
        observations=orbit.observations,
        arc_s=float(seen.t_s[-1] - seen.t_s[0]),
        epoch_utc_ns=orbit.epoch_utc_ns,
        r_gcrs_km=_three(orbit, "r_km"),
        v_gcrs_km_s=_three(orbit, "v_km_s"),
        covariance=tuple(tuple(float(value) for value in row) for row in orbit.covariance),
        a_km=elements.a_km,
        e=elements.e,
        i_deg=elements.i_deg,
        sigma_a_km=orbit.sigma_a_km,
        rms_arcsec=orbit.rms_arcsec,
        outliers=orbit.outliers,
    )


def _three(orbit: KnownOrbit, name: str) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in np.asarray(getattr(orbit, name)))
    return x, y, z


def _identified(found: Identification, arc: Sightings, frame_id: int) -> Identified:
    return Identified(
        frame_id=frame_id,
        verdict=found.verdict,
        reason=found.reason,
        hint=found.hint,
        observations=len(arc),
        catalogued=found.catalogued,
        matches=tuple(
            CatalogueMatch(
                norad_id=each.norad_id,
                name=each.name,
                separation_arcsec=each.separation_arcsec,
                along_track_s=each.along_track_s,
                cross_track_arcsec=each.cross_track_arcsec,
                rate_difference_percent=each.rate_difference_percent,
                tle_age_days=each.tle_age_days,
                score=each.score,
                probability=each.probability,
            )
            for each in found.matches
        ),
    )
