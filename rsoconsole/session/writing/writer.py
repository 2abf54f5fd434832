"""Writes a live session: records, frames and previews.

Recording never waits for a disk, nor raises because of a disk: the telescope continues, and
``faults`` states which parts of the record are missing.
"""

import contextlib
import shutil
import sqlite3
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import SessionError, sync_folder, write_durably
from rsoconsole.config import Config, config_to_toml
from rsoconsole.records import ChartStar, Frame, Record
from rsoconsole.session.files.digest import mark_closed, sha256_of
from rsoconsole.session.files.frame_encoding import compress_frame, encode_preview
from rsoconsole.session.log.codec import to_json_value
from rsoconsole.session.log.database import connect_to_write, lay_out_session, merge_wal
from rsoconsole.session.log.liveness import META_KEY as WRITER_KEY
from rsoconsole.session.log.liveness import writer_identity
from rsoconsole.session.log.schema import DATABASE, SCHEMA_VERSION, frame_file_path
from rsoconsole.session.writing.log_writer import LogWriter, RescueSession, SessionFileRow
from rsoconsole.session.writing.worker import BoundedWorker, RecordingFaults

MAX_FRAMES_WAITING = 3
MAX_PREVIEWS_WAITING = 64
"""Largest number of waiting pictures, 0.3 MB each."""
LAST_KEPT = 12
"""Number of latest frames kept by ``session.keep_frames = last``: 0.2 GB at 16 Mpx."""
NOT_AMONG_LAST = f"of the last {LAST_KEPT} frames alone the pixels are kept (session.keep_frames)"
RESERVE_BYTES = 200_000_000
"""Free disk below which no more frames are saved, bytes: left for the log."""


