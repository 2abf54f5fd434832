"""Frames of a night as its records tell them: rows of the plots, and the last ones in detail."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

from rsoconsole.night.chunks import Chunks, in_chunks
from rsoconsole.night.frame_rows import FrameDetail, FrameRow
from rsoconsole.records import FrameTaken

NOTHING_SEEN = FrameDetail()
FRAMES_IN_DETAIL = 8
"""How many of the last frames keep what a picture of them needs; pictures come late."""
_OfFrame = TypeVar("_OfFrame", FrameRow, FrameDetail)


class FramesSeen:
    """Frozen rows and details, changed in their place until somebody else has seen them.

    A frame has a dozen changes, a night 50,000 frames.
    """

    def __init__(self) -> None:
        self.rows: dict[int, FrameRow] = {}
        self.details: dict[int, FrameDetail] = {}
        self._own: dict[int, FrameRow | FrameDetail] = {}
        """By identity: those that nobody else has seen yet, and that may change."""
        self._kept_rows: Chunks[FrameRow] = ()

    def begin(self, row: FrameRow, taken: FrameTaken) -> None:
        """One more frame; what came before is hardly changed any more."""
        self.are_seen()
        self.rows[row.frame_id] = row
        self.details[row.frame_id] = FrameDetail(taken=taken)
        while len(self.details) > FRAMES_IN_DETAIL:
            del self.details[next(iter(self.details))]

    def are_seen(self) -> None:
        """Others hold them from now on."""
        self._own.clear()

    def detail(self, frame_id: int) -> FrameDetail:
        """What that frame showed, for the fold alone; empty for one long past."""
        return self.details.get(frame_id, NOTHING_SEEN)

    def keep(self) -> tuple[Chunks[FrameRow], tuple[tuple[int, FrameDetail], ...]]:
        """Rows and details as they are, to come back to."""
        self.are_seen()
        self._kept_rows = in_chunks([*self.rows.values()], self._kept_rows)
        return self._kept_rows, tuple(self.details.items())

    def go_back(self, rows: Chunks[FrameRow], details: Iterable[tuple[int, FrameDetail]]) -> None:
        """As they were."""
        self.are_seen()
        self.rows = {row.frame_id: row for chunk in rows for row in chunk}
        self.details = dict(details)

    def change(self, frame_id: int, **changes: Any) -> None:
        """Of a frame's row."""
        row = self.rows.get(frame_id)
        self.rows[frame_id] = self._changed(row or FrameRow(frame_id=frame_id), changes)

    def change_detail(self, frame_id: int, **changes: Any) -> None:
        """Of what a frame showed, unless it is long past."""
        if frame_id in self.details:
            self.details[frame_id] = self._changed(self.details[frame_id], changes)

    def _changed(self, of_frame: _OfFrame, changes: dict[str, Any]) -> _OfFrame:
        if id(of_frame) in self._own:
            for name, value in changes.items():
                object.__setattr__(of_frame, name, value)
            return of_frame
        made = replace(of_frame, **changes)
        self._own[id(made)] = made
        return made
