"""A run against the simulated observatory, judged object by object.

A detection or a measurement is of the object on whose true streak it lies, in pixels of its own
frame; of several the one whose middle is nearest. That holds for any rate, which an angle on the
sky does not: a hundredth of a second of shutter is 20 arcsec of a low satellite.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsoconsole.night import FrameTrack, NightFrame, rms
from rsoconsole.records import Identified, Measurement, TrackState
from rsoconsole.sky import wrap_180
from rsoconsole.tracking import lag_one, sky_covariance_arcsec2

VISIBLE_SNR = 20.0
"""Integrated SNR from which a satellite in the field counts as visible."""
BESIDE_FWHM = 4.0
"""How far beside a true streak something may lie and be of it, in widths of the frame's stars."""
BETWEEN = 2.0
"""A streak is of both where its distances from the two middles differ by less than this factor."""
APART_FWHM = 2.0
"""Lines nearer to each other, in widths of the frame's stars, are one streak to a camera."""


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
    """Each in its own sigmas, east and north."""
    wrong_in_a_row: int = 0
    longest_wrong: int = 0
    swapped_frames: int = 0


def objects_figures(
    views: Sequence[tuple[NightFrame, Mapping[str, Any]]], targets: Mapping[int, str]
) -> list[dict[str, Any]]:
    """The summary's ``objects``: the targets, then all that was ever visible or detected.

    ``views``: each frame with its exposure's truth. ``detections``: frames in which a streak of
    the object was detected. ``visible_frames``: its place at mid-exposure lies in the field, and
    its integrated SNR is at least ``VISIBLE_SNR``. A track is on the object that it began with, of
    two about as near on the brighter, and on none that is not visible beside one that is.
    ``track_frames``: such a track took its measurement.
    ``measured_rms_arcsec``: of all its measurements, those of clipped streaks across them alone.
    ``prediction_rms_arcsec``: one step ahead, of the track that followed it. ``identified``:
    whether the last name given to that track is right; None where none was given.
    ``false_measurements``: what that track took that was not of it. ``detected_after_lock`` and
    ``tracked_after_lock``: frames after its track's first one in which it was detected, and those
    of them in which a track took it. ``inside_3sigma``: share of the visible frames in which the
    truth, by a clock that is always late by as much as this one, lay inside the 3-sigma ellipse of
    the prediction. ``nis_mean`` and ``whiteness`` (lag-one
    correlation of the innovations in their sigmas; sound within 2 / sqrt(n)). ``longest_wrong``:
    visible frames in a row in which the lead took something else than what was locked first.
    ``swapped_frames``: those in which the object's track took another object's streak, where the
    two draw lines that a camera shows apart (``APART_FWHM``).
    """
    judge = _Judge({number: _Tally(name) for number, name in targets.items()})
    for frame, truth in views:
        judge.take(frame, truth)
    return [_figures(number, each) for number, each in judge.tallies.items()]


