"""The ring of frames: whose slot is whose, and that nothing is copied that need not be."""

import numpy as np
import pytest

from rsoconsole.base import FrameError
from rsoconsole.instruments.camera.frame_ring import SLOTS, FrameRing

SHAPE = (64, 80)


@pytest.fixture
def ring():
    made = FrameRing.create(64 * 80 * 2)
    yield made
    made.close()


def frame(ring: FrameRing, value: int) -> np.ndarray:
    """A frame of this value, through the slot that is free."""
    slot = ring.free_slot()
    ring.writable_slot(slot, SHAPE, np.uint16)[...] = value
    return ring.lend_slot(slot, np.uint16, SHAPE)


def test_one_frame_after_another_takes_one_slot(ring):
    for value in range(5):
        assert ring.free_slot() == 0
        taken = frame(ring, value)
        assert np.all(taken == value)
        del taken


def test_a_frame_is_no_copy_and_cannot_be_changed(ring):
    taken = frame(ring, 7)
    ring.writable_slot(0, SHAPE, np.uint16)[0, 0] = 8
    assert taken[0, 0] == 8
    with pytest.raises(ValueError, match="read-only"):
        taken[0, 0] = 9


def test_a_slot_is_not_free_while_anybody_holds_a_piece_of_its_frame(ring):
    piece = frame(ring, 1)[10:20].T[::2]
    assert ring.free_slot() == 1
    assert np.all(piece == 1)
    del piece
    assert ring.free_slot() == 0


def test_frames_that_are_all_held_stay_as_they_are(ring):
    held = [frame(ring, value) for value in range(2 * SLOTS)]
    assert [int(each[0, 0]) for each in held] == list(range(2 * SLOTS))
    assert all(np.all(each == each[0, 0]) for each in held)


def test_a_frame_outlives_the_ring():
    ring = FrameRing.create(64 * 80 * 2)
    taken = frame(ring, 3)
    ring.close()
    assert np.all(taken == 3)


def test_a_frame_larger_than_a_slot_is_refused_with_the_remedy(ring):
    with pytest.raises(FrameError, match=r"optics\.width_px"):
        ring.writable_slot(0, (640, 800), np.uint16)
