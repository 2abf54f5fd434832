"""A session as it grows, read bit by bit for the live panel."""

from collections import deque
from pathlib import Path
from typing import assert_never

from rsoconsole.config import Config, with_setting
from rsoconsole.control import Note, command_words
from rsoconsole.errors import ConfigError
from rsoconsole.notebook.night import FrameFacts, Night, NightFold, title_of
from rsoconsole.reason_text import text
from rsoconsole.reasons import DONE
from rsoconsole.records import (
    Closeup,
    CycleTiming,
    Detections,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    LeapDone,
    LowPass,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    PairMotions,
    ParameterChange,
    Record,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.session.reading import SessionReader

LOG_LINES = 12
_FRAMES = 3
"""Frames of which everything is kept: a picture may come later than its records."""


class LiveNight:
    """Everything that a panel shows of one session. Raises SessionError as its reader does."""

    def __init__(self, folder: Path) -> None:
        self._reader = SessionReader(folder)
        self.folder = folder
        self.begun_with = self._reader.config()
        """The configuration of the session's beginning."""
        self.config: Config = self.begun_with
        """In force now."""
        self.records: list[Record] = []
        self.slew: SlewCommand | None = None
        self.log: deque[tuple[int, str, str]] = deque(maxlen=LOG_LINES)
        """(t_utc_ns, level, words), the newest last."""
        self.picture: tuple[int, bytes] | None = None
        """(frame, PNG) of the newest preview that is there."""
        self._fold = NightFold(title_of(self._reader.about(), folder), self.begun_with)
        self._facts: dict[int, FrameFacts] = {}
        self._seq = 0

    def read(self) -> bool:
        """Read what is new; True where there was anything."""
        before = self._seq
        for seq, t_utc_ns, record in self._reader.records(since_seq=self._seq):
            self._seq = seq
            self.records.append(record)
            self._take(t_utc_ns, record)
        return self._read_picture() or self._seq != before

    def night(self) -> Night:
        """Its frames so far."""
        return self._fold.night()

    def facts(self, frame_id: int) -> FrameFacts:
        """What is known of one of the newest frames."""
        return self._facts.get(frame_id, FrameFacts())

    def followed(self, frame_id: int) -> Measurement | None:
        """The measurement that the track took in a frame."""
        frames = self.night().frames
        return next((f.measured for f in reversed(frames) if f.frame_id == frame_id), None)

    def _take(self, t_utc_ns: int, record: Record) -> None:
        self._fold.take(record)
        if isinstance(record, FrameTaken):
            self._facts[record.frame_id] = FrameFacts()
            while len(self._facts) > _FRAMES:
                self._facts.pop(min(self._facts))
        facts = self._facts.get(getattr(record, "frame_id", None) or -1)
        if facts is not None:
            facts.take(record)
        match record:
            case SlewCommand():
                self.slew = record
            case ParameterChange():
                self._change(record)
            case (
                FrameTaken()
                | Detections()
                | Solution()
                | NotSolved()
                | Measurement()
                | NotFollowed()
                | Miss()
                | TrackState()
                | StateChange()
                | OperatorAction()
                | CycleTiming()
                | Closeup()
                | Ruling()
                | FollowedAgain()
                | OrbitEstimate()
                | Identified()
                | PairMotions()
                | ExpectedMembers()
                | LeapDone()
                | LowPass()
                | Event()
            ):
                pass  # the frames' fold, or the log's line
            case _:
                assert_never(record)
        line = _line(record)
        if line is not None:
            self.log.append((t_utc_ns, *line))

    def _change(self, change: ParameterChange) -> None:
        try:
            self.config = with_setting(self.config, change.name, change.after)
        except ConfigError:
            return  # a setting of a later version

    def _read_picture(self) -> bool:
        for frame_id in sorted(self._facts, reverse=True):
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


def _line(record: Record) -> tuple[str, str] | None:
    """(level, words) of what belongs into the log; None for what is routine."""
    level, words = "info", ""
    match record:
        case Event():
            level, words = record.level, record.text
        case StateChange():
            words = f"{record.before} → {record.after}: {text(record.reason)}"
        case Miss():
            level, words = "warning", f"missed: {text(record.reason)}"
        case NotFollowed():
            words = f"not followed: {text(record.reason)}"
        case ParameterChange():
            words = f"{record.name} {record.before} → {record.after} by {_who(record.by)}"
        case OperatorAction():
            is_quiet = record.outcome == DONE or record.outcome.kind == "accepted"
            outcome = "" if is_quiet else f": {text(record.outcome)}"
            said = record.arguments.get("text") if record.verb == Note.verb else None
            wanted = said or command_words(record.verb, record.arguments)
            words = f"{_who(record.by)}: {wanted}{outcome}"
        case (
            FrameTaken()
            | Detections()
            | Solution()
            | NotSolved()
            | Measurement()
            | TrackState()
            | SlewCommand()
            | CycleTiming()
            | Closeup()
            | Ruling()
            | FollowedAgain()
            | OrbitEstimate()
            | Identified()
            | PairMotions()
            | ExpectedMembers()
            | LeapDone()
            | LowPass()
        ):
            pass
        case _:
            assert_never(record)
    return (level, words) if words else None


def _who(by: str) -> str:
    return by.removeprefix("console ")
