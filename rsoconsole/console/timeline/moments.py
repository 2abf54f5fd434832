"""A session at any place of its log, rebuilt from the last checkpoint before it.

Checkpoints are kept while the log is read. A place that has not been read yet is rebuilt from some
frames before it alone, and marked as partial.
"""

import logging
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Any

from textual.cache import LRUCache

from rsoconsole.base import SessionError
from rsoconsole.config import Config
from rsoconsole.console.picture.marks import frame_marks
from rsoconsole.console.picture.picture import Picture, read_picture
from rsoconsole.console.timeline.timeline import READ_IN_FULL, FrameStart, Timeline, TimelineBuilder
from rsoconsole.control import Poller
from rsoconsole.night import LogLine, Night, NightCheckpoint, NightFrame, NightView
from rsoconsole.records import FrameTaken, ParameterChange, Record, StateChange
from rsoconsole.session import SessionReader

KEPT_EVERY_FRAMES = 50
KEPT_EVERY_RECORDS = 1000
"""Records between two checkpoints where a log has few frames."""
FRAMES_BEFORE = 60
"""Frames that are folded before a moment whose place has not been read yet."""
PICTURES, MOMENTS = 12, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A session as the console would have shown it at one place of its log, ``seq``."""

    seq: int
    view: NightView
    detail: NightFrame
    """The record of the moment's newest frame."""
    picture: Picture | None
    is_whole: bool = True
    """False where the fold began a few frames before, since the log had not been read so far."""


