"""A session as it grows, read bit by bit for the live panel."""

from pathlib import Path

from rsoconsole.config import Config, with_setting
from rsoconsole.errors import ConfigError
from rsoconsole.night import LogLine, Night, NightFrame
from rsoconsole.notebook.night import DrawnNight, night_of, title_of
from rsoconsole.records import Record, SlewCommand
from rsoconsole.session.reading import SessionReader

LOG_LINES = 12
_FRAMES = 3
"""Newest frames whose picture may be shown: it may come later than its records."""


class LiveNight:
    """Everything that a panel shows of one session. Raises SessionError as its reader does."""

    def __init__(self, folder: Path) -> None:
        self._reader = SessionReader(folder)
        self.folder = folder
        self.begun_with = self._reader.config()
        """The configuration of the session's beginning."""
        self.records: list[Record] = []
        self.picture: tuple[int, bytes] | None = None
        """(frame, PNG) of the newest preview that is there."""
        about = self._reader.about()
        self._title = title_of(about, folder)
        self._night = Night(folder, about, self.begun_with, newest=None)

    def read(self) -> bool:
        """Read what is new; True where there was anything."""
        before = self._night.seq
        for seq, t_utc_ns, record in self._reader.records(since_seq=before):
            self.records.append(record)
            self._night.take(t_utc_ns, record, seq)
        return self._read_picture() or self._night.seq != before

    def night(self) -> DrawnNight:
        """Its frames so far."""
        return night_of(self._title, self.begun_with, self._night.frames.seen())

    def frame(self, frame_id: int) -> NightFrame:
        """What is on record of a frame."""
        return self._night.frame(frame_id)

    @property
    def slew(self) -> SlewCommand | None:
        """The last order to the mount."""
        return self._night.slew

    @property
    def log(self) -> tuple[LogLine, ...]:
        """Its last lines, the newest last."""
        return self._night.log[-LOG_LINES:]

    @property
    def config(self) -> Config:
        """In force now."""
        config = self.begun_with
        for name, value in self._night.frames.settings.items():
            try:
                config = with_setting(config, name, value)
            except ConfigError:
                continue  # a setting of a later version
        return config

    def _read_picture(self) -> bool:
        for frame_id in self._night.newest_frames()[:_FRAMES]:
            if self.picture is not None and self.picture[0] >= frame_id:
                return False
            path = self._reader.preview_path(frame_id)
            if path is None:
                continue
            try:
                self.picture = frame_id, path.read_bytes()
            except OSError:
                continue  # the next frame's may be read
            return True
        return False
