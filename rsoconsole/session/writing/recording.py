"""A session made from recorded frames, where one was asked for."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.records import Record
from rsoconsole.session.writing.writer import SessionWriter


class BatchRecording:
    """Writes what ``process`` found into a new session; does nothing without a folder."""

    def __init__(
        self, folder: Path | None, config: Config, model_sha256: str, **about: Any
    ) -> None:
        """``about``: what else the session is to say of itself, or another title."""
        self._writer: SessionWriter | None = None
        self._last_utc_ns = 0
        if folder is not None:
            facts = {"title": "recorded frames", "model_sha256": model_sha256, **about}
            self._writer = SessionWriter.create(folder, config, facts)

    @property
    def faults(self) -> tuple[str, ...]:
        """What the record lacks, in words; empty when all is well."""
        return () if self._writer is None else self._writer.faults

    def append(self, records: Iterable[Record], t_utc_ns: int | None) -> None:
        """All records of one frame, in order; a frame without a time keeps the last one's."""
        self._last_utc_ns = t_utc_ns if t_utc_ns is not None else self._last_utc_ns
        if self._writer is not None:
            for record in records:
                self._writer.append(record, self._last_utc_ns)

    def close(self) -> None:
        """Finish the session."""
        if self._writer is not None:
            self._writer.close()
