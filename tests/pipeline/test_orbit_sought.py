"""How often every start is tried for an orbit that none leads to."""

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from rsoconsole.orbits.determination import from_directions as determining
from rsoconsole.pipeline import OnlineOrbit
from rsoconsole.records import Measurement, TrackState
from rsoconsole.sky import SkyPlaces
from rsoconsole.tracking.filters import lqe
from tests.pipeline.test_orbit_online import GEO, config, every_frame, flight, measured_at

FRAMES = 24
OFF_DEG = 0.2


@pytest.fixture
def attempts(monkeypatch) -> list[int]:
    """With how many directions every start was tried."""
    found: list[int] = []
    whole = determining._from_nothing

    def counted(seen, asked):
        found.append(len(seen))
        return whole(seen, asked)

    monkeypatch.setattr(determining, "_from_nothing", counted)
    return found


def astray(frames: int) -> SkyPlaces:
    """A way that jumps by a fifth of a degree from frame to frame, as no orbit does."""
    places = every_frame(flight(*GEO), frames)
    random = np.random.default_rng(3)
    return dataclasses.replace(
        places,
        ra_icrs_deg=places.ra_icrs_deg + random.uniform(-OFF_DEG, OFF_DEG, frames),
        dec_icrs_deg=places.dec_icrs_deg + random.uniform(-OFF_DEG, OFF_DEG, frames),
    )


def taken_of(places: SkyPlaces) -> list[tuple[Measurement, TrackState]]:
    """What is on record of each frame from the second on, of a track that takes everything."""
    random, settings = np.random.default_rng(4), config().filter
    measured = [measured_at(places, n, n + 1, random, 0.5) for n in range(len(places.t_utc_ns))]
    begun = lqe.initialise(measured[0], measured[1], settings)
    told = [(measured[1], begun)]
    for m in measured[2:]:
        state = dataclasses.replace(
            begun,
            kind="updated",
            frame_id=m.frame_id,
            t_utc_ns=m.t_mid_utc_ns,
            measurement_id=m.measurement_id,
            begun_with=None,
        )
        told.append((m, state))
    return [(measured[0], None), *told]


def refined_of(places: SkyPlaces) -> tuple[OnlineOrbit, list[int]]:
    """And of how many directions each estimate on record is."""
    online, on_record = OnlineOrbit(config()), []
    for measured, state in taken_of(places):
        online.receive(measured)
        if state is not None:
            online.receive(state)
        on_record += [each.estimate.observations for each in online.refine()]
    return online, on_record


@pytest.mark.slow("seeks an orbit with each frame")
def test_what_follows_no_orbit_is_tried_from_every_start_only_as_its_arc_grows(attempts):
    refined_of(astray(FRAMES))
    assert attempts[0] == 3
    assert attempts[-1] >= FRAMES / 1.2 - 1, "it is never given up"
    for before, after in pairwise(attempts):
        assert after >= 1.2 * before or after == before + 1
    # Every frame would be 22.
    assert len(attempts) <= 16


def test_a_satellite_is_tried_from_every_start_once(attempts):
    online, on_record = refined_of(every_frame(flight(*GEO), 40))
    assert attempts == [3]
    assert on_record == list(range(3, 41))
    assert online.lead_orbit is not None
    assert not online.lead_orbit.is_astray