class MomentReader:
    """Reader of a session that returns its state at any place of the log; for one thread only.

    Its methods raise SessionError.
    """

    def __init__(self, reader: SessionReader, about: dict[str, Any], config: Config | None) -> None:
        self.reader = reader
        self._about, self._config = about, config
        self._head = self._night()
        """Fold of all records that have been read."""
        self._shown = self._night()
        """Fold of the records up to the moment shown last."""
        self._kept_seqs: list[int] = [0]
        self._kept: list[NightCheckpoint] = [self._head.checkpoint()]
        self._frames_since = 0
        self._reading: Iterator[tuple[int, int, Record]] | None = None
        self._timeline = TimelineBuilder()
        self._outlined_seq = 0
        self._last_frame: FrameStart | None = None
        self._pictures: LRUCache[int, Picture] = LRUCache(PICTURES)
        self._moments: LRUCache[int, Moment] = LRUCache(MOMENTS)
        self._outline()

    @property
    def read_seq(self) -> int:
        """Place up to which the log has been read."""
        return self._head.seq

    def timeline(self) -> Timeline:
        """Return the time line as far as it is known, with the frames whose pixels are kept."""
        return replace(self._course(), with_pixels=self.reader.frames_with_pixels())

    def _course(self) -> Timeline:
        """Return the time line without the frames with pixels, which take a look into a folder."""
        return self._timeline.build_timeline(self.read_seq, is_closed=self._head.is_closed)

    @property
    def is_read(self) -> bool:
        """True where the log has been read up to its last known place."""
        return self.read_seq >= self.last_seq

    @property
    def last_seq(self) -> int:
        """The last known place of the log."""
        return self._timeline.last_seq

    def log(self) -> tuple[LogLine, ...]:
        """Return the log's lines of all records that have been read, oldest first."""
        return self._head.log

    @property
    def is_closed(self) -> bool:
        """True where the session is closed, so that no record follows."""
        return self._head.is_closed

    def close(self) -> None:
        """Mark the session as closed; nothing is written or released."""
        self._head.close()

    def read_for(self, for_s: float) -> bool:
        """Read on in the log for ``for_s`` seconds; return True if its end was reached."""
        until_s = monotonic() + for_s
        # What has been fetched of the log and not taken yet is there for the next call.
        reading = self._reading or self.reader.records(since_seq=self.read_seq)
        self._reading = None
        for seq, t_utc_ns, record in reading:
            self._take(seq, t_utc_ns, record)
            if monotonic() > until_s:
                self._reading = reading
                return False
        self._end_frame(is_over=False)
        return True

    def at(self, seq: int) -> Moment:
        """Return the session as of a place of its log."""
        known = self._moments.get(seq)
        if known is not None:
            return known
        is_whole = seq <= self.read_seq
        night = self._fold_to(seq) if is_whole else self._fold_near(seq)
        view = night.view()
        detail = night.frame(view.frame.frame_id) if view.frame is not None else NightFrame()
        moment = Moment(
            seq=seq,
            view=view,
            detail=detail,
            picture=self._picture(view, detail),
            is_whole=is_whole,
        )
        if seq < self.read_seq:  # of the last frame, more may come
            self._moments[seq] = moment
        return moment

    # -- the log, once --------------------------------------------------------------------------

    def _night(self) -> Night:
        night = Night(self.reader.folder, self._about, self._config)
        night.mark_past_read()
        return night

    def _outline(self) -> None:
        """Make an outline of the time line at once, before any record is folded."""
        read = {seq: record for seq, _, record in self.reader.records(kinds=(*READ_IN_FULL,))}
        for seq, t_utc_ns, kind, frame_id in self.reader.record_headers():
            self._timeline.receive(seq, t_utc_ns, kind, frame_id, read.get(seq))
        self._outlined_seq = self._timeline.last_seq

    def _take(self, seq: int, t_utc_ns: int, record: Record) -> None:
        is_frame = isinstance(record, FrameTaken)
        if is_frame:
            self._end_frame(is_over=True)
            self._frames_since += 1
        if (is_frame and self._frames_since >= KEPT_EVERY_FRAMES) or (
            seq - self._kept_seqs[-1] >= KEPT_EVERY_RECORDS
        ):
            self._kept_seqs.append(self._head.seq)
            self._kept.append(self._head.checkpoint())
            self._frames_since = 0
        self._head.fold_record(t_utc_ns, record, seq)
        if seq > self._outlined_seq:
            frame_id = getattr(record, "frame_id", None)
            self._timeline.receive(seq, t_utc_ns, type(record).__name__, frame_id, record)
        if isinstance(record, FrameTaken):
            self._last_frame = FrameStart(seq, t_utc_ns, record.frame_id)

    def _end_frame(self, *, is_over: bool) -> None:
        """Put the last frame's outcome on the time line, once it is known."""
        mark = self._last_frame
        row = self._head.row(mark.frame_id) if mark is not None else None
        if mark is None or row is None or not (is_over or self._head.is_closed):
            return
        self._timeline.receive_frame_outcome(row, mark)
        self._last_frame = None

    # -- one moment -----------------------------------------------------------------------------

    def _fold_to(self, seq: int) -> Night:
        """Fold the log to a place, from the nearest checkpoint or the moment shown last."""
        at = bisect_right(self._kept_seqs, seq) - 1
        if not self._kept_seqs[at] <= self._shown.seq <= seq:
            self._shown.restore(self._kept[at])
        self._fold_on(self._shown, seq)
        return self._shown

    def _fold_near(self, seq: int) -> Night:
        """Fold the log to a place from ``FRAMES_BEFORE`` frames before it."""
        timeline = self._course()
        index = timeline.frame_index(seq)
        first = 0 if index is None else timeline.frames[max(index - FRAMES_BEFORE, 0)].seq - 1
        night = self._night()
        for at, t_utc_ns, record in self.reader.records(kinds=(StateChange, ParameterChange)):
            if at > min(first, seq):
                break
            night.fold_record(t_utc_ns, record, at)
        night.forget_log()
        self._fold_on(night, seq, since_seq=first)
        return night

    def _fold_on(self, night: Night, seq: int, since_seq: int | None = None) -> None:
        start = night.seq if since_seq is None else since_seq
        if start >= seq:
            return
        for at, t_utc_ns, record in self.reader.records(since_seq=start):
            if at > seq:
                return
            night.fold_record(t_utc_ns, record, at)

    def _picture(self, view: NightView, detail: NightFrame) -> Picture | None:
        if view.frame is None:
            return None
        frame_id = view.frame.frame_id
        known = self._pictures.get(frame_id)
        if known is None or (known.closeup is None and detail.closeup is not None):
            known = read_picture(self.reader, frame_id, detail)
            if known is None:
                return None
        if known.detail != detail:
            known = replace(known, detail=detail, marks=frame_marks(detail), place=detail.closeup)
        self._pictures[frame_id] = known
        return known


log = logging.getLogger(__name__)

LOOK_S = 0.25
READ_AT_ONCE_S = 0.02
"""Seconds of reading between two looks whether another moment is requested."""
BREATH_S = 0.2
"""Seconds that reading pauses after a moment was shown, so that it is drawn first."""
REPORT_S, REPORT_RECORDS = 0.3, 40_000
"""Seconds between reports while a log is read; number of records beyond which reports are rarer."""
CLOSED_CHECK_S = 2.0

