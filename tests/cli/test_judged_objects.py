"""The summary object by object: told apart by true streaks, judged by a truth made up here."""

from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from rsoconsole.cli.judge._objects import VISIBLE_SNR, is_on_a_streak, objects_figures
from rsoconsole.night import FrameTrack
from rsoconsole.records import CatalogueMatch, Detection, Identified, Measurement, TrackState

ARCSEC = 1 / 3600
ALPHA, BETA = 111, 222
PX_ARCSEC = 1.264


@dataclass
class FakeFrame:
    measurements: list[Measurement] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)
    predicted: TrackState | None = None
    updated: TrackState | None = None
    identified: Identified | None = None
    other_track_states: dict[int, FrameTrack] = field(default_factory=dict)
    """What other tracks made of it."""

    @property
    def detected_streaks(self) -> list[Detection]:
        return self.detections

    @property
    def names(self) -> list[Identified]:
        return [] if self.identified is None else [self.identified]

    @property
    def tracks(self) -> list[FrameTrack]:
        if self.predicted is None and self.updated is None:
            return [*self.other_track_states.values()]
        lead = FrameTrack(track_id=1, is_lead=True, predicted=self.predicted, updated=self.updated)
        return [lead, *self.other_track_states.values()]


def satellite(number: int, y_px: float, snr: float = 100.0, length_px: float = 120.0) -> dict:
    """A level streak about column 1000; its place on the sky grows with the row."""
    return {
        "norad_id": number,
        "name": {ALPHA: "ALPHA", BETA: "BETA"}[number],
        "is_in_frame": True,
        "ra_icrs_deg": 40.0,
        "dec_icrs_deg": y_px * PX_ARCSEC * ARCSEC,
        "x_px": 1000.0,
        "y_px": y_px,
        "x_start_px": 1000.0 - length_px / 2,
        "y_start_px": y_px,
        "x_end_px": 1000.0 + length_px / 2,
        "y_end_px": y_px,
        "snr_integrated": snr,
    }


def exposure(*satellites: dict) -> dict[str, Any]:
    return {"fwhm_px": 2.2, "satellites": satellites}


def measured(y_px: float, x_px: float = 1000.0, north_arcsec: float = 0.0, **more) -> Measurement:
    return Measurement(
        measurement_id=f"1-{x_px}-{y_px}",
        frame_id=1,
        t_mid_utc_ns=0,
        ra_icrs_deg=40.0 - (x_px - 1000.0) * PX_ARCSEC * ARCSEC,
        dec_icrs_deg=(y_px * PX_ARCSEC + north_arcsec) * ARCSEC,
        cov_sky_arcsec2=(1.0, 0.0, 1.0),
        x_px=x_px,
        y_px=y_px,
        confidence=0.9,
        source="network",
        **more,
    )


def detected(y_px: float, x_px: float = 1000.0) -> Detection:
    return Detection(
        frame_id=1,
        confidence=0.9,
        x_px=x_px,
        y_px=y_px,
        x_a_px=x_px - 60,
        y_a_px=y_px,
        x_b_px=x_px + 60,
        y_b_px=y_px,
        box_px=(x_px - 60, y_px - 3, x_px + 60, y_px + 3),
        length_px=120.0,
        width_px=2.5,
        snr=50.0,
        sigma_along_px=0.3,
        sigma_across_px=0.1,
        is_clipped=False,
        method="line",
    )


def state(kind: str, y_px: float, misses: int = 0, north_arcsec: float = 0.0) -> TrackState:
    dec_deg = (y_px * PX_ARCSEC + north_arcsec) * ARCSEC
    zero = (0.0,) * 4
    return TrackState(
        track_id=1,
        measurement_id=None if kind == "predicted" else f"1-1000.0-{y_px}",
        kind=kind,
        frame_id=1,
        t_utc_ns=0,
        x=(40.0, 0.0, dec_deg, 0.0),
        P=(zero, zero, zero, zero),
        nis=None if kind != "updated" else 1.0,
        innovation_arcsec=(0.0, 0.0) if kind == "updated" else None,
        misses=misses,
    )


