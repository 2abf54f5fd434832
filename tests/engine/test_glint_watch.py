"""The engine says a glint in the frame in which it happened, once."""

from itertools import groupby
from typing import Any

import numpy as np

from rsoconsole.engine.tasks.glint_watch import GlintWatch
from rsoconsole.records import Event
from tests.nights.light_worlds import LightWorld, light_records, sinusoid, steady


def events_of(world: LightWorld) -> list[Event]:
    watch, found = GlintWatch(), []
    for _, of_frame in groupby(light_records(world), key=lambda each: each.frame_id):
        found += watch.glint_events(of_frame)
    return found


def flash(t_s: Any) -> Any:
    lit = 9.0 * np.exp(-0.5 * ((np.asarray(t_s) - 203.0) / 0.3) ** 2)
    return sinusoid(80.0, 0.2)(t_s) + lit


def test_a_glint_is_an_event_of_its_frame() -> None:
    (event,) = events_of(LightWorld(light=flash, frames=30))
    assert (event.frame_id, event.level) == (11, "info")
    assert event.text.startswith("track 1 glinted at 02:16:4")
    assert "2.5 mag for" in event.text or "2.6 mag for" in event.text or "2.4 mag" in event.text


def test_steady_and_turning_light_are_none() -> None:
    for seed, light in enumerate((steady, sinusoid(6.0, 0.8), sinusoid(200.0, 1.5))):
        assert events_of(LightWorld(light=light, frames=30, seed=seed)) == []
