"""Leaps and passes as they go on record. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.engine.leaps.leap_times import LeapParts
from rsoconsole.orbits.low import ExpectedPass, LeapTrack, LowOrbit, StreakEnds
from rsoconsole.orbits.motion import elements_of
from rsoconsole.pipeline.leaps import Leap
from rsoconsole.records import FloatArray, LeapDone, LeapOrder, LeapResult, LowPass
from rsoconsole.sky import wrap_180


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeapSeen:
    """A leap, its frame, and what came of it; the record is made once nobody waits for it."""

    frame_id: int
    begun_frame_id: int
    number: int
    leap: Leap
    order: LeapOrder
    result: LeapResult
    before: LeapTrack
    """What was followed before the frame."""
    ends: StreakEnds | None
    """Its streak there, where met."""


def leap_record(seen: LeapSeen, parts: LeapParts) -> LeapDone:
    """As the session has it."""
    leap, place = seen.leap, seen.leap.place
    along, across = np.sqrt(np.maximum(np.diag(place.along_across_arcsec2), 0.0))
    off = None if seen.ends is None else _off(seen.before, seen.ends)
    return LeapDone(
        frame_id=seen.frame_id,
        begun_frame_id=seen.begun_frame_id,
        number=seen.number,
        result=seen.result,
        t_order_utc_ns=leap.t_order_utc_ns,
        ordered=seen.order,
        t_mid_utc_ns=leap.t_mid_utc_ns,
        ra_icrs_deg=place.ra_icrs_deg,
        dec_icrs_deg=place.dec_icrs_deg,
        speed_arcsec_s=place.speed_arcsec_s,
        sigma_along_arcsec=float(along),
        sigma_across_arcsec=float(across),
        within=leap.within,
        flips=leap.flips,
        exposure_s=leap.exposure_s,
        binning=leap.binning,
        off_along_arcsec=None if off is None else off[0],
        off_across_arcsec=None if off is None else off[1],
        total_s=parts.total_s,
        slew_s=parts.slew_s,
        settle_s=parts.settle_s,
        shutter_s=parts.shutter_s,
        open_s=parts.exposure_s,
        readout_s=parts.readout_s,
        wait_s=parts.wait_s,
        subframe=leap.share,
    )


def _off(track: LeapTrack, ends: StreakEnds) -> tuple[float, float] | None:
    """Along and across the motion, arcsec, at the middle of a streak."""
    place = track.ahead(ends.t_mid_utc_ns)
    if place is None:
        return None
    ra_deg = float(ends.ra_icrs_deg[0]) + wrap_180(float(np.diff(ends.ra_icrs_deg)[0])) / 2.0
    dec_deg = float(np.mean(ends.dec_icrs_deg))
    east = wrap_180(ra_deg - place.ra_icrs_deg) * np.cos(np.radians(place.dec_icrs_deg))
    off = 3600.0 * np.array([east, dec_deg - place.dec_icrs_deg])
    ahead = place.rate_arcsec_s / max(place.speed_arcsec_s, 1e-9)
    return float(off @ ahead), float(off[1] * ahead[0] - off[0] * ahead[1])


def pass_record(
    track: LeapTrack,
    *,
    frame_id: int,
    begun_frame_id: int,
    name: str,
    end: str,
    planned_leaps: int,
    next_pass: ExpectedPass | None,
) -> LowPass:
    """As the session has it."""
    best = track.best
    orbit, streaks = best.orbit, best.streaks
    found = None if orbit is None else elements_of(orbit.r_km, orbit.v_km_s)
    return LowPass(
        frame_id=frame_id,
        begun_frame_id=begun_frame_id,
        name=name,
        ended=end,
        streaks=len(streaks),
        planned_leaps=planned_leaps,
        t_first_utc_ns=streaks[0].t_mid_utc_ns,
        t_last_utc_ns=streaks[-1].t_mid_utc_ns,
        probability=best.probability,
        epoch_utc_ns=None if orbit is None else orbit.epoch_utc_ns,
        r_gcrs_km=None if orbit is None else _three(orbit.r_km),
        v_gcrs_km_s=None if orbit is None else _three(orbit.v_km_s),
        covariance=None
        if orbit is None
        else tuple(tuple(float(each) for each in row) for row in orbit.covariance),
        a_km=None if found is None else found.a_km,
        e=None if found is None else found.e,
        i_deg=None if found is None else found.i_deg,
        believes_round=orbit is not None and orbit.believes_round,
        along_rms_arcsec=None if orbit is None else _rms(orbit, 0),
        across_rms_arcsec=None if orbit is None else _rms(orbit, 1),
        t_next_rise_utc_ns=None if next_pass is None else next_pass.rise_utc_ns,
        sigma_next_s=None if next_pass is None else next_pass.sigma_s,
        sigma_next_across_deg=None if next_pass is None else next_pass.sigma_across_deg,
        scatter_s=None if orbit is None else best.scatter_s,
    )


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(each) for each in values)
    return x, y, z


def _rms(orbit: LowOrbit, axis: int) -> float:
    return float(np.sqrt(np.nanmean(orbit.residuals_arcsec[..., axis] ** 2)))
