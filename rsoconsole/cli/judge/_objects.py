"""Evaluation of a run with the simulated observatory, object by object.

A detection or measurement belongs to the object on whose true streak it lies; where it lies on
several, to the one whose middle is nearest. Distances are in pixels, which suit objects of any
rate: in angle, 0.01 s of shutter error is 20 arcsec for a low satellite.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsoconsole.night import FrameTrack, NightFrame, rms
from rsoconsole.records import Detection, Identified, Measurement, TrackState
from rsoconsole.sky import wrap_180
from rsoconsole.tracking import lag_one_correlation, sky_covariance_arcsec2

VISIBLE_SNR = 20.0
BESIDE_FWHM = 4.0
"""Largest distance of a detection from its true streak, in FWHM of the frame's stars."""
BETWEEN = 2.0
"""A streak is of both where its distances from the two middles differ by less than this factor."""
APART_FWHM = 2.0
"""Distance below which a frame cannot show two streaks apart, in FWHM of its stars."""


@dataclass(slots=True)
class _Tally:
    """Counts of one object."""

    name: str
    detections: int = 0
    visible_frames: int = 0
    track_frames: int = 0
    measured_arcsec: list[float] = field(default_factory=list)
    predicted_arcsec: list[float] = field(default_factory=list)
    identified: bool | None = None
    false_measurements: int = 0
    detected_after_lock: int = 0
    tracked_after_lock: int = 0
    inside_3sigma: list[bool] = field(default_factory=list)
    nis: list[float] = field(default_factory=list)
    innovations: list[tuple[float, float]] = field(default_factory=list)
    """Innovations (east, north) in units of their own sigmas."""
    wrong_in_a_row: int = 0
    longest_wrong: int = 0
    swapped_frames: int = 0


def objects_figures(
    views: Sequence[tuple[NightFrame, Mapping[str, Any]]], targets: Mapping[int, str]
) -> list[dict[str, Any]]:
    """Return the summary's ``objects``: the targets, then all objects visible or detected.

    ``views``: each frame with its exposure's truth. A track belongs to the object of its first
    measurement: the nearest one, the brighter of two about as near, a visible one before others.
    Keys of each object:

    - ``detections``: number of frames in which a streak of the object was detected.
    - ``visible_frames``: number of frames with its mid-exposure position in the field and an
      integrated SNR of at least ``VISIBLE_SNR``.
    - ``track_frames``: number of frames in which its track accepted a measurement of it.
    - ``measured_rms_arcsec``: error of all measurements of it; of a clipped streak only across the
      streak.
    - ``prediction_rms_arcsec``: error of its track's predictions, one step ahead.
    - ``identified``: whether the last identification of its track is right; None without one.
    - ``false_measurements``: number of measurements accepted by its track that are not of the
      object: of another one, or of none.
    - ``detected_after_lock``: frames after its track's first one in which it was detected.
    - ``tracked_after_lock``: frames of ``detected_after_lock`` in which its track accepted it.
    - ``inside_3sigma``: fraction of visible frames with the truth inside the prediction's 3-sigma
      ellipse, after removal of the clock's constant lateness.
    - ``nis_mean``: mean NIS.
    - ``whiteness``: lag-one correlation of the innovations in units of their sigmas; sound within
      2 / sqrt(n).
    - ``longest_wrong``: longest run of frames, with the first object locked in the field, in which
      the lead track accepted a measurement that is not of it.
    - ``swapped_frames``: number of frames in which its track accepted another object's streak
      although the frame can show the two apart (``APART_FWHM``).
    """
    judge = _Judge({number: _Tally(name) for number, name in targets.items()})
    for frame, truth in views:
        judge.take(frame, truth)
    return [_figures(number, each) for number, each in judge.tallies.items()]