def named(number: int, verdict: str = "identified") -> Identified:
    match = CatalogueMatch(
        norad_id=number,
        name="",
        separation_arcsec=1.0,
        along_track_s=0.0,
        cross_track_arcsec=0.0,
        rate_difference_percent=None,
        tle_age_days=1.0,
        score=1.0,
        probability=0.9,
    )
    return Identified(
        frame_id=1,
        track_id=1,
        verdict=verdict,
        reason="",
        hint="",
        observations=3,
        catalogued=2,
        matches=(match,),
    )


def followed_for(frames: int, y_px: float = 500.0) -> list[tuple[FakeFrame, dict]]:
    views = []
    for k in range(frames):
        kind = "initial" if k == 0 else "updated"
        frame = FakeFrame(
            [measured(y_px, north_arcsec=1.0), measured(560.0)],
            [detected(y_px), detected(560.0)],
            None if k == 0 else state("predicted", y_px, north_arcsec=4.0),
            state(kind, y_px),
        )
        views.append((frame, exposure(satellite(ALPHA, 500.0), satellite(BETA, 560.0))))
    return views


def test_two_neighbours_are_counted_apart_and_only_the_followed_one_has_a_track():
    alpha, beta = objects_figures(followed_for(4), {ALPHA: "ALPHA"})
    assert (alpha["norad"], alpha["name"]) == (ALPHA, "ALPHA")
    assert (alpha["detections"], alpha["visible_frames"], alpha["track_frames"]) == (4, 4, 4)
    assert (beta["detections"], beta["visible_frames"], beta["track_frames"]) == (4, 4, 0)
    assert alpha["measured_rms_arcsec"] == pytest.approx(1.0, abs=1e-6)
    assert beta["measured_rms_arcsec"] == pytest.approx(0.0, abs=1e-6)
    assert alpha["prediction_rms_arcsec"] == pytest.approx(4.0, abs=1e-6)
    assert beta["prediction_rms_arcsec"] is None
    assert alpha["false_measurements"] == beta["false_measurements"] == 0


def test_a_target_that_never_came_is_listed_with_nothing():
    [alpha] = objects_figures([(FakeFrame(), exposure())], {ALPHA: "ALPHA"})
    assert alpha == {
        "norad": ALPHA,
        "name": "ALPHA",
        "detections": 0,
        "visible_frames": 0,
        "track_frames": 0,
        "measured_rms_arcsec": None,
        "prediction_rms_arcsec": None,
        "identified": None,
        "false_measurements": 0,
        "detected_after_lock": 0,
        "tracked_after_lock": 0,
        "inside_3sigma": None,
        "nis_mean": None,
        "whiteness": None,
        "longest_wrong": 0,
        "swapped_frames": 0,
    }


def test_a_track_that_goes_over_to_a_neighbour_is_counted_in_frames():
    views = followed_for(6)
    for frame, _ in views[2:5]:
        frame.updated = replace(frame.updated, measurement_id=frame.measurements[1].measurement_id)
    alpha, _ = objects_figures(views, {ALPHA: "ALPHA"})
    assert alpha["longest_wrong"] == 3
    assert (alpha["detected_after_lock"], alpha["tracked_after_lock"]) == (5, 2)
    assert alpha["false_measurements"] == 3


def test_every_track_is_judged_by_what_it_began_with():
    """The second track is on BETA, and takes ALPHA's streak in its last frame but one."""
    views = followed_for(6)
    for k, (frame, _) in enumerate(views):
        updated = state("initial" if k == 0 else "updated", 500.0 if k == 4 else 560.0)
        frame.other_track_states[2] = FrameTrack(
            track_id=2,
            is_lead=False,
            predicted=None if k == 0 else state("predicted", 560.0),
            updated=replace(updated, track_id=2),
        )
    alpha, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert (alpha["tracked_after_lock"], alpha["swapped_frames"]) == (5, 0)
    assert (beta["detected_after_lock"], beta["tracked_after_lock"]) == (5, 4)
    assert (beta["track_frames"], beta["swapped_frames"]) == (5, 1)
    assert (alpha["longest_wrong"], beta["longest_wrong"]) == (0, 0)