@dataclass(slots=True)
class _Judge:
    """Which object each frame's streaks are of, and what the tracks made of them."""

    tallies: dict[int, _Tally]
    followed: dict[int, int] = field(default_factory=dict)
    """By track: catalogue number of what it is on."""
    first: int | None = None
    """Of what was locked first."""

    def take(self, frame: NightFrame, truth: Mapping[str, Any]) -> None:
        """One frame with its exposure's truth."""
        there = {
            each["norad_id"]: each for each in truth.get("satellites", ()) if _is_complete(each)
        }
        width_px = BESIDE_FWHM * float(truth.get("fwhm_px", 0.0))
        seen = self._count(frame, there, width_px)
        late_ns, taken_by = truth.get("always_late_ns", 0), dict[int, int | None]()
        steps = steps_of(frame)
        before = {self.followed[n] for n in steps if n in self.followed}
        for track_id, step in steps.items():
            on = self.followed.get(track_id)
            if on is not None and on in there:
                _judge_prediction(self._of(on, there), step, there[on], late_ns)
            taken = _taken(frame, step)
            if taken is not None:
                number = _object_at(taken.x_px, taken.y_px, there, width_px)
                if step.updated is not None and step.updated.kind == "initial":
                    number = _begun_on(taken.x_px, taken.y_px, there, width_px)
                apart_px = APART_FWHM * float(truth.get("fwhm_px", 0.0))
                if _is_of_both(step, taken, there, (on, number), (width_px, apart_px)):
                    number = on
                taken_by[track_id] = number
                self._judge_taken(track_id, step, number, there)
        for number in before & seen:
            self.tallies[number].detected_after_lock += 1
            self.tallies[number].tracked_after_lock += any(
                taken == number == self.followed.get(n) for n, taken in taken_by.items()
            )
        self._judge_lead(frame, there, taken_by)
        for found in frame.names:
            on = self.followed.get(found.track_id)
            if found.track_id in steps and on is not None and on in self.tallies:
                self.tallies[on].identified = _is_right(found, on)

    def _of(self, number: int, there: Mapping[int, Mapping[str, Any]]) -> _Tally:
        return self.tallies.setdefault(number, _Tally(str(there[number]["name"])))

    def _count(
        self, frame: NightFrame, there: Mapping[int, Mapping[str, Any]], width_px: float
    ) -> set[int]:
        """Visible, detected, measured; returns the objects that were detected."""
        for number, each in there.items():
            if each["is_in_frame"] and each["snr_integrated"] >= VISIBLE_SNR:
                self._of(number, there).visible_frames += 1
        found = (_object_at(d.x_px, d.y_px, there, width_px) for d in frame.found)
        seen = {number for number in found if number is not None}
        for number in seen:
            self._of(number, there).detections += 1
        for measurement in frame.measurements:
            at = _object_at(measurement.x_px, measurement.y_px, there, width_px)
            error = None if at is None else _error_arcsec(measurement, there[at])
            if at is not None and error is not None:
                self._of(at, there).measured_arcsec.append(error)
        return seen

    def _judge_taken(
        self,
        track_id: int,
        step: FrameTrack,
        number: int | None,
        there: Mapping[int, Mapping[str, Any]],
    ) -> None:
        """Whether a track took what it is on."""
        is_new = step.updated is not None and step.updated.kind == "initial"
        if number is not None and (is_new or track_id not in self.followed):
            self.followed[track_id] = number
        elif is_new:
            self.followed.pop(track_id, None)
        on = self.followed.get(track_id)
        if on is None:
            return
        if number == on:
            self._of(on, there).track_frames += 1
        else:
            self.tallies[on].false_measurements += 1
            self.tallies[on].swapped_frames += number is not None

    def _judge_lead(
        self,
        frame: NightFrame,
        there: Mapping[int, Mapping[str, Any]],
        taken_by: Mapping[int, int | None],
    ) -> None:
        """Whether what leads is what was locked first."""
        lead = lead_of(steps_of(frame))
        if lead is None:
            return
        self.first = self.followed.get(lead) if self.first is None else self.first
        if self.first is not None and self.first in there and there[self.first]["is_in_frame"]:
            is_wrong = lead in taken_by and taken_by[lead] != self.first
            _judge_theft(self._of(self.first, there), is_wrong)


def _is_complete(satellite: Mapping[str, Any]) -> bool:
    """Whether its truth has what judging by streaks needs."""
    return "norad_id" in satellite and "x_start_px" in satellite and "snr_integrated" in satellite


def is_on_a_streak(measurement: Measurement, truth: Mapping[str, Any]) -> bool:
    """Whether a measurement lies on the true streak of anything."""
    there = {each["norad_id"]: each for each in truth.get("satellites", ()) if _is_complete(each)}
    width_px = BESIDE_FWHM * float(truth.get("fwhm_px", 0.0))
    return _object_at(measurement.x_px, measurement.y_px, there, width_px) is not None


def _object_at(
    x_px: float, y_px: float, there: Mapping[int, Mapping[str, Any]], width_px: float
) -> int | None:
    """The object on whose streak a pixel lies."""
    near = _near(x_px, y_px, there, width_px)
    return min(near)[1] if near else None


def _begun_on(
    x_px: float, y_px: float, there: Mapping[int, Mapping[str, Any]], width_px: float
) -> int | None:
    """The object that a track begins with: of those about as near as the nearest the brightest.

    What is too faint to be visible is not among them beside one that is not. A frame in which
    chance moves the middle of a bright streak towards a satellite that it does not show would put
    the track on that for the rest of the night.
    """
    every = _near(x_px, y_px, there, width_px)
    near = [each for each in every if there[each[1]]["snr_integrated"] >= VISIBLE_SNR] or every
    if not near:
        return None
    most_px = BETWEEN * min(near)[0]
    return max((there[n]["snr_integrated"], -away, n) for away, n in near if away <= most_px)[2]


def _near(
    x_px: float, y_px: float, there: Mapping[int, Mapping[str, Any]], width_px: float
) -> list[tuple[float, int]]:
    """Distance from the middle, px, and number of the objects on whose streak a pixel lies."""
    near: list[tuple[float, int]] = []
    for number, each in there.items():
        ends = [(each[f"x_{end}_px"], each[f"y_{end}_px"]) for end in ("start", "end")]
        if _beside_px((x_px, y_px), *ends) <= width_px:
            near.append((math.hypot(x_px - each["x_px"], y_px - each["y_px"]), number))
    return near


def _beside_px(
    at: tuple[float, float], start: tuple[float, float], end: tuple[float, float]
) -> float:
    """Distance of a point from a line between two others."""
    along = (end[0] - start[0], end[1] - start[1])
    offset = (at[0] - start[0], at[1] - start[1])
    length2 = along[0] ** 2 + along[1] ** 2
    share = (offset[0] * along[0] + offset[1] * along[1]) / length2 if length2 > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(offset[0] - share * along[0], offset[1] - share * along[1])


