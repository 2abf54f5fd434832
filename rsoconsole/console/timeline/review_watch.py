"""Who reads a session for review, on a thread of its own: all of it once, any moment at once."""

import logging
import time
from collections.abc import Callable
from pathlib import Path

from rsoconsole.console.timeline.moments import Moment, Moments
from rsoconsole.console.timeline.night_line import Timeline
from rsoconsole.control import Poller
from rsoconsole.errors import SessionError
from rsoconsole.night import LogLine
from rsoconsole.session.reading import SessionReader

log = logging.getLogger(__name__)

LOOK_S = 0.25
READ_AT_ONCE_S = 0.02
"""So long the log is read before it is looked whether another moment is wanted."""
BREATH_S = 0.2
"""So long the reading rests after a moment was shown: drawing it comes first."""
REPORT_S, REPORT_RECORDS = 0.3, 40_000
"""Seconds between reports while the log is read, of a log with this number of records."""
CLOSED_CHECK_S = 2.0

OnTimeline = Callable[[Path, Timeline, tuple[LogLine, ...]], None]
OnMoment = Callable[[Path, Moment], None]
OnFault = Callable[[Path, str], None]


class ReviewWatch(Poller):
    """Shows the moment that is wanted last; between such wishes it reads on.

    Its callbacks are called on its own thread and must return at once.
    """

    def __init__(self, on_timeline: OnTimeline, on_moment: OnMoment, on_fault: OnFault) -> None:
        super().__init__("review", LOOK_S)
        self._on_timeline, self._on_moment, self._on_fault = on_timeline, on_moment, on_fault
        self._folder: Path | None = None
        self._moments: Moments | None = None
        self._wanted: tuple[Path, int] | None = None
        self._shown: Moment | None = None
        self._reported_s = 0.0
        self._reported: tuple[int, int, bool] | None = None
        self._checked_s = 0.0

    def follow(self, folder: Path) -> None:
        """Read that session from now on (any thread)."""
        self._folder = folder
        self.look_now()

    def want(self, folder: Path, seq: int) -> None:
        """Show that moment (any thread); one that was wanted before and not shown is dropped."""
        self._wanted = (folder, seq)
        self.look_now()

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
        has_all = moments.read_on(READ_AT_ONCE_S)
        if has_all:
            self._see_whether_closed(moments)
        self._report(moments, is_due=has_all)
        self._show_again(moments)
        if not has_all:
            self.look_now()

    def _opened(self, folder: Path) -> Moments:
        reader = SessionReader(folder)
        try:
            config = reader.config()
        except SessionError as error:
            log.warning("%s", error)
            config = None
        self._shown, self._reported = None, None
        moments = Moments(reader, reader.about(), config)
        self._report(moments, is_due=True)
        return moments

    def _show_wanted(self, moments: Moments) -> bool:
        """Whether one was wanted."""
        wanted, self._wanted = self._wanted, None
        if wanted is None or wanted[0] != moments.reader.folder:
            return False
        self._show(moments, wanted[1])
        return True

    def _show_again(self, moments: Moments) -> None:
        """What was shown in part is shown whole as soon as it has been read."""
        shown = self._shown
        if shown is not None and not shown.is_whole and shown.seq <= moments.read_seq:
            self._show(moments, shown.seq)

    def _show(self, moments: Moments, seq: int) -> None:
        self._shown = moments.at(seq)
        if not self._is_closing:
            self._on_moment(moments.reader.folder, self._shown)

    def _report(self, moments: Moments, *, is_due: bool) -> None:
        """The time line, where it has changed; while the log is read, now and then."""
        now_s = time.monotonic()
        # Telling costs in proportion to the night, here and where it is drawn.
        wait_s = REPORT_S * max(moments.last_seq / REPORT_RECORDS, 1.0)
        if self._is_closing or not (is_due or now_s - self._reported_s > wait_s):
            return
        reported = (moments.read_seq, moments.last_seq, moments.is_closed)
        if reported != self._reported:
            self._reported, self._reported_s = reported, now_s
            self._on_timeline(moments.reader.folder, moments.timeline(), moments.log())

    def _see_whether_closed(self, moments: Moments) -> None:
        now_s = time.monotonic()
        if moments.is_closed or now_s - self._checked_s < CLOSED_CHECK_S:
            return
        self._checked_s = now_s
        if moments.reader.about().get("is_closed") is True:
            moments.close()
