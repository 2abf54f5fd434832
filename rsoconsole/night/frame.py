"""One exposure of a night: everything on record of it, and its row in the plots."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from rsoconsole.records import (
    CLOUD,
    Cause,
    Closeup,
    Detection,
    Detections,
    FrameTaken,
    Identified,
    LoopState,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OrbitEstimate,
    Photometry,
    Reason,
    Record,
    Ruling,
    Solution,
    StateChange,
    StreakLight,
    TrackState,
)
from rsoconsole.words import text


def is_without_detection(record: Record) -> bool:
    """Return True if a record's reason is a missing detection, and nothing such as cloud hid it."""
    reason = record.reason if isinstance(record, Miss | StateChange) else None
    missed = reason.missed if isinstance(reason, Cause) else reason
    return missed is not None and missed.kind == "no detection" and not missed.hidden_by


def is_outside_field(
    predicted: TrackState | None, solution: Solution | NotSolved | None, taken: FrameTaken | None
) -> bool:
    """Return True if the lead's predicted position is outside the field of a solved frame.

    False where the prediction, the plate solution or the frame is missing.
    """
    if predicted is None or taken is None or not isinstance(solution, Solution):
        return False
    from rsoconsole.sky import sky_to_pixel

    x_px, y_px = sky_to_pixel(solution.wcs, predicted.x[0] % 360.0, predicted.x[2])
    return not (0.0 <= x_px <= taken.width_px and 0.0 <= y_px <= taken.height_px)


def was_pointed_at_lead(
    records: Iterable[Record], solution: Solution | NotSolved | None, taken: FrameTaken
) -> bool:
    """Return False if a folded frame missed the lead because it was pointed elsewhere, else True.

    ``records``: records that the fold made of the frame.
    """
    predicted = lead_id = None
    is_missed = False
    for each in records:
        if isinstance(each, TrackState) and each.is_lead:
            lead_id = each.track_id
            predicted = each if each.kind == "predicted" else predicted
        elif isinstance(each, Miss) and each.track_id in {None, lead_id}:
            is_missed = is_missed or is_without_detection(each)
    return not (is_missed and is_outside_field(predicted, solution, taken))


class FrameQuantity(NamedTuple):
    """A quantity of image or sky quality that every frame has: its name, label, unit, format."""

    name: str
    """Name of its field in ``Detections`` or ``Photometry``, and of its column in the tables."""
    label: str
    unit: str
    form: str
    """Python format of its value."""


FRAME_FACTS = (
    FrameQuantity("star_fwhm_px", "FWHM", "px", ".1f"),
    FrameQuantity("background_adu", "background", "ADU", ".0f"),
    FrameQuantity("zero_point_mag", "transparency, zero point", "mag", ".2f"),
    FrameQuantity("limiting_mag", "limiting magnitude", "mag", ".1f"),
    FrameQuantity("star_count", "stars", "", ".0f"),
)
"""Quantities of image and sky quality, in the order in which they are shown."""


def frame_quantities(frame: "NightFrame") -> dict[str, float | None]:
    """Return a frame's values of ``FRAME_FACTS`` by name; None for a value that is not known."""
    seen, light = frame.detections, frame.photometry
    return {
        each.name: getattr(seen, each.name, getattr(light, each.name, None)) for each in FRAME_FACTS
    }


