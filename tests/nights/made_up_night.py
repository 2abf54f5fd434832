"""A night made up record by record, to be shown; no engine has a part in it."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import Config
from rsoconsole.records import (
    Cause,
    ChartStar,
    Closeup,
    CycleTiming,
    Detections,
    Event,
    FrameTaken,
    LoopState,
    Measurement,
    Miss,
    Missed,
    Solution,
    StateChange,
    TrackState,
    Wcs,
)
from rsoconsole.session import SessionWriter
from tests.makers import NS, T0_UTC_NS, geo_measurement, straight_detection

CADENCE_S = 30
WIDTH_PX, HEIGHT_PX = 4656, 3520
SCALE_DEG = 1.264 / 3600
FIRST_MEASURED, MISSED = 3, 12
NO_DETECTION = Missed(kind="no detection")


def begin(folder: Path, **about: Any) -> SessionWriter:
    """An empty session."""
    return SessionWriter.create(folder, Config(), {"title": "made up", **about})


def t_of(frame_id: int) -> int:
    """When the frame's records were made."""
    return T0_UTC_NS + frame_id * CADENCE_S * NS


def armed(writer: SessionWriter) -> None:
    """The first line of a night."""
    _state(writer, 0, "IDLE", "SEARCH", Cause(kind="armed", by="operator"))


def add_frames(writer: SessionWriter, frames: range, missed: Collection[int] = (MISSED,)) -> None:
    """Frames in order: two empty ones, a track from the fourth on, frame 12 missed.

    ``missed``: others, none of them beside another.
    """
    for frame_id in frames:
        add_one(writer, frame_id, missed)
    assert writer.flush()


def add_previews(
    writer: SessionWriter, frames: range, stars: Sequence[ChartStar] | None = None
) -> None:
    """Their pictures: a dark sky with a few stars, and a streak from near, the same for all."""
    random = np.random.default_rng(5)
    picture = random.normal(60, 6, (440, 582)).astype(np.uint8)
    for x, y in ((60, 60), (300, 110), (500, 350), (120, 400), (420, 220)):
        picture[y : y + 3, x : x + 3] = 250
    closeup = random.normal(60, 12, (192, 256)).astype(np.uint8)
    closeup[94:97, 70:188] = 200
    for frame_id in frames:
        assert writer.save_preview(frame_id, picture, stars)
        place = Closeup(frame_id=frame_id, x0_px=1872, y0_px=1405, width_px=256, height_px=192)
        writer.append(place, t_of(frame_id))
        assert writer.save_closeup(frame_id, closeup)
        assert writer._previews.drain(20)
    assert writer.flush()


def add_one(writer: SessionWriter, n: int, missed: Collection[int]) -> None:
    """One frame of it."""
    ns = t_of(n)
    is_seen = n >= FIRST_MEASURED and n not in missed
    pointing = geo_measurement(n, cadence_s=CADENCE_S)
    ra, dec = pointing.ra_icrs_deg, pointing.dec_icrs_deg
    writer.append(taken(n, ra, dec), ns)
    found = (straight_detection(frame_id=n, x_px=2000.0, y_px=1500.0, confidence=_confidence(n)),)
    writer.append(
        Detections(
            frame_id=n,
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
            detections=found if is_seen else (),
        ),
        ns,
    )
    writer.append(solution_of(n, ra, dec), ns)
    if is_seen:
        measurement = geo_measurement(n, cadence_s=CADENCE_S, confidence=_confidence(n))
        writer.append(measurement, ns)
        _track(writer, n, measurement)
    elif n > FIRST_MEASURED:
        writer.append(state_of(n, ra, dec, "predicted"), ns)
        writer.append(Miss(frame_id=n, reason=NO_DETECTION, track_id=1), ns)
        _state(writer, n, "TRACK", "COAST", Cause(kind="missed", missed=NO_DETECTION))
    if n == FIRST_MEASURED:
        _state(writer, n, "SEARCH", "ACQUIRE", Cause(kind="waiting", detections=1))
    elif n == FIRST_MEASURED + 1:
        _state(writer, n, "ACQUIRE", "TRACK", Cause(kind="two frames agree"))
    elif n - 1 in missed:
        _state(writer, n, "COAST", "TRACK", Cause(kind="measured again"))
    if n == 7:
        writer.append(Event(level="warning", text="slew refused: altitude", frame_id=n), ns)
    stages = {"read": 30.0, "process": 54.0, "detect": 90.0, "solve": 4.0, "filter": 0.4}
    writer.append(CycleTiming(frame_id=n, stage_ms={**stages, "total": 180.0}), ns)