@dataclass(frozen=True, slots=True)
class _Field:
    """The satellites that truly stood in a frame, and how wide its stars are."""

    there: Mapping[int, Mapping[str, Any]]
    """Truth of the satellites in the frame by catalogue number, if it gives their streaks."""
    fwhm_px: float

    @classmethod
    def of(cls, truth: Mapping[str, Any]) -> "_Field":
        needed = {"norad_id", "x_start_px", "snr_integrated"}
        there = {s["norad_id"]: s for s in truth.get("satellites", ()) if needed <= s.keys()}
        return cls(there, float(truth.get("fwhm_px", 0.0)))

    def near(self, at: Detection | Measurement) -> list[tuple[float, int]]:
        """Objects on whose true streak a detection or measurement lies.

        For each: distance from the streak's middle (px) and catalogue number.
        """
        return [
            (math.hypot(at.x_px - each["x_px"], at.y_px - each["y_px"]), number)
            for number, each in self.there.items()
            if _is_beside((at.x_px, at.y_px), each, BESIDE_FWHM * self.fwhm_px)
        ]

    def object_at(self, at: Detection | Measurement) -> int | None:
        """Catalogue number of the object to which a detection or measurement belongs, or None.

        The object on whose true streak it lies; of several, that with the nearest middle.
        """
        near = self.near(at)
        return min(near)[1] if near else None

    def object_of_new_track(self, at: Measurement) -> int | None:
        """Object to which a new track belongs, by its first measurement; None for no object.

        Visible objects come before others; of objects about equally near, the brightest.
        """
        every = self.near(at)
        near = [e for e in every if self.there[e[1]]["snr_integrated"] >= VISIBLE_SNR] or every
        if not near:
            return None
        most_px = BETWEEN * min(near)[0]
        snr = {n: self.there[n]["snr_integrated"] for _, n in near}
        return max((snr[n], -away, n) for away, n in near if away <= most_px)[2]

    def is_of_both(
        self, step: FrameTrack, taken: Measurement, on: int | None, number: int | None
    ) -> bool:
        """True where the accepted measurement is of its own object ``on`` as well as of ``number``.

        So it is where the streak lies between both objects, where the track records that it shares
        the streak with another track, or where the frame cannot show the two streaks apart.
        """
        own, nearer = self.there.get(on or 0), self.there.get(number or 0)
        at = (taken.x_px, taken.y_px)
        if own is None or nearer is None:
            return False
        if not _is_beside(at, own, BESIDE_FWHM * self.fwhm_px):
            return False
        if step.updated is not None and step.updated.shared_with is not None:
            return True
        if _is_beside((own["x_px"], own["y_px"]), nearer, APART_FWHM * self.fwhm_px):
            return True
        to_own, to_other = (math.dist(at, (each["x_px"], each["y_px"])) for each in (own, nearer))
        return to_own <= BETWEEN * to_other


def _is_beside(at: tuple[float, float], satellite: Mapping[str, Any], width_px: float) -> bool:
    """True where a pixel lies within that distance of a true streak, from end to end."""
    x_px, y_px = satellite["x_start_px"], satellite["y_start_px"]
    along = (satellite["x_end_px"] - x_px, satellite["y_end_px"] - y_px)
    offset = (at[0] - x_px, at[1] - y_px)
    length2 = along[0] ** 2 + along[1] ** 2
    share = (offset[0] * along[0] + offset[1] * along[1]) / length2 if length2 > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(offset[0] - share * along[0], offset[1] - share * along[1]) <= width_px