class SessionWriter:
    """The only writer of a session. Its methods may be called from any thread."""

    @classmethod
    def create(
        cls,
        folder: Path,
        config: Config,
        about: Mapping[str, Any],
        *,
        on_fault: Callable[[str], None] | None = None,
        reserve_bytes: int = RESERVE_BYTES,
    ) -> "SessionWriter":
        """Begin a session in a new or empty folder.

        ``about`` goes into the table ``meta``: title, model_sha256, versions, clock_offset_s and
        other JSON values. ``on_fault`` is called, on another thread, with the text of each new
        fault. ``reserve_bytes``: free disk below which no more frames are saved. Raises
        SessionError when the folder cannot be used.
        """
        if (folder / DATABASE).exists():
            raise SessionError(f"{folder} already holds a session: name another folder")
        config_toml = config_to_toml(config).encode()
        facts = {
            "schema_version": SCHEMA_VERSION,
            "config": config.model_dump(mode="json"),
            "is_closed": False,
            WRITER_KEY: writer_identity(),
            **{key: to_json_value(value, key) for key, value in about.items()},
        }
        try:
            _make_folder(folder)
            lay_out_session(folder, config_toml, facts)
        except (OSError, ValueError, sqlite3.Error) as error:
            raise SessionError(
                f"no session can be begun in {folder}: {error}; "
                "free some disk or name another folder with --session"
            ) from error
        rescue = RescueSession(folder, facts, config_toml)
        keeps_last = LAST_KEPT if config.session.keep_frames == "last" else None
        return cls(folder, on_fault, reserve_bytes, rescue, keeps_last)

    def __init__(
        self,
        folder: Path,
        on_fault: Callable[[str], None] | None,
        reserve_bytes: int,
        rescue: RescueSession,
        keeps_last: int | None = None,
    ) -> None:
        self.folder = folder
        self._keeps_last = keeps_last
        self._kept_frames: deque[int] = deque()
        """Numbers of the frames with pixels, where only the last ones are kept."""
        self._going: list[Path] = []
        self._reserve_bytes = reserve_bytes
        self._faults = RecordingFaults(on_fault)
        self._is_closed = False
        self._log = LogWriter(folder / DATABASE, self._faults, rescue)
        self._frames = BoundedWorker("session-frames", MAX_FRAMES_WAITING)
        self._previews = BoundedWorker("session-previews", MAX_PREVIEWS_WAITING)

    @property
    def faults(self) -> tuple[str, ...]:
        """Texts of the present faults of the record; () where it is complete."""
        return self._faults.texts()

    def append(self, record: Record, t_utc_ns: int) -> int:
        """Record ``record`` at ``t_utc_ns``; return its ``seq`` in the log, without waiting.

        Mappings inside the record must not be changed afterwards.
        """
        return self._log.add_record(record, t_utc_ns)

    def save_frame(self, frame: Frame) -> bool:
        """Save a frame's pixels, compressed without loss, on another thread.

        The pixels must not be changed afterwards. Returns False when too many frames wait, so that
        this one is not saved; the session records that, too.
        """
        return self._save(self._frames, frame.frame_id, "frame", lambda: compress_frame(frame))

    def save_preview(
        self,
        frame_id: int,
        picture: npt.NDArray[np.uint8],
        stars: Sequence[ChartStar] | None = None,
    ) -> bool:
        """Save a small picture of the frame as PNG, (height, width) or (height, width, 3).

        ``stars``: the frame's brightest stars, kept in the picture's file; None: not known. Returns
        False when it is not saved because too many wait.
        """
        return self._save(
            self._previews, frame_id, "preview", lambda: encode_preview(picture, stars)
        )

    def save_closeup(self, frame_id: int, picture: npt.NDArray[np.uint8]) -> bool:
        """Save a part of the frame at full resolution as PNG; the record ``Closeup`` locates it.

        Returns False when the picture is not saved because too many wait.
        """
        return self._save(self._previews, frame_id, "closeup", lambda: encode_preview(picture))

    def flush(self, timeout_s: float = 5.0) -> bool:
        """Wait until all records appended so far are on the disk; return False if not in time.

        Acknowledged records survive a loss of power: every commit waits for the disk.
        """
        return self._log.flush(timeout_s)

    def close(self, timeout_s: float = 30.0) -> None:
        """Finish frames and log, and leave the database as one file that any reader can open."""
        if self._is_closed:
            return
        self._is_closed = True
        if not (self._frames.close(timeout_s) and self._previews.close(timeout_s)):
            self._faults.report("close", f"frames were still unwritten after {timeout_s:g} s")
        if not self._log.close(timeout_s):
            return
        with contextlib.suppress(OSError):
            for path in self._going:
                path.unlink(missing_ok=True)
        try:
            with closing(connect_to_write(self._log.path)) as connection:
                mark_closed(connection)
            merge_wal(self._log.path, min(timeout_s, 3.0))
        except sqlite3.Error as error:
            self._faults.report("close", f"the session is complete but still in two files: {error}")

    def _save(
        self, worker: BoundedWorker, frame_id: int, role: str, encode: Callable[[], bytes]
    ) -> bool:
        is_taken = worker.submit(
            lambda: self._keep(frame_id, role, encode),
            lambda error: self._give_up(frame_id, role, _reason(error)),
        )
        if not is_taken:
            self._give_up(frame_id, role, f"{role}s come faster than the disk takes them")
        return is_taken

    def _keep(self, frame_id: int, role: str, encode: Callable[[], bytes]) -> None:
        """Encode and write one file, on a worker's thread. Raises OSError."""
        path = self.folder / frame_file_path(role, frame_id)
        if role == "frame":
            free_bytes = shutil.disk_usage(self.folder).free
            if free_bytes < self._reserve_bytes:
                raise OSError(f"only {free_bytes / 1e6:.0f} MB of disk are free")
        began = time.perf_counter()
        content = encode()
        write_durably(path, content)
        self._faults.clear(role)
        self._log.add_file_row(
            SessionFileRow(
                frame_id=frame_id,
                role=role,
                path=str(path.relative_to(self.folder)),
                bytes=len(content),
                ms=(time.perf_counter() - began) * 1e3,
                sha256=sha256_of(content),
            )
        )
        if role == "frame" and self._keeps_last is not None:
            self._let_go(frame_id, self._keeps_last)

    def _let_go(self, frame_id: int, keeps: int) -> None:
        """Drop the oldest frame beyond the number to keep.

        Its row is changed now, its file removed at the next call.
        """
        for path in self._going:
            path.unlink(missing_ok=True)
        self._going.clear()
        self._kept_frames.append(frame_id)
        while len(self._kept_frames) > keeps:
            oldest = self._kept_frames.popleft()
            self._put_absent(oldest, "frame", NOT_AMONG_LAST)
            self._going.append(self.folder / frame_file_path("frame", oldest))

    def _give_up(self, frame_id: int, role: str, reason: str) -> None:
        if role != "frame" or self._keeps_last is None:  # of those none is missed
            self._faults.report(role, f"the {role} of exposure {frame_id} is not kept: {reason}")
        self._put_absent(frame_id, role, reason)

    def _put_absent(self, frame_id: int, role: str, reason: str) -> None:
        self._log.add_file_row(SessionFileRow(frame_id=frame_id, role=role, reason=reason))


def _reason(error: BaseException) -> str:
    """Reason in words; a failed disk speaks for itself, other errors by their kind too."""
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def _make_folder(folder: Path) -> None:
    """Make a folder with those above it, so that the disk has their names."""
    if folder.exists():
        folder.mkdir(exist_ok=True)  # says so where it is a file
        return
    _make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    sync_folder(folder.parent)


class BatchRecording:
    """Recording of the command ``process`` into a new session; without a folder, no recording."""

    def __init__(
        self, folder: Path | None, config: Config, model_sha256: str, **about: Any
    ) -> None:
        """``folder`` None: nothing is written.

        ``about``: further facts for the session's table ``meta``, or another title.
        """
        self._writer: SessionWriter | None = None
        self._last_utc_ns = 0
        if folder is not None:
            facts = {"title": "recorded frames", "model_sha256": model_sha256, **about}
            self._writer = SessionWriter.create(folder, config, facts)

    @property
    def faults(self) -> tuple[str, ...]:
        """Texts of the faults of the record; () where it is complete."""
        return () if self._writer is None else self._writer.faults

    def append(self, records: Iterable[Record], t_utc_ns: int | None) -> None:
        """Append all records of one frame, in order.

        ``t_utc_ns`` None: the time of the frame before.
        """
        self._last_utc_ns = t_utc_ns if t_utc_ns is not None else self._last_utc_ns
        if self._writer is not None:
            for record in records:
                self._writer.append(record, self._last_utc_ns)

    def close(self) -> None:
        """Finish the session."""
        if self._writer is not None:
            self._writer.close()