def offset_arcsec(
    true: Mapping[str, Any], ra_deg: float, dec_deg: float, t_utc_ns: int
) -> tuple[float, float]:
    """(east, north) of a direction from where a satellite truly was at its instant.

    Streaks of one frame are of different instants where its shutter rolls.
    """
    later_s = (t_utc_ns - true.get("t_utc_ns", t_utc_ns)) / 1e9
    true_ra_deg, true_dec_deg = float(true["ra_icrs_deg"]), float(true["dec_icrs_deg"])
    if later_s:
        true_ra_deg += true["ra_rate_deg_s"] * later_s
        true_dec_deg += true["dec_rate_deg_s"] * later_s
    cos_dec = math.cos(math.radians(true_dec_deg))
    return wrap_180(ra_deg - true_ra_deg) * cos_dec * 3600.0, (dec_deg - true_dec_deg) * 3600.0


def offset_of(measurement: Measurement, true: Mapping[str, Any]) -> tuple[float, float]:
    """(east, north) of a measurement from the truth, arcsec."""
    at = (measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    return offset_arcsec(true, *at, measurement.t_mid_utc_ns)


def _error_arcsec(measurement: Measurement, true: Mapping[str, Any]) -> float | None:
    """Distance from the truth; of a clipped streak across it, where its direction is known."""
    east, north = offset_of(measurement, true)
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
    """One step ahead, where the object was in the frame."""
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
        off = offset_arcsec(true, predicted.x[0], predicted.x[2], predicted.t_utc_ns)
        tally.predicted_arcsec.append(math.hypot(*off))


def _judge_bounds(
    tally: _Tally, predicted: TrackState, true: Mapping[str, Any], always_late_ns: int
) -> None:
    """Whether the truth lies inside the 3-sigma ellipse of the prediction.

    What the clock is always late by, which no measurement shows, is taken out.
    """
    t_utc_ns = predicted.t_utc_ns + always_late_ns
    off = np.array(offset_arcsec(true, predicted.x[0], predicted.x[2], t_utc_ns))
    spread = sky_covariance_arcsec2(predicted)
    if np.linalg.det(spread) > 0.0:
        tally.inside_3sigma.append(float(off @ np.linalg.solve(spread, off)) <= 9.0)


def _judge_theft(tally: _Tally, is_wrong: bool) -> None:
    """How many frames in a row the track was on something else."""
    tally.wrong_in_a_row = tally.wrong_in_a_row + 1 if is_wrong else 0
    tally.longest_wrong = max(tally.longest_wrong, tally.wrong_in_a_row)


def taken_of(frame: NightFrame) -> Measurement | None:
    """The measurement that the lead took; None where it took none."""
    steps = steps_of(frame)
    lead = lead_of(steps)
    return None if lead is None else _taken(frame, steps[lead])


def steps_of(frame: NightFrame) -> dict[int, FrameTrack]:
    """What a frame made of each track, by track id."""
    return {each.track_id: each for each in frame.tracks}


def lead_of(steps: Mapping[int, FrameTrack]) -> int | None:
    """Track id of the lead of a frame; where one takes over from another, of the later one."""
    return next((n for n in reversed(list(steps)) if steps[n].is_lead), None)


def _is_of_both(
    step: FrameTrack,
    taken: Measurement,
    there: Mapping[int, Mapping[str, Any]],
    pair: tuple[int | None, int | None],
    widths_px: tuple[float, float],
) -> bool:
    """Whether what a track took is its own object's as well as the one's whose middle is nearer.

    One streak of two lies between both; or the track says that it shares it with another; or the
    two draw lines that no camera shows apart. ``widths_px``: how far beside a line is on it, and
    how far from each other two lines are two.
    """
    own, nearer = (there.get(number or 0) for number in pair)
    beside_px, apart_px = widths_px
    if (
        own is None
        or nearer is None
        or _object_at(taken.x_px, taken.y_px, {0: own}, beside_px) is None
    ):
        return False
    if step.updated is not None and step.updated.shared_with is not None:
        return True
    if _object_at(own["x_px"], own["y_px"], {0: nearer}, apart_px) is not None:
        return True
    to_own, to_other = (
        math.hypot(taken.x_px - each["x_px"], taken.y_px - each["y_px"]) for each in (own, nearer)
    )
    return to_own <= BETWEEN * to_other


def _taken(frame: NightFrame, step: FrameTrack) -> Measurement | None:
    named = None if step.updated is None else step.updated.measurement_id
    return next((m for m in frame.measurements if m.measurement_id == named), None)


def _is_right(found: Identified, followed: int) -> bool | None:
    if found.verdict != "identified" or not found.matches:
        return None
    return found.matches[0].norad_id == followed


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
        "whiteness": lag_one(tally.innovations),
    }