@dataclass(slots=True)
class _Judge:
    """Judge of each frame's streaks by object, and of the tracks that took them."""

    tallies: dict[int, _Tally]
    followed: dict[int, int] = field(default_factory=dict)
    """Catalogue number of the object to which a track belongs, by track id."""
    first: int | None = None
    """Catalogue number of the object that was locked first."""

    def take(self, frame: NightFrame, truth: Mapping[str, Any]) -> None:
        """Count one frame's detections, measurements and tracks against its exposure's truth."""
        sky = _Field.of(truth)
        seen = self._count(frame, sky)
        late_ns, taken_by = truth.get("always_late_ns", 0), dict[int, int | None]()
        steps = steps_by_track_id(frame)
        before = {self.followed[n] for n in steps if n in self.followed}
        for track_id, step in steps.items():
            on = self.followed.get(track_id)
            if on is not None and on in sky.there:
                _judge_prediction(self._of(on, sky), step, sky.there[on], late_ns)
            taken = _taken(frame, step)
            if taken is not None:
                is_new = step.updated is not None and step.updated.kind == "initial"
                number = sky.object_of_new_track(taken) if is_new else sky.object_at(taken)
                if sky.is_of_both(step, taken, on, number):
                    number = on
                taken_by[track_id] = number
                self._judge_taken(track_id, number, sky, is_new=is_new)
        for number in before & seen:
            self.tallies[number].detected_after_lock += 1
            self.tallies[number].tracked_after_lock += any(
                taken == number == self.followed.get(n) for n, taken in taken_by.items()
            )
        self._judge_lead(lead_track_id(steps), sky, taken_by)
        for found in frame.names:
            on = self.followed.get(found.track_id)
            if found.track_id in steps and on is not None and on in self.tallies:
                number = identified_norad_id(found)
                self.tallies[on].identified = None if number is None else number == on

    def _of(self, number: int, sky: _Field) -> _Tally:
        return self.tallies.setdefault(number, _Tally(str(sky.there[number]["name"])))

    def _count(self, frame: NightFrame, sky: _Field) -> set[int]:
        """Count what is visible, detected, measured; return the objects that were detected."""
        for number, each in sky.there.items():
            if each["is_in_frame"] and each["snr_integrated"] >= VISIBLE_SNR:
                self._of(number, sky).visible_frames += 1
        seen = {n for each in frame.detected_streaks if (n := sky.object_at(each)) is not None}
        for number in seen:
            self._of(number, sky).detections += 1
        for measurement in frame.measurements:
            at = sky.object_at(measurement)
            error = None if at is None else _error_arcsec(measurement, sky.there[at])
            if at is not None and error is not None:
                self._of(at, sky).measured_arcsec.append(error)
        return seen

    def _judge_taken(self, track_id: int, number: int | None, sky: _Field, *, is_new: bool) -> None:
        """Judge a track's accepted measurement: of the object that it is on, or false."""
        if number is not None and (is_new or track_id not in self.followed):
            self.followed[track_id] = number
        elif is_new:
            self.followed.pop(track_id, None)
        on = self.followed.get(track_id)
        if on is None:
            return
        if number == on:
            self._of(on, sky).track_frames += 1
        else:
            self.tallies[on].false_measurements += 1
            self.tallies[on].swapped_frames += number is not None

    def _judge_lead(
        self, lead: int | None, sky: _Field, taken_by: Mapping[int, int | None]
    ) -> None:
        """Count the frames in a row in which the lead took another object than the first locked."""
        if lead is None:
            return
        self.first = self.followed.get(lead) if self.first is None else self.first
        if self.first is not None and self.first in sky.there:
            if not sky.there[self.first]["is_in_frame"]:
                return
            tally = self._of(self.first, sky)
            is_wrong = lead in taken_by and taken_by[lead] != self.first
            tally.wrong_in_a_row = tally.wrong_in_a_row + 1 if is_wrong else 0
            tally.longest_wrong = max(tally.longest_wrong, tally.wrong_in_a_row)


def is_on_a_streak(measurement: Measurement, truth: Mapping[str, Any]) -> bool:
    """True where a measurement lies on the true streak of any satellite in its frame."""
    return bool(_Field.of(truth).near(measurement))


def direction_offset_arcsec(
    true: Mapping[str, Any], ra_deg: float, dec_deg: float, t_utc_ns: int
) -> tuple[float, float]:
    """Return a direction's offset (east, north), arcsec, from a satellite's true direction.

    ``true``: the satellite's truth, moved by its rates to ``t_utc_ns``, the time of the
    direction: with a rolling shutter the streaks of one frame have different times.
    """
    later_s = (t_utc_ns - true.get("t_utc_ns", t_utc_ns)) / 1e9
    true_ra_deg, true_dec_deg = float(true["ra_icrs_deg"]), float(true["dec_icrs_deg"])
    if later_s:
        true_ra_deg += true["ra_rate_deg_s"] * later_s
        true_dec_deg += true["dec_rate_deg_s"] * later_s
    cos_dec = math.cos(math.radians(true_dec_deg))
    return wrap_180(ra_deg - true_ra_deg) * cos_dec * 3600.0, (dec_deg - true_dec_deg) * 3600.0


