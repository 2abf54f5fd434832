"""A night under a sky of ours is judged by what was there, not by what the engine says of it."""

import dataclasses

import pytest

from rsoconsole.records import (
    Cause,
    Event,
    Miss,
    Missed,
    NotFollowed,
    NotTaken,
    StateChange,
    TrackState,
)
from tests.library.test_figures import ARCSEC, FRAMES, NS, measurement, taken
from tests.real_sky.real_sky_judge import judge

SCATTER_ARCSEC = 3.0


def truth_of(frame_id, snr=100.0, **more):
    """The satellite a call late by the scatter; it is drawn that much further on."""
    exact = measurement(frame_id)
    return {
        "t_start_utc_ns": taken(frame_id).t_start_utc_ns + 40_000_000,
        "exposure_s": 10.0,
        "scatter_s": 0.2,
        "ms": 300.0,
        "satellites": [
            {
                "name": "NIGHT ONE",
                "norad_id": 80001,
                "ra_icrs_deg": exact.ra_icrs_deg,
                "dec_icrs_deg": -5.0,
                "ra_drawn_icrs_deg": exact.ra_icrs_deg,
                "dec_drawn_icrs_deg": -5.0 + SCATTER_ARCSEC * ARCSEC,
                "is_in_frame": True,
                "snr_matched": snr,
                **more,
            }
        ],
    }


def state(kind, frame_id, misses=0):
    exact = measurement(frame_id)
    cov = tuple(tuple(1e-8 * (i == j) for j in range(4)) for i in range(4))
    at = (exact.ra_icrs_deg, 15.04 * ARCSEC, -5.0 + ARCSEC, 0.0)
    return TrackState(
        track_id=1,
        measurement_id=None if kind == "predicted" else exact.measurement_id,
        kind=kind,
        frame_id=frame_id,
        t_utc_ns=exact.t_mid_utc_ns,
        x=at,
        P=cov,
        misses=misses,
    )


@pytest.fixture
def records():
    """Two frames to lock, three in which it is followed, then coasting beside what is detected."""
    told = [Event(level="alarm", text="no frame"), Event(level="info", text="all well")]
    for frame_id in range(1, FRAMES + 1):
        seen = dataclasses.replace(
            measurement(frame_id), dec_icrs_deg=-5.0 + SCATTER_ARCSEC * ARCSEC
        )
        told += [taken(frame_id), seen]
        if frame_id == 2:
            told += [state("initial", 2), change(2, "ACQUIRE", "TRACK")]
        elif frame_id in (3, 4, 5):
            told += [state("predicted", frame_id, misses=1), state("updated", frame_id)]
        elif frame_id > 5:
            told.append(state("predicted", frame_id, misses=frame_id - 4))
            reason = NotTaken.by_gate(frame_id + 0.5, 11.8)
            told.append(NotFollowed(frame_id=frame_id, measurement=seen, reason=reason))
            told.append(Miss(frame_id=frame_id, reason=Missed(kind="nothing fits")))
        if frame_id == 6:
            told.append(change(6, "TRACK", "COAST"))
    return told


def change(frame_id, before, after):
    return StateChange(
        frame_id=frame_id, before=before, after=after, reason=Cause(kind="measured again")
    )


def test_a_night_that_coasts_beside_its_satellite_is_called_so(records):
    truth = [truth_of(k) for k in range(1, FRAMES + 1)]
    found = judge(records, truth)
    (one,) = found["objects"]
    assert (one["detections"], one["visible_frames"]) == (FRAMES, FRAMES)
    assert (one["track_frames"], one["coast_frames"]) == (4, FRAMES - 5)
    assert found["reasons"] == {
        "NotFollowed: NIS # above the gate #": FRAMES - 5,
        "Miss: nothing fits the prediction": FRAMES - 5,
    }
    assert found["states_in_order"][:6] == ["SEARCH", "TRACK", "TRACK", "TRACK", "TRACK", "COAST"]
    assert found["call_after_header_ms"] == pytest.approx(40.0)
    assert (found["calls"], found["alarms"]) == (FRAMES, {"no frame": 1})


def test_the_shutters_error_counts_against_truth_and_not_against_what_was_drawn(records):
    truth = [truth_of(k) for k in range(1, FRAMES + 1)]
    (one,) = judge(records, truth)["objects"]
    assert one["measured_rms_arcsec"] == pytest.approx(SCATTER_ARCSEC, abs=1e-6)
    assert one["drawn_rms_arcsec"] == pytest.approx(0.0, abs=1e-6)
    assert one["prediction_rms_arcsec"] == pytest.approx(1.0, abs=1e-6)


def test_what_is_too_faint_or_outside_is_not_visible(records):
    truth = [truth_of(k) for k in range(1, FRAMES + 1)]
    truth[0] = truth_of(1, snr=19.9)
    truth[1] = truth_of(2, is_in_frame=False)
    (one,) = judge(records, truth)["objects"]
    assert one["visible_frames"] == FRAMES - 2


def test_a_measurement_of_nothing_is_false(records):
    records.insert(4, measurement(1, north_arcsec=400.0))
    truth = [truth_of(k) for k in range(1, FRAMES + 1)]
    found = judge(records, truth)
    assert found["false_measurements"] == 1
    assert found["objects"][0]["false_measurements"] == 1
    assert found["objects"][0]["detections"] == FRAMES


def test_a_frame_without_a_call_has_no_truth(records):
    truth = [truth_of(k) for k in range(2, FRAMES + 1)]
    found = judge(records, truth)
    assert found["frames_with_truth"] == FRAMES - 1
    # Nobody can say what its measurement was of.
    assert found["false_measurements"] == 1
    truth[0] = {**truth[0], "t_start_utc_ns": truth[0]["t_start_utc_ns"] - 5 * NS}
    assert judge(records, truth)["frames_with_truth"] == FRAMES - 2