def begun_at(first_px: float, other_snr: float) -> dict[str, dict[str, Any]]:
    """Four frames of a track on ALPHA, whose first streak lies elsewhere by chance."""
    views = []
    for k in range(4):
        at_px = first_px if k == 0 else 500.0
        frame = FakeFrame(
            [measured(at_px)],
            [detected(at_px)],
            None if k == 0 else state("predicted", 500.0),
            state("initial" if k == 0 else "updated", at_px),
        )
        other = satellite(BETA, 508.0) | {"snr_integrated": other_snr}
        views.append((frame, exposure(satellite(ALPHA, 500.0), other)))
    alpha, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert alpha["swapped_frames"] == 0
    return {"alpha": alpha, "beta": beta}


@pytest.mark.parametrize(
    ("first_px", "other_snr", "taken"),
    [
        (504.2, 25.0, "alpha"),  # about as near to both: the brighter
        (504.2, 150.0, "beta"),
        (507.5, 5.8, "alpha"),  # nearer to one that is not visible: a night was put on such a one
        (507.5, 25.0, "beta"),
    ],
)
def test_a_track_begins_with_the_nearest_of_those_that_are_visible(first_px, other_snr, taken):
    on = begun_at(first_px, other_snr)[taken]
    assert on["track_frames"] + on["false_measurements"] == 4


@pytest.mark.parametrize(("shares", "swapped"), [(1, 0), (None, 1)])
def test_a_streak_of_both_is_each_ones_where_its_track_says_so(shares, swapped):
    """BETA's track takes the streak between both, nearer to ALPHA's middle."""
    views = _taken_at_an_approach(506.0, shares)
    _, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert (beta["swapped_frames"], beta["track_frames"]) == (swapped, 4 - swapped)


@pytest.mark.parametrize(("apart_fwhm", "swapped"), [(1.9, 0), (2.1, 1)])
def test_which_of_two_lines_a_track_took_is_judged_where_a_camera_shows_two(apart_fwhm, swapped):
    views = _taken_at_an_approach(500.0 + 2.2 * apart_fwhm, None)
    _, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert (beta["swapped_frames"], beta["track_frames"]) == (swapped, 4 - swapped)


def _taken_at_an_approach(there_px: float, shares: int | None) -> list:
    """BETA's track takes ALPHA's streak in the last of four frames, where they are near."""
    views = []
    for k in range(4):
        alpha_px, beta_px = (500.0, there_px) if k == 3 else (500.0, 560.0)
        frame = FakeFrame([measured(500.0), measured(560.0)], [detected(500.0), detected(560.0)])
        kind = "initial" if k == 0 else "updated"
        taken = state(kind, 500.0 if k == 3 else 560.0)
        frame.other_track_states[2] = FrameTrack(
            track_id=2,
            is_lead=False,
            predicted=None if k == 0 else state("predicted", beta_px),
            updated=replace(taken, track_id=2, shared_with=shares if k == 3 else None),
        )
        views.append((frame, exposure(satellite(ALPHA, alpha_px), satellite(BETA, beta_px))))
    return views


@pytest.mark.parametrize(("sigma_arcsec", "inside"), [(1.0, 0.0), (1.5, 1.0)])
def test_a_prediction_four_arcsec_off_is_inside_three_sigmas_or_not(sigma_arcsec, inside):
    views = followed_for(3)
    variance = (sigma_arcsec / 3600.0) ** 2
    for frame, _ in views[1:]:
        P = tuple(tuple(variance * (i == j) for j in range(4)) for i in range(4))
        frame.predicted = replace(frame.predicted, P=P)
    alpha, _ = objects_figures(views, {ALPHA: "ALPHA"})
    assert alpha["inside_3sigma"] == inside