def measurement_offset_arcsec(
    measurement: Measurement, true: Mapping[str, Any]
) -> tuple[float, float]:
    """Offset (east, north), arcsec, of a measurement from the satellite's true direction."""
    at = (measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    return direction_offset_arcsec(true, *at, measurement.t_mid_utc_ns)


def _error_arcsec(measurement: Measurement, true: Mapping[str, Any]) -> float | None:
    """Distance from the truth; of a clipped streak across it, where its direction is known."""
    east, north = measurement_offset_arcsec(measurement, true)
    if not measurement.is_clipped:
        return math.hypot(east, north)
    if measurement.ends_icrs_deg is None:
        return None
    (ra_a, dec_a), (ra_b, dec_b) = measurement.ends_icrs_deg
    cos_dec = math.cos(math.radians(measurement.dec_icrs_deg))
    along_east, along_north = wrap_180(ra_b - ra_a) * cos_dec, dec_b - dec_a
    length = math.hypot(along_east, along_north)
    return abs(east * along_north - north * along_east) / length if length > 0.0 else None


def _judge_prediction(
    tally: _Tally, step: FrameTrack, true: Mapping[str, Any], always_late_ns: int
) -> None:
    """Judge a prediction one step ahead, where the object was in the frame."""
    predicted, updated = step.predicted, step.updated
    if predicted is None or not true["is_in_frame"]:
        return
    if true["snr_integrated"] >= VISIBLE_SNR:
        _judge_bounds(tally, predicted, true, always_late_ns)
    if updated is not None and updated.shared_with is not None:
        updated = None  # half of what it says of the error is what nobody knows
    if updated is not None and updated.nis is not None and updated.sigma_innovation_arcsec:
        tally.nis.append(updated.nis)
        east, north = updated.innovation_arcsec or (0.0, 0.0)
        sigmas = updated.sigma_innovation_arcsec
        tally.innovations.append((east / sigmas[0], north / sigmas[1]))
    if predicted.misses <= 1:
        off = direction_offset_arcsec(true, predicted.x[0], predicted.x[2], predicted.t_utc_ns)
        tally.predicted_arcsec.append(math.hypot(*off))


def _judge_bounds(
    tally: _Tally, predicted: TrackState, true: Mapping[str, Any], always_late_ns: int
) -> None:
    """Judge whether the truth lies inside the 3-sigma ellipse of the prediction.

    The clock's constant lateness, which no measurement shows, is taken out.
    """
    t_utc_ns = predicted.t_utc_ns + always_late_ns
    off = np.array(direction_offset_arcsec(true, predicted.x[0], predicted.x[2], t_utc_ns))
    spread = sky_covariance_arcsec2(predicted)
    if np.linalg.det(spread) > 0.0:
        tally.inside_3sigma.append(float(off @ np.linalg.solve(spread, off)) <= 9.0)


def lead_measured(frame: NightFrame) -> Measurement | None:
    """The measurement that the lead track accepted in a frame; None where it accepted none."""
    steps = steps_by_track_id(frame)
    lead = lead_track_id(steps)
    return None if lead is None else _taken(frame, steps[lead])


def steps_by_track_id(frame: NightFrame) -> dict[int, FrameTrack]:
    """Return a frame's tracks by id, each as before and after the frame."""
    return {each.track_id: each for each in frame.tracks}


def lead_track_id(steps: Mapping[int, FrameTrack]) -> int | None:
    """Id of a frame's lead track; where the lead changes in the frame, of the later one."""
    return next((n for n in reversed(list(steps)) if steps[n].is_lead), None)


def _taken(frame: NightFrame, step: FrameTrack) -> Measurement | None:
    named = None if step.updated is None else step.updated.measurement_id
    return next((m for m in frame.measurements if m.measurement_id == named), None)


def identified_norad_id(found: Identified | None) -> int | None:
    """Catalogue number of an identified object; None where it is ambiguous or unknown."""
    if found is None or found.verdict != "identified" or not found.matches:
        return None
    return found.matches[0].norad_id


_COUNTED = (
    *("detections", "visible_frames", "track_frames", "identified", "false_measurements"),
    *("detected_after_lock", "tracked_after_lock", "longest_wrong", "swapped_frames"),
)
"""Figures that are the tally's own."""


def _figures(number: int, tally: _Tally) -> dict[str, Any]:
    return {
        "norad": number,
        "name": tally.name,
        **{name: getattr(tally, name) for name in _COUNTED},
        "measured_rms_arcsec": rms(tally.measured_arcsec),
        "prediction_rms_arcsec": rms(tally.predicted_arcsec),
        "inside_3sigma": statistics.fmean(tally.inside_3sigma) if tally.inside_3sigma else None,
        "nis_mean": statistics.fmean(tally.nis) if tally.nis else None,
        "whiteness": lag_one_correlation(tally.innovations),
    }