def _confidence(n: int) -> float:
    return 0.55 + 0.4 * (n * 7 % 10) / 10


def _track(writer: SessionWriter, n: int, measurement: Measurement) -> None:
    if n == FIRST_MEASURED:
        return
    ra, dec = measurement.ra_icrs_deg, measurement.dec_icrs_deg
    kind = "initial" if n == FIRST_MEASURED + 1 else "updated"
    if kind == "updated":
        writer.append(state_of(n, ra, dec, "predicted"), t_of(n))
    writer.append(state_of(n, ra, dec, kind, measurement.measurement_id), t_of(n))


def state_of(
    n: int, ra: float, dec: float, kind: Any, measurement_id: str | None = None
) -> TrackState:
    """The filter after a frame."""
    is_updated = kind == "updated"
    variance = (1.0 / 3600) ** 2
    return TrackState(
        track_id=1,
        measurement_id=measurement_id,
        begun_with=(_first_id(), measurement_id) if kind == "initial" and measurement_id else None,
        kind=kind,
        frame_id=n,
        t_utc_ns=t_of(n),
        x=(ra, 15.041 / 3600, dec, 0.0),
        P=(
            (variance, 0.0, 0.0, 0.0),
            (0.0, 1e-11, 0.0, 0.0),
            (0.0, 0.0, variance, 0.0),
            (0.0, 0.0, 0.0, 1e-11),
        ),
        nis=1.5 if is_updated else None,
        innovation_arcsec=((n * 3 % 7 - 3) / 3, (n * 5 % 9 - 4) / 5) if is_updated else None,
        sigma_innovation_arcsec=(0.7, 0.6) if is_updated else None,
        misses=1 if kind == "predicted" else 0,
    )


def _first_id() -> str:
    return geo_measurement(FIRST_MEASURED, cadence_s=CADENCE_S).measurement_id


def taken(n: int, ra: float, dec: float) -> FrameTaken:
    """The camera gave a frame."""
    return FrameTaken(
        frame_id=n,
        name=f"frame_{n:06d}.fits",
        t_start_utc_ns=t_of(n) - 12 * NS,
        exposure_s=10.0,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        pointing_ra_icrs_deg=ra,
        pointing_dec_icrs_deg=dec,
    )


def solution_of(n: int, ra: float, dec: float) -> Solution:
    """The stars gave its place: north is at the bottom."""
    return Solution(
        frame_id=n,
        wcs=Wcs(
            crpix_x_px=(WIDTH_PX - 1) / 2,
            crpix_y_px=(HEIGHT_PX - 1) / 2,
            crval_ra_deg=ra,
            crval_dec_deg=dec,
            cd=(-SCALE_DEG, 0.0, 0.0, SCALE_DEG),
        ),
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        scale_arcsec_px=1.264,
        rotation_deg=0.0,
        is_flipped=False,
        matched=42,
        rms_arcsec=0.31,
        path="refit",
        ms=4.0,
    )


def _state(
    writer: SessionWriter, n: int, before: LoopState, after: LoopState, reason: Cause
) -> None:
    writer.append(StateChange(frame_id=n, before=before, after=after, reason=reason), t_of(n))
