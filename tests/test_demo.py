"""The whole way, from a bare command to a satellite found and followed, as a shell sees it."""

import json
from typing import Any

import pytest

from rsoconsole.pipeline.cycle import follow_settings
from rsoconsole.records import FrameTaken, Measurement, TrackState
from rsoconsole.session.reader import SessionReader
from rsoconsole.tracking.follow import Following, Seen, follow
from tests.test_cli_frames import rsoconsole

FRAMES = 14


def night(session: Any, *more: str, frames: int = FRAMES, timeout_s: float = 170.0) -> dict:
    """The summary of one simulated night."""
    run = rsoconsole(
        *("demo", "--headless", "--json", "--frames", str(frames), "--session", session),
        *more,
        timeout_s=timeout_s,
    )
    assert run.returncode == 0, run.stderr
    (summary,) = [json.loads(line) for line in run.stdout.splitlines()]
    return summary


@pytest.fixture(scope="module")
def first_night(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return night(tmp_path_factory.mktemp("night") / "one", "--seed", "1")


def test_it_finds_the_satellite_without_a_prior_and_follows_it(first_night):
    assert first_night["target"] == "INTELSAT 14"
    assert first_night["target_share"] == 1.0
    assert first_night["states"]["SEARCH"] >= 1
    assert first_night["states"]["TRACK"] >= 4
    assert first_night["measured_rms_arcsec"] <= 1.5
    assert first_night["prediction_rms_arcsec"] <= 6.0
    assert first_night["inside_3sigma"] >= 0.9
    assert first_night["false_measurements"] == 0


def test_the_same_seed_gives_the_same_night_at_another_speed(first_night, tmp_path):
    again = night(tmp_path / "two", "--seed", "1", "--speed", "400")
    for key in ("session", "latency_ms"):
        del again[key]
    assert again == {key: first_night[key] for key in again}


def test_the_track_is_a_fold_over_the_session_bit_for_bit(first_night):
    """A replay of the recorded measurements alone gives every state of the filter again."""
    reader = SessionReader(first_night["session"])
    config = reader.config()
    recorded = [record for _, _, record in reader.records()]
    following = Following()
    replayed: list[TrackState] = []
    for taken in (record for record in recorded if isinstance(record, FrameTaken)):
        seen = Seen(
            frame_id=taken.frame_id,
            t_mid_utc_ns=taken.t_start_utc_ns + round(taken.exposure_s * 5e8),
            exposure_s=taken.exposure_s,
            measurements=tuple(
                r for r in recorded if isinstance(r, Measurement) and r.frame_id == taken.frame_id
            ),
        )
        following, records = follow(following, seen, follow_settings(config, taken))
        replayed.extend(r for r in records if isinstance(r, TrackState))
    assert replayed == [r for r in recorded if isinstance(r, TrackState)]
    assert len(replayed) >= FRAMES // 2


def test_an_empty_sky_ends_in_search(tmp_path):
    summary = night(tmp_path / "empty", "--scenario", "empty", frames=8)
    assert summary["states"] == {"SEARCH": 8}
    assert (summary["locked_after_frames"], summary["target"]) == (None, None)


@pytest.mark.nights
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_whole_nights_hold_their_figures(seed, tmp_path):
    """40 frames: the promises of the estimator, kept."""
    summary = night(tmp_path / "night", "--seed", str(seed), frames=40, timeout_s=500.0)
    assert summary["target"] == "INTELSAT 14"
    assert summary["measured_rms_arcsec"] <= 1.5
    assert summary["prediction_rms_arcsec"] <= 6.0
    assert 1.0 <= summary["nis_mean"] <= 3.0
    assert summary["inside_3sigma"] >= 0.97


@pytest.mark.nights
@pytest.mark.timeout(600)
def test_the_papers_preset_tracks_too(tmp_path):
    summary = night(tmp_path / "night", "--preset", "paper", frames=40, timeout_s=500.0)
    assert summary["target"] == "INTELSAT 14"
    assert summary["states"]["TRACK"] >= 30
