"""Puts the loop's records into the session, in order and each with the clock's time."""

import contextlib
import logging
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal

from rsoconsole.base import RsoconsoleError
from rsoconsole.engine.tasks.preview import cut_closeup, preview_of
from rsoconsole.pipeline import Past, keep_unknown_tracks
from rsoconsole.records import ChartStar, Closeup, Event, Frame, Record, Topic
from rsoconsole.session import SessionWriter, damage_words, ledger_path, read_ledger

log = logging.getLogger(__name__)

_LOG_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "alarm": logging.ERROR}


class SessionLog:
    """Writes records, frames and log lines from any thread; a disk fault raises nothing."""

    def __init__(
        self,
        record: SessionWriter,
        now_utc_ns: Callable[[], int],
        on_record: Callable[[Record], None] | None = None,
    ) -> None:
        """``on_record`` is called with every record, on the thread that appends it."""
        self._record = record
        self._on_record = on_record
        self._now_utc_ns = now_utc_ns
        self._seen_utc_ns = 0
        self.frame_id = 0

    def append(self, record: Record) -> None:
        """Append one record."""
        self._record.append(record, self.last_utc_ns())
        if self._on_record is not None:
            self._on_record(record)

    def say(self, level: Literal["info", "warning", "alarm"], text: str, topic: Topic = "") -> None:
        """Record a line for the operator, and write it to the program's log."""
        self.append(Event(level=level, text=text, frame_id=self.frame_id, topic=topic))
        log.log(_LOG_LEVELS[level], "%s", text)

    def append_all(self, records: Iterable[Record]) -> None:
        """Append records in order; lines for the operator also go into the program's log."""
        for record in records:
            self.append(record)
            if isinstance(record, Event):
                log.log(_LOG_LEVELS[record.level], "%s", record.text)

    def keep(
        self,
        frame: Frame,
        *,
        is_wanted: bool,
        place_px: tuple[float, float] | None = None,
        stars: tuple[ChartStar, ...] | None = None,
    ) -> None:
        """Keep the frame's small pictures, and its pixels where ``is_wanted``.

        ``place_px``: x and y around which a close-up is kept at full resolution; None: no close-up.
        ``stars``: its brightest stars; None: not known.
        """
        if is_wanted:
            self._record.save_frame(frame)
        self._record.save_preview(frame.frame_id, preview_of(frame.pixels), stars)
        if place_px is not None:
            (x0_px, y0_px), picture = cut_closeup(frame.pixels, *place_px)
            height_px, width_px = picture.shape
            self.append(
                Closeup(
                    frame_id=frame.frame_id,
                    x0_px=x0_px,
                    y0_px=y0_px,
                    width_px=width_px,
                    height_px=height_px,
                )
            )
            self._record.save_closeup(frame.frame_id, picture)

    def last_utc_ns(self) -> int:
        """Return the clock's time, UTC ns; where the clock no longer answers, its last time."""
        with contextlib.suppress(RsoconsoleError):
            self._seen_utc_ns = self._now_utc_ns()
        return self._seen_utc_ns


class WarningsOnRecord(logging.Handler):
    """While entered, puts every warning of a logger and of its child loggers on record.

    Events outside the loop (a process that died and was replaced) reach the record only so.
    """

    def __init__(self, session_log: SessionLog, logger: str) -> None:
        super().__init__(logging.WARNING)
        self._session_log, self._logger = session_log, logging.getLogger(logger)

    def __enter__(self) -> None:
        self._logger.addHandler(self)

    def __exit__(self, *_exception: object) -> None:
        self._logger.removeHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Put a warning into the session only, because the program's log has it already."""
        self._session_log.append(
            Event(
                level="alarm" if record.levelno >= logging.ERROR else "warning",
                text=record.getMessage(),
                frame_id=self._session_log.frame_id,
            )
        )


def read_earlier_tracks(*, is_simulated: bool) -> tuple[Past | None, str | None]:
    """Return uncorrelated tracks of earlier nights, and why they could not be read, in words.

    Each is None where there is none.
    """
    if is_simulated:
        return None, None
    try:
        ledger = read_ledger()
    except RsoconsoleError as error:
        return None, f"no track is named by the ledger: {error}"
    return Past(ledger), damage_words(ledger.unreadable, ledger_path()) or None


def keep_uncorrelated(folder: Path) -> None:
    """Put the night's uncorrelated tracks into the ledger, once the session is closed.

    Never raises: the night is over, and `identify --keep` can do it later.
    """
    try:
        kept = keep_unknown_tracks(folder)
    except RsoconsoleError as error:
        log.error(
            "no track was kept in the ledger: %s; do it by 'identify %s --keep'", error, folder
        )
        return
    except Exception:
        log.exception("no track was kept in the ledger: 'identify %s --keep' does it", folder)
        return
    if kept.moved_aside is not None:
        log.warning("the ledger was damaged: it is in %s as it was", kept.moved_aside)
    for each in kept.tracks:
        words = "a new one" if each.is_new else "known from before"
        log.info("track %s is kept in the ledger as UCT %s, %s", each.track, each.number, words)
