"""A satellite that flashes about as often as the shutter opens: what its orbit claims to know."""

import dataclasses
import math

import numpy as np
import pytest

from rsoconsole.orbits import orbit_from_record, predict
from rsoconsole.pipeline.orbits.track_measurements import PartialStreakErrors
from rsoconsole.records import FrameTaken, Measurement, TrackState
from rsoconsole.sky import SkyPlaces
from rsoconsole.tracking import expected_motion
from tests.pipeline.test_orbit_online import GEO, Watched, config, every_frame, flight
from tests.tracking.test_streak_length import flashing
from tests.truth.orbit_truth import DAYTONA

PERIOD_S, LIT_SHARE = 9.9, 0.6
FRAMES, AHEAD_S = 9, 600.0


@dataclasses.dataclass
class Flashing(Watched):
    """Sees what lies between the first and the last light of each exposure."""

    phase_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.lost = list(flashing(PERIOD_S, LIT_SHARE, self.phase_s, 60))

    def measure(self, places: SkyPlaces, n: int) -> Measurement:
        whole = super().measure(places, n)
        self.receive(
            FrameTaken(
                frame_id=self.frame_id,
                name="",
                t_start_utc_ns=whole.t_mid_utc_ns - 5 * 10**9,
                exposure_s=10.0,
                width_px=4656,
                height_px=3520,
                pointing_ra_icrs_deg=None,
                pointing_dec_icrs_deg=None,
            )
        )
        west, east = (
            each / 3600.0 / math.cos(math.radians(whole.dec_icrs_deg)) for each in self.lost[n]
        )
        assert whole.ends_icrs_deg is not None
        first, last = whole.ends_icrs_deg
        return dataclasses.replace(
            whole,
            ra_icrs_deg=whole.ra_icrs_deg + (west - east) / 2.0,
            ends_icrs_deg=((first[0] + west, first[1]), (last[0] - east, last[1])),
        )


def shortfalls() -> list[float]:
    """East error of the place ten minutes later over its stated sigma, of nights by phase."""
    true, found = flight(*GEO), []
    for phase_s in np.arange(0.0, PERIOD_S, 1.25):
        watched = Flashing(config(), phase_s=float(phase_s))
        watched.see(every_frame(true, FRAMES))
        later = true.places(np.array([FRAMES * 30.0 + AHEAD_S]))[0]
        ahead = predict(orbit_from_record(watched.last), DAYTONA, later.t_utc_ns)
        off = 3600.0 * float(ahead.places.ra_icrs_deg[0] - later.ra_icrs_deg[0])
        found.append(off / math.sqrt(float(ahead.cov_sky_arcsec2[0][0])))
    return found


def test_its_orbit_states_what_the_parts_leave_open():
    shared = np.abs(shortfalls())
    assert np.mean(shared < 3.0) >= 0.95
    assert np.sqrt(np.mean(shared**2)) < 2.0


@pytest.mark.slow("fits an orbit with each frame")
def test_as_errors_of_their_own_the_orbit_would_be_sure_and_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        PartialStreakErrors, "with_widened_covariances", lambda _self, fresh, *_: tuple(fresh)
    )
    assert np.sqrt(np.mean(np.square(shortfalls()))) > 5.0


@pytest.mark.nightly("one more night")
def test_streaks_of_another_rate_an_hour_ago_are_no_parts():
    """Of an eccentric orbit: each is as long as it moved then, whatever the track's rate now."""
    eccentric = flight(26_560.0, 0.5, 63.0)
    watched = Flashing(config())
    watched.lost = [(0.0, 0.0)] * 200
    watched.see(eccentric.places(np.arange(0.0, 5400.0, 60.0))[0])
    states = [each for each in watched.log if isinstance(each, TrackState)]
    fastest = max(states, key=lambda each: expected_motion(each, 1.0).length_arcsec)
    slowest = min(states, key=lambda each: expected_motion(each, 1.0).length_arcsec)
    fast, slow = (expected_motion(each, 1.0).length_arcsec for each in (fastest, slowest))
    assert fast > 1.5 * slow
    taken = [each for each in watched.log if isinstance(each, Measurement)]
    frames = [each for each in watched.log if isinstance(each, FrameTaken)]
    exposures = {each.frame_id: each.exposure_s for each in frames}
    assert PartialStreakErrors().with_widened_covariances(
        taken, taken, fastest, exposures
    ) == tuple(taken)