def test_truth_is_that_of_each_streaks_own_instant():
    """A shutter that rolls: the streak of a later row is where the satellite was a little later."""
    (frame, truth), *_ = followed_for(1)
    rate_deg_s = 15.0 / 3600.0
    for each in truth["satellites"]:
        each |= {"t_utc_ns": 0, "ra_rate_deg_s": 0.0, "dec_rate_deg_s": rate_deg_s}
    moved = replace(frame.measurements[0], t_mid_utc_ns=40_000_000)
    moved = replace(moved, dec_icrs_deg=moved.dec_icrs_deg + 0.04 * rate_deg_s)
    frame.measurements[0] = moved
    frame.measurements[1:] = []
    alpha, _ = objects_figures([(frame, truth)], {ALPHA: "ALPHA"})
    assert alpha["measured_rms_arcsec"] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("snr", "is_in_frame", "visible"),
    [(VISIBLE_SNR, True, 1), (VISIBLE_SNR - 0.1, True, 0), (100.0, False, 0)],
)
def test_visible_is_what_is_in_the_field_and_bright_enough(snr, is_in_frame, visible):
    true = satellite(ALPHA, 500.0, snr) | {"is_in_frame": is_in_frame}
    [alpha] = objects_figures([(FakeFrame(), exposure(true))], {ALPHA: "ALPHA"})
    assert alpha["visible_frames"] == visible


def test_what_nobody_named_and_nobody_could_see_is_not_listed():
    faint = satellite(BETA, 500.0, snr=5.0)
    assert objects_figures([(FakeFrame(), exposure(faint))], {}) == []
    [beta] = objects_figures([(FakeFrame(detections=[detected(500.0)]), exposure(faint))], {})
    assert (beta["detections"], beta["visible_frames"]) == (1, 0)


def test_a_long_streaks_far_middle_is_its_own_and_a_point_beside_it_is_not():
    true = exposure(satellite(ALPHA, 500.0, length_px=1000.0))
    far_along_px, beside_px = 400.0, 30.0
    assert is_on_a_streak(measured(500.0, 1000.0 + far_along_px), true)
    assert not is_on_a_streak(measured(500.0 + beside_px), true)
    assert not is_on_a_streak(measured(500.0, 1000.0 + 2 * far_along_px), true)


def test_a_cut_streak_is_judged_across_alone():
    ends = ((40.05, 500 * PX_ARCSEC * ARCSEC), (39.95, 500 * PX_ARCSEC * ARCSEC))
    cut = measured(500.0, 1030.0, north_arcsec=2.0, is_clipped=True, ends_icrs_deg=ends)
    views = [(FakeFrame([cut]), exposure(satellite(ALPHA, 500.0)))]
    [alpha] = objects_figures(views, {ALPHA: "ALPHA"})
    assert alpha["measured_rms_arcsec"] == pytest.approx(2.0, abs=1e-3)


def test_what_a_track_took_that_was_not_of_its_object_is_counted_to_it():
    views = followed_for(3)
    nowhere = FakeFrame([measured(800.0)], [], state("predicted", 500.0), state("updated", 800.0))
    views.append((nowhere, views[0][1]))
    neighbour = FakeFrame([measured(560.0)], [], state("predicted", 500.0), state("updated", 560.0))
    views.append((neighbour, views[0][1]))
    alpha, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert (alpha["track_frames"], alpha["false_measurements"]) == (3, 2)
    assert (beta["track_frames"], beta["false_measurements"]) == (0, 0)


@pytest.mark.parametrize(
    ("found", "is_right"),
    [(named(ALPHA), True), (named(BETA), False), (named(ALPHA, "ambiguous"), None), (None, None)],
)
def test_a_name_is_right_wrong_or_not_given(found, is_right):
    views = followed_for(3)
    views[-1][0].identified = found
    alpha, beta = objects_figures(views, {ALPHA: "ALPHA"})
    assert alpha["identified"] is is_right
    assert beta["identified"] is None
