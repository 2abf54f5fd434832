"""Records and log lines of leaps, and of the satellite's pass during which they are made."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from rsoconsole.engine.aim.instrument_controller import NS
from rsoconsole.engine.leaps._leap_times import LeapDurations, LeapTimes
from rsoconsole.engine.leaps.awaiting import (
    next_pass_of,
    orbit_words,
    pass_summary_words,
    pass_words,
    remaining_pass_words,
)
from rsoconsole.engine.operator.by_hand import Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.orbits import (
    ExpectedPass,
    KnownOrbit,
    LeapTrack,
    LowOrbit,
    StreakEnds,
    TwoBodyPropagator,
    osculating_elements,
    path_of_orbit,
)
from rsoconsole.pipeline import FrameStreak, Leap, Telescope, plan_pass
from rsoconsole.records import FloatArray, LeapDone, LeapOrder, LeapResult, LowPass
from rsoconsole.sky import IntArray, Pose, lit_fraction, wrap_180


def leap_record(
    parts: LeapDurations, leap: Leap, before: LeapTrack, ends: StreakEnds | None, **facts: Any
) -> LeapDone:
    """Return a leap's record: its plan, its times and the offset of its streak from the prediction.

    ``before``: the track before the leap's frame; ``ends``: the satellite's streak in that frame,
    None where there is none; ``facts``: further fields of the record.
    """
    place = leap.place
    along, across = np.sqrt(np.maximum(np.diag(place.along_across_arcsec2), 0.0))
    off = None if ends is None else _off(before, ends)
    return LeapDone(
        t_order_utc_ns=leap.t_order_utc_ns,
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
        wait_s=parts.wait_s,
        subframe=leap.share,
        **asdict(parts),
        **facts,
    )


def _off(track: LeapTrack, ends: StreakEnds) -> tuple[float, float] | None:
    """Offset of a streak's middle along and across the motion, arcsec."""
    place = track.predicted_position(ends.t_mid_utc_ns)
    if place is None:
        return None
    ra_deg = float(ends.ra_icrs_deg[0]) + wrap_180(float(np.diff(ends.ra_icrs_deg)[0])) / 2.0
    dec_deg = float(np.mean(ends.dec_icrs_deg))
    east = wrap_180(ra_deg - place.ra_icrs_deg) * np.cos(np.radians(place.dec_icrs_deg))
    off = 3600.0 * np.array([east, dec_deg - place.dec_icrs_deg])
    ahead = place.rate_arcsec_s / max(place.speed_arcsec_s, 1e-9)
    return float(off @ ahead), float(off[1] * ahead[0] - off[0] * ahead[1])


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(each) for each in values)
    return x, y, z


def _rms(orbit: LowOrbit, axis: int) -> float:
    return float(np.sqrt(np.nanmean(orbit.residuals_arcsec[..., axis] ** 2)))


_PASS_S, _PASS_STEP_S = 1_200.0, 10.0
_AGAIN_AT = (6, 15)
"""Numbers of streaks at which the rest of a pass is planned again, as the orbit is better then."""
_SURE = np.eye(6) * 1e-6
"""Covariance of an orbit taken as known, 6 x 6, because later leaps determine it better."""


@dataclass(slots=True)
class _Begun:
    """Facts of the pass under way."""

    frame_id: int = 0
    name: str = ""
    leaps: int = 0
    planned: int = 0
    planned_at: int = 0
    """Number of streaks when the pass was last planned; 0: it was not."""