OnTimeline = Callable[[Path, Timeline, tuple[LogLine, ...]], None]
OnMoment = Callable[[Path, Moment], None]
OnFault = Callable[[Path, str], None]


class ReviewWatch(Poller):
    """Thread that reads a session's log, and shows the moment requested last as soon as it can.

    Its callbacks are called on its own thread and must return at once.
    """

    def __init__(self, on_timeline: OnTimeline, on_moment: OnMoment, on_fault: OnFault) -> None:
        super().__init__("review", LOOK_S)
        self._on_timeline, self._on_moment, self._on_fault = on_timeline, on_moment, on_fault
        self._folder: Path | None = None
        self._moments: MomentReader | None = None
        self._wanted: tuple[Path, int] | None = None
        self._shown: Moment | None = None
        self._reported_s = 0.0
        self._reported: tuple[int, int, bool] | None = None
        self._checked_s = 0.0

    def follow(self, folder: Path) -> None:
        """Read that session from now on; may be called from any thread."""
        self._folder = folder
        self.poll_now()

    def want(self, folder: Path, seq: int) -> None:
        """Request the moment at a place of a session's log; may be called from any thread.

        It replaces an earlier request that still waits.
        """
        self._wanted = (folder, seq)
        self.poll_now()

    def _look(self) -> None:
        folder = self._folder
        if folder is None:
            return
        try:
            self._work(folder)
        except SessionError as error:
            self._say_fault(folder, str(error))
        except Exception as error:  # the seat must go on, whatever lies in the folder
            log.exception("the session cannot be reviewed")
            self._say_fault(folder, f"the session cannot be reviewed: {error}")

    def _say_fault(self, folder: Path, text: str) -> None:
        self._reported = None  # what is told next ends the fault
        if not self._is_closing:
            self._on_fault(folder, text)

    def _work(self, folder: Path) -> None:
        moments = self._moments
        if moments is None or moments.reader.folder != folder:
            self._moments = self._opened(folder)
            return  # which moment is wanted first, the time line's reader says now
        if self._show_wanted(moments) and not moments.is_read:
            self._wake.wait(BREATH_S)
        has_all = moments.read_for(READ_AT_ONCE_S)
        if has_all:
            self._see_whether_closed(moments)
        self._report(moments, is_due=has_all)
        self._show_again(moments)
        if not has_all:
            self.poll_now()

    def _opened(self, folder: Path) -> MomentReader:
        reader = SessionReader(folder)
        try:
            config = reader.config()
        except SessionError as error:
            log.warning("%s", error)
            config = None
        self._shown, self._reported = None, None
        moments = MomentReader(reader, reader.read_meta(), config)
        self._report(moments, is_due=True)
        return moments

    def _show_wanted(self, moments: MomentReader) -> bool:
        """Show the requested moment; return True if there was one."""
        wanted, self._wanted = self._wanted, None
        if wanted is None or wanted[0] != moments.reader.folder:
            return False
        self._show(moments, wanted[1])
        return True

    def _show_again(self, moments: MomentReader) -> None:
        """Show a partial moment once more, as soon as the log has been read up to it."""
        shown = self._shown
        if shown is not None and not shown.is_whole and shown.seq <= moments.read_seq:
            self._show(moments, shown.seq)

    def _show(self, moments: MomentReader, seq: int) -> None:
        self._shown = moments.at(seq)
        if not self._is_closing:
            self._on_moment(moments.reader.folder, self._shown)

    def _report(self, moments: MomentReader, *, is_due: bool) -> None:
        """Report a changed time line; while the log is still being read, only now and then."""
        now_s = time.monotonic()
        # Telling costs in proportion to the night, here and where it is drawn.
        wait_s = REPORT_S * max(moments.last_seq / REPORT_RECORDS, 1.0)
        if self._is_closing or not (is_due or now_s - self._reported_s > wait_s):
            return
        reported = (moments.read_seq, moments.last_seq, moments.is_closed)
        if reported != self._reported:
            self._reported, self._reported_s = reported, now_s
            self._on_timeline(moments.reader.folder, moments.timeline(), moments.log())

    def _see_whether_closed(self, moments: MomentReader) -> None:
        now_s = time.monotonic()
        if moments.is_closed or now_s - self._checked_s < CLOSED_CHECK_S:
            return
        self._checked_s = now_s
        if moments.reader.read_meta().get("is_closed") is True:
            moments.close()
