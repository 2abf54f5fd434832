"""A session on record: its metadata, its log, and its frames."""

from pathlib import Path
from typing import Any, Self

from rsoconsole.config import Config
from rsoconsole.library.notebook.figures.figures import NightPlots
from rsoconsole.library.notebook.night.night import (
    DrawnNight,
    expect_frames,
    make_drawn_night,
    session_title,
)
from rsoconsole.night import (
    LeadSummary,
    Logged,
    NightFrame,
    NightFrames,
    NightTrack,
    lead_summary,
    tracks_of,
)
from rsoconsole.session import SessionReader


class RecordedSession(NightPlots):
    """Record of a session as far as it has been read; ``refresh`` reads new records."""

    def __init__(self, folder: Path) -> None:
        self._reader = SessionReader(folder)
        self._about = self._reader.read_meta()
        self._log: list[Logged] = []
        self._frames = NightFrames(self._reader.config())
        self.refresh()

    def refresh(self) -> Self:
        """Read what a session that is still open has recorded since; return this object."""
        self._about = self._reader.read_meta()
        since = self._log[-1][0] if self._log else 0
        for seq, t_utc_ns, record in self._reader.records(since_seq=since):
            self._log.append((seq, t_utc_ns, record))
            self._frames.fold_record(record)
        return self

    @property
    def path(self) -> Path:
        """Folder of the session."""
        return self._reader.folder

    @property
    def title(self) -> str:
        """Title of the session."""
        return session_title(self._about, self.path)

    @property
    def about(self) -> dict[str, Any]:
        """Metadata of the session: versions, the network's hash and so on."""
        return dict(self._about)

    @property
    def config(self) -> Config:
        """Configuration at the session's beginning."""
        return self._reader.config()

    @property
    def is_closed(self) -> bool:
        """True where the session was closed: False while it goes on, and where it was cut off."""
        return self._about.get("is_closed") is True

    @property
    def summary(self) -> LeadSummary:
        """Figures of merit of the lead track over the night."""
        return lead_summary(self._night().frames)

    @property
    def tracks(self) -> dict[int, NightTrack]:
        """Tracks by number, each with its orbit and its name.

        >>> night.tracks[2].orbit.a_km, night.tracks[2].name
        """
        return tracks_of(self._frames.kept_frames())

    @property
    def night_frames(self) -> tuple[NightFrame, ...]:
        """Frames read so far, each with everything on record of it."""
        return tuple(self._frames.kept_frames())

    @property
    def records(self) -> tuple[Logged, ...]:
        """Records read so far, in the order of the log: (seq, t_utc_ns, record)."""
        return tuple(self._log)

    def nights(self) -> tuple[DrawnNight, ...]:
        """Return the night that the plots draw. Raises SessionError where no frame has a time."""
        return (expect_frames(self._night(), self.path),)

    def _night(self) -> DrawnNight:
        return make_drawn_night(self.title, self.config, self._frames.kept_frames())