class LeapLog:
    """Collects the facts of each leap; slow computations wait until the loop has time."""

    def __init__(self, control: LoopControl, parts: Parts, times: LeapTimes) -> None:
        self._control, self._times = control, times
        self._instrument_controller = parts.instrument_controller
        self._session_log = parts.session_log
        self._site = control.config.site.to_site()
        self._begun = _Begun()
        self._unrecorded: Callable[[LeapDurations], LeapDone] | None = None
        """Makes the record of the last leap, when there is time for it."""
        self._spent: list[LeapDurations] = []
        self._frame_id = 0
        """Frame of the last leap or first streak."""

    def begin(self, frame_id: int, name: str) -> None:
        """Begin a pass with its first streak.

        ``name``: the expected satellite's, empty where none was expected.
        """
        self._begun, self._frame_id = _Begun(frame_id=frame_id, name=name), frame_id
        self._unrecorded, self._spent = None, []

    def note_leap_times(self, leap: Leap, *, waited_for_frame: bool) -> None:
        """Note a leap's times; called when the next slew can be ordered."""
        now_ns = self._instrument_controller.now_utc_ns()
        self._spent.append(
            self._times.leap_durations(leap, now_ns, waited_for_frame=waited_for_frame)
        )

    def note_leap_result(
        self,
        leap: Leap,
        order: LeapOrder,
        result: LeapResult,
        *,
        frame_id: int,
        before: LeapTrack,
        streak: FrameStreak | None = None,
    ) -> None:
        """Note whether a leap met its satellite, by its frame.

        ``order``: what triggered the leap's slew; ``before``: the track until that frame.
        """
        self._begun.leaps += 1
        self._frame_id = frame_id
        self._unrecorded = partial(
            leap_record,
            leap=leap,
            before=before,
            ends=None if streak is None else streak.ends,
            frame_id=frame_id,
            begun_frame_id=self._begun.frame_id,
            number=self._begun.leaps,
            ordered=order,
            result=result,
        )

    def record_last_leap(self) -> None:
        """Record the last leap, unless it is recorded already."""
        record_of, self._unrecorded = self._unrecorded, None
        if record_of is not None and self._spent:
            self._session_log.append(record_of(self._spent[-1]))

    def log_pass_plan(
        self, track: LeapTrack, first: Leap, start: Pose, telescope: Telescope, sure_from: int
    ) -> None:
        """Log the plan of the pass: first during the first leap, and again after more streaks.

        With one streak, the likeliest of many possible orbits is used. With more, the fitted orbit
        is used, and the pass also ends at the Earth's shadow. ``sure_from``: as in ``plan_pass``.
        """
        streaks, best = len(track.best_hypothesis.streaks), track.best_hypothesis
        is_first = not self._begun.planned_at
        is_again = streaks in _AGAIN_AT and streaks != self._begun.planned_at
        orbit = (
            _likeliest(track) if is_first else best.orbit and replace(best.orbit, covariance=_SURE)
        )
        if orbit is None or not (is_first or is_again):
            return
        self._begun.planned_at = streaks
        t = first.t_order_utc_ns + (np.arange(0.0, _PASS_S, _PASS_STEP_S) * NS).astype(np.int64)
        lit = t if is_first else t[: _lit_instants(orbit, t)]
        path = path_of_orbit(orbit, self._site, lit) if len(lit) > 1 else None
        if path is None:
            return
        is_early = self._control.config.leap.at_close
        plan = plan_pass(
            path,
            start,
            first.t_order_utc_ns,
            telescope,
            first=first,
            sure_from=(sure_from if is_first else 0) if is_early else None,
        )
        if is_first:
            self._begun.planned = len(plan.leaps)
        is_dark = len(lit) < len(t) and plan.end.kind == "it sets"
        words = pass_words(plan) if is_first else remaining_pass_words(plan, is_dark=is_dark)
        self._session_log.say("info", words)

    def end(self, track: LeapTrack, why: str) -> None:
        """Log and record the satellite's orbit and next pass; ``why``: why the pass has ended."""
        orbit = track.best_hypothesis.orbit
        self._session_log.say("info", f"{why}: {pass_summary_words(track, self._spent)}")
        later: ExpectedPass | None = None
        if orbit is not None:
            now_ns = self._instrument_controller.now_utc_ns()
            least_deg = self._control.config.limits.min_altitude_deg
            later = next_pass_of(orbit, self._site, now_ns, least_deg)
            for line in orbit_words(orbit, later):
                self._session_log.say("info", line)
        self._record_pass(track, why, later)

    def record_interrupted_pass(self, track: LeapTrack, why: str) -> None:
        """Record a pass that was interrupted; ``why``: the reason in words."""
        self._record_pass(track, why, None)

    def _record_pass(self, track: LeapTrack, end: str, later: ExpectedPass | None) -> None:
        self.record_last_leap()
        best, begun = track.best_hypothesis, self._begun
        orbit, streaks = best.orbit, best.streaks
        found = None if orbit is None else osculating_elements(orbit.r_km, orbit.v_km_s)
        self._session_log.append(
            LowPass(
                frame_id=self._frame_id,
                begun_frame_id=begun.frame_id,
                name=begun.name,
                ended=end,
                streaks=len(streaks),
                planned_leaps=begun.planned,
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
                t_next_rise_utc_ns=None if later is None else later.rise_utc_ns,
                sigma_next_s=None if later is None else later.sigma_s,
                sigma_next_across_deg=None if later is None else later.sigma_across_deg,
                scatter_s=None if orbit is None else best.scatter_s,
            )
        )
        self._spent = []


def _likeliest(track: LeapTrack) -> KnownOrbit:
    """Return the likeliest of the orbits that the track's streaks allow."""
    cloud = track.best_hypothesis.cloud
    heaviest = int(np.argmax(cloud.weight))
    return KnownOrbit(
        epoch_utc_ns=cloud.epoch_utc_ns,
        r_km=cloud.r_km[heaviest],
        v_km_s=cloud.v_km_s[heaviest],
        covariance=_SURE,
        forces=TwoBodyPropagator(),
    )


def _lit_instants(orbit: KnownOrbit, t_utc_ns: IntArray) -> int:
    """Number of instants before the satellite enters the Earth's shadow."""
    lit = lit_fraction(orbit.states(t_utc_ns)[0], t_utc_ns) > 0.0
    return int(np.argmin(lit)) if not np.all(lit) else len(lit)
