"""Nothing that a world can name changes a night whose file does not name it."""

import json

import numpy as np
import pytest

from rsoconsole.simulator import Scene, World
from tests.drawn.nameless_frames import FILE, frame_facts, mount_facts

STORED = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "stored", STORED["frames"], ids=lambda frame: "-".join(map(str, frame["case"]))
)
def test_frames_are_those_of_before_worlds_could_be_named(stored):
    """Bit for bit where exp and erf are those of then; elsewhere all but a few pixels."""

    def in_an_empty_world(*args, **kwargs):
        return Scene(*args, **kwargs, world=World())

    found = frame_facts(*stored["case"], in_an_empty_world)
    if found["sha256"] != stored["sha256"]:
        then, now = (
            np.frombuffer(bytes.fromhex(each["pixels"]), dtype=">u2") for each in (stored, found)
        )
        a_pixel_in_five_hundred = 0.002
        assert np.mean(then != now) < a_pixel_in_five_hundred
    assert found["truth"] == pytest.approx(stored["truth"], rel=1e-9)
    for now, then in zip(found["satellites"], stored["satellites"], strict=True):
        assert now == pytest.approx(then, rel=1e-9)


def test_the_mount_looks_where_it_did():
    assert mount_facts() == pytest.approx(STORED["mount"], abs=1e-12)
