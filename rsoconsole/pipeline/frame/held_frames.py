"""Frames in which somebody is marking by hand: they can be ruled on for longer than the others."""

import logging
from collections.abc import Mapping
from pathlib import Path

from rsoconsole.base import RsoconsoleError
from rsoconsole.instruments import read_frame
from rsoconsole.records import PixelArray
from rsoconsole.session import SessionReader

BEGIN_MARK = "begin_mark"
"""The verb by which one is held."""
HELD = 600
"""Frames that may be taken meanwhile: a fast demo's five minutes, a real night's hours. Each that
is kept weighs some 80 kB, and takes some 7 ms when they are followed again."""


class HeldFrames:
    """Which frames are held, each for how many more frames. Other threads may look in."""

    def __init__(self, after_word: int) -> None:
        """``after_word``: for how many frames one is held once a word has been said on it."""
        self._after_word = after_word
        self._left: Mapping[int, int] = {}
        # Replaced as a whole, never changed.

    def __contains__(self, frame_id: int) -> bool:
        return frame_id in self._left

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Oldest first."""
        return tuple(sorted(self._left))

    def hold(self, frame_id: int) -> None:
        """From now on, for ``HELD`` frames."""
        self._left = {**self._left, frame_id: HELD}

    def let_go(self, frame_id: int) -> None:
        """No longer."""
        self._left = {n: left for n, left in self._left.items() if n != frame_id}

    def ruled(self, frame_id: int) -> None:
        """A word has been said on it: it stays for as long as that may be taken back."""
        if frame_id in self._left:
            self._left = {**self._left, frame_id: self._after_word}

    def count(self) -> None:
        """One frame more."""
        self._left = {n: left - 1 for n, left in self._left.items() if left > 1}

    def forget(self) -> None:
        """None is held."""
        self._left = {}


log = logging.getLogger(__name__)


def kept_pixels(folder: Path, frame_id: int) -> PixelArray | None:
    """(height, width) ADU; None where they were not kept, are not written yet, or are damaged."""
    try:
        path = SessionReader(folder).frame_path(frame_id)
        return None if path is None else read_frame(path, frame_id).pixels
    except RsoconsoleError as error:
        log.warning("the pixels of frame %d cannot be read: %s", frame_id, error)
        return None