def median_and_range_text(fact: FrameQuantity, values: Iterable[float | None]) -> str:
    """Format the median of a night's values and their range; empty where no value is known."""
    known = sorted(value for value in values if value is not None)
    if not known:
        return ""
    middle, low, high = (
        f"{each:{fact.form}}" for each in (known[len(known) // 2], known[0], known[-1])
    )
    return f"{middle} {fact.unit}".rstrip() + f" ({low} to {high})"


UNSOUGHT: frozenset[LoopState | None] = frozenset(("IDLE", "MANUAL", "FAULT"))
"""States of the loop in which no object is searched for or followed."""
ELSEWHERE = "not pointed at it"
"""Reason shown for a frame without the track because the telescope pointed elsewhere."""
SAME_PLACE_PX = 1.0
"""Largest distance on either axis of a measurement from its detection, pixels."""
OUTLINE_SIGMAS = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTrack:
    """One track in one frame: its prediction and its update."""

    track_id: int
    is_lead: bool
    predicted: TrackState | None = None
    updated: TrackState | None = None
    """State after the update; None where the track was not measured in the frame."""

    @property
    def number_text(self) -> str:
        """Number of the track as shown; the lead's has a star."""
        return track_number_text(self.track_id, is_lead=self.is_lead)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFold:
    """Result of folding one frame into the tracks: the records made, in order."""

    before: LoopState
    records: tuple[Record, ...] = ()
    """Records that the fold made: TrackState, NotFollowed, Miss, StateChange."""

    @property
    def state_after(self) -> LoopState:
        """The loop's state after the frame."""
        changes = (each.after for each in reversed(self.records) if isinstance(each, StateChange))
        return next(changes, self.before)


@dataclass(frozen=True, slots=True, kw_only=True)
class NightFrame:
    """Everything on record of one exposure; fields are empty where nothing is on record."""

    frame_id: int = 0
    began_utc_ns: int | None = None
    """Start of exposure by the frame's header, else the time of its record, UTC nanoseconds."""
    state_before: LoopState | None = None
    """State of the loop when the exposure was taken; None where that is not on record."""
    tau: float = 0.0
    settings: Mapping[str, float | int | str] = field(default_factory=dict)
    """Settings changed from the session's beginning to the processing of this frame, by name."""
    taken: FrameTaken | None = None
    detections: Detections | None = None
    solution: Solution | NotSolved | None = None
    measurements: tuple[Measurement, ...] = ()
    predicted: TrackState | None = None
    """The lead track's prediction; None where there is none."""
    updated: TrackState | None = None
    """The lead track's state after its measurement, or a new lead's first state; None: neither."""
    tracks: tuple[FrameTrack, ...] = ()
    not_followed: tuple[NotFollowed, ...] = ()
    misses: tuple[Miss, ...] = ()
    photometry: Photometry | None = None
    """Brightness of its streaks, and its zero point; None where neither is on record."""
    closeup: Closeup | None = None
    """Record of the place of its close-up at full resolution; None without a close-up."""
    decision: Ruling | None = None
    """The operator's last decision on the frame; None without a decision."""
    orbits: tuple[OrbitEstimate, ...] = ()
    names: tuple[Identified, ...] = ()
    fold: FrameFold | None = None
    """Result of the fold; None for a frame that is not folded, or not yet read to its end."""
    changes: tuple[StateChange, ...] = ()
    first: "NightFrame | None" = None
    """The frame before the operator's decision had it processed again; None: processed once."""

    @property
    def t_mid_utc_ns(self) -> int:
        """Mid-exposure, UTC nanoseconds; 0 for a frame without a time."""
        return (None if self.taken is None else self.taken.t_mid_utc_ns) or 0

    @property
    def has_time(self) -> bool:
        """True where the frame's mid-exposure is known."""
        return self.taken is not None and self.taken.t_mid_utc_ns is not None

    @property
    def state_after(self) -> LoopState | None:
        """The loop's state after the frame."""
        return self.changes[-1].after if self.changes else self.state_before

    @property
    def detected_streaks(self) -> tuple[Detection, ...]:
        """Detections of the frame."""
        return () if self.detections is None else self.detections.detections

    @property
    def lead_state(self) -> TrackState | None:
        """The lead track's best state at mid-exposure: updated, else predicted; None: neither."""
        return self.updated or self.predicted

    @property
    def all_measurements(self) -> tuple[Measurement, ...]:
        """Measurements of the frame, then that accepted by the operator, if any."""
        taken = None if self.decision is None else self.decision.taken
        return self.measurements if taken is None else (*self.measurements, taken)

    def light_of(self, measurement_id: str | None) -> StreakLight | None:
        """Return the brightness of a measurement's streak; None where it was not measured."""
        streaks = () if self.photometry is None else self.photometry.streaks
        return next((s for s in streaks if s.measurement_id == measurement_id), None)

    @property
    def lead_light(self) -> StreakLight | None:
        """Brightness of the streak that the lead track took; None where it was not measured."""
        return None if self.updated is None else self.light_of(self.updated.measurement_id)

    @property
    def lead_measured(self) -> Measurement | None:
        """The measurement that the lead track took; None where it took none."""
        named = None if self.updated is None else self.updated.measurement_id
        return next((m for m in self.all_measurements if m.measurement_id == named), None)

    @property
    def accepted_measurement(self) -> Measurement | None:
        """The measurement accepted by the operator, else by the lead track; None without either."""
        taken = None if self.decision is None else self.decision.taken
        return self.lead_measured if taken is None else taken

    @property
    def other_measurements(self) -> tuple[Measurement, ...]:
        """Measurements of the frame that the lead track did not take."""
        measured = self.lead_measured
        return tuple(m for m in self.measurements if m is not measured)

    @property
    def other_track_states(self) -> dict[int, TrackState]:
        """Best states (updated, else predicted) of the tracks other than the lead, by track id."""
        states = {each.track_id: each.updated or each.predicted for each in self._not_led()}
        return {number: state for number, state in states.items() if state is not None}

    @property
    def lead_miss(self) -> Miss | None:
        """The lead track's miss; None where it was measured, or where there was no track."""
        others = {each.track_id for each in self._not_led()}
        own = (each for each in reversed(self.misses) if each.track_id not in others)
        return next(own, None)

    @property
    def lead_miss_reason(self) -> str | None:
        """Reason why the lead track was missed, in words; None where it was not missed."""
        miss = self.lead_miss
        return None if miss is None else text(miss.reason)

    @property
    def is_miss_outside_field(self) -> bool:
        """True where the lead was missed because its predicted position was outside the field."""
        miss = self.lead_miss
        return miss is not None and is_without_detection(miss) and self.is_lead_outside_field

    @property
    def is_lead_outside_field(self) -> bool:
        """True where the lead's predicted position is outside the solved field."""
        return is_outside_field(self.predicted, self.solution, self.taken)

    def _not_led(self) -> tuple[FrameTrack, ...]:
        return tuple(each for each in self.tracks if not each.is_lead)

    def track_of(self, measured: Measurement) -> FrameTrack | None:
        """Return the track that took a measurement; None where no track took it."""
        named = measured.measurement_id
        taken_by = (t for t in self.tracks if t.updated and t.updated.measurement_id == named)
        return next(taken_by, None)

    def streak_of(self, measured: Measurement) -> Detection | None:
        """Return the detection of a measurement; None for a mark by hand."""
        return next(
            (each for each in self.detected_streaks if is_measurement_of(each, measured)), None
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """Values of one exposure that the plots show."""

    frame_id: int
    is_reduced: bool = False
    """True where the frame's detections or its miss are on record."""
    confidence: float | None = None
    """Confidence of the best detection above tau; None without a detection."""
    miss: str | None = None
    refused: tuple[float, str] | None = None
    """Confidence of the likeliest streak that was not accepted, and why; None: there is none."""
    is_followed: bool = False
    """True where the track took a measurement in the frame."""
    residual_arcsec: tuple[float, float] | None = None
    """Innovation (RA on the sky, Dec), arcsec; None where nothing was measured."""
    sigma_arcsec: tuple[float, float] | None = None
    """One sigma of the innovation, arcsec; of the prediction where nothing was measured."""
    nis: float | None = None
    facts: Mapping[str, float | None] = field(default_factory=dict)
    t_utc_ns: int | None = None
    """Start of exposure, UTC nanoseconds."""
    mount_icrs_deg: tuple[float, float] | None = None
    """RA and Dec that the mount reported, ICRS, degrees; None: it reported none."""
    plate_icrs_deg: tuple[float, float] | None = None
    """RA and Dec of the frame's centre by its plate solution, ICRS, degrees; None: not solved."""
    rotation_deg: float | None = None
    """Position angle of the frame's +y axis by its plate solution, east of north, degrees."""
    was_sought: bool = True
    """True where it was pointed at the object in a state that looks for one: else no miss."""
    settings: Mapping[str, float | int | str] = field(default_factory=dict)
    """Settings changed from the session's beginning to the processing of this frame, by name."""
    is_solved: bool | None = None
    """True where the frame was plate-solved; None while that is not known."""
    is_cloudy: bool = False
    is_by_orbit: bool = False
    """True where the innovation is relative to the orbit's prediction: the filter's had failed."""
    measurement_id: str | None = None
    """The measurement that the track took in the frame; None where it took none."""
    light: StreakLight | None = None
    """Brightness of that measurement, without its steps; None where it is not on record."""

    @property
    def fwhm_px(self) -> float | None:
        """FWHM of the frame's stars, pixels; None where it is not known."""
        return self.facts.get("star_fwhm_px")

    @property
    def zero_point_mag(self) -> float | None:
        """Photometric zero point of the frame, magnitudes: a measure of the sky's transparency."""
        return self.facts.get("zero_point_mag")


def frame_row(frame: NightFrame) -> FrameRow:
    """Return the values of a frame that the plots show."""
    seen, plate, taken, updated = frame.detections, frame.solution, frame.taken, frame.updated
    miss, is_elsewhere = frame.lead_miss, frame.is_miss_outside_field
    hidden_by = () if miss is None or is_elsewhere else miss.reason.hidden_by
    row = FrameRow(
        frame_id=frame.frame_id,
        is_reduced=seen is not None or miss is not None,
        confidence=max((each.confidence for each in frame.detected_streaks), default=None),
        miss=ELSEWHERE if is_elsewhere else None if miss is None else text(miss.reason),
        refused=_refused(frame),
        is_followed=updated is not None,
        sigma_arcsec=None if frame.predicted is None else predicted_sigma_arcsec(frame.predicted),
        t_utc_ns=frame.began_utc_ns,
        mount_icrs_deg=None if taken is None else mount_icrs_deg(taken),
        was_sought=not is_elsewhere and frame.state_before not in UNSOUGHT,
        settings=frame.settings,
        facts=frame_quantities(frame),
        is_solved=None if plate is None else isinstance(plate, Solution),
        is_cloudy=any(each.kind in CLOUD for each in hidden_by),
        measurement_id=None if updated is None else updated.measurement_id,
        light=without_steps(frame.lead_light),
    )
    if updated is not None and updated.innovation_arcsec is not None:
        row = replace(
            row,
            residual_arcsec=updated.innovation_arcsec,
            sigma_arcsec=updated.sigma_innovation_arcsec,
            nis=updated.nis,
            is_by_orbit=updated.foretold_by == "orbit",
        )
    if isinstance(plate, Solution):
        place = (plate.ra_icrs_deg, plate.dec_icrs_deg)
        row = replace(row, plate_icrs_deg=place, rotation_deg=plate.rotation_deg)
    return row


def without_steps(light: StreakLight | None) -> StreakLight | None:
    """Return a streak's brightness without its steps, which a whole night would make too many."""
    return None if light is None else replace(light, steps=())


def track_number_text(track_id: int, *, is_lead: bool) -> str:
    """Format a track's number; the lead's gets a star."""
    return f"{track_id}*" if is_lead else f"{track_id}"


def predicted_sigma_arcsec(track: TrackState) -> tuple[float, float]:
    """Return the one-sigma errors (east, north) on the sky of a state's position, arcsec."""
    cos_dec = math.cos(math.radians(track.x[2]))
    east_deg = math.sqrt(max(track.P[0][0], 0.0)) * cos_dec
    return east_deg * 3600.0, math.sqrt(max(track.P[2][2], 0.0)) * 3600.0


def uncertainty_ellipse_px(
    track: TrackState, solution: Solution, points: int
) -> tuple[tuple[float, float], ...]:
    """Return ``points`` pixels (x, y) on the 3-sigma ellipse of a state's position.

    Points that the plate solution cannot map (not finite) are left out.
    """
    from rsoconsole.sky import sky_to_pixel

    ra, _, dec, _ = track.x
    cos_dec = max(math.cos(math.radians(dec)), 1e-6)
    cross = track.P[0][2] * cos_dec
    east_north = np.array([[track.P[0][0] * cos_dec**2, cross], [cross, track.P[2][2]]])
    values, axes = np.linalg.eigh(east_north)
    turns = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    circle = np.stack([np.cos(turns), np.sin(turns)])
    east, north = axes @ (OUTLINE_SIGMAS * np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    x, y = sky_to_pixel(solution.wcs, ra + east / cos_dec, dec + north)
    found = np.stack([np.asarray(x, float), np.asarray(y, float)], axis=1)
    return tuple((float(a), float(b)) for a, b in found[np.isfinite(found).all(axis=1)])


def is_measurement_of(detection: Detection, measured: Measurement | None) -> bool:
    """Return True if a measurement is of this detection: within ``SAME_PLACE_PX`` on both axes."""
    return measured is not None and (
        abs(detection.x_px - measured.x_px) < SAME_PLACE_PX
        and abs(detection.y_px - measured.y_px) < SAME_PLACE_PX
    )


def mount_icrs_deg(taken: FrameTaken) -> tuple[float, float] | None:
    """Return the RA and Dec that the mount reported, ICRS degrees; None if it did not."""
    ra_deg, dec_deg = taken.pointing_ra_icrs_deg, taken.pointing_dec_icrs_deg
    return None if ra_deg is None or dec_deg is None else (ra_deg, dec_deg)


def _refused(frame: NightFrame) -> tuple[float, str] | None:
    """Return the likeliest rejected or unused streak with its reason; of equal ones the first."""
    rejected = () if frame.detections is None else frame.detections.rejected
    candidates: list[tuple[float, Reason]] = [(r.detection.confidence, r.reason) for r in rejected]
    candidates += [(each.measurement.confidence, each.reason) for each in frame.not_followed]
    best = max(candidates, key=lambda each: each[0], default=None)
    return None if best is None else (best[0], text(best[1]))
