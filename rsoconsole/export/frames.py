"""What is on record of single frames: plate, measurements, where the track expected its object."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rsoconsole.errors import ExportError
from rsoconsole.export.rows import MeasuredRow
from rsoconsole.records import FollowedAgain, FrameTaken, Solution, TrackState
from rsoconsole.session.reading import SessionReader

_KINDS = (FrameTaken, Solution, TrackState, FollowedAgain)


@dataclass(slots=True, kw_only=True)
class FrameOnRecord:
    """One frame."""

    taken: FrameTaken
    solution: Solution | None = None
    predicted: TrackState | None = None
    rows: list[MeasuredRow] = field(default_factory=list)
    """Its measurements that count."""
    file: Path | None = None
    """Its pixels, where they are kept."""


def frames_on_record(session: Path, rows: Iterable[MeasuredRow]) -> dict[int, FrameOnRecord]:
    """Every frame of a session by its number. Raises SessionError."""
    reader = SessionReader(session)
    frames: dict[int, FrameOnRecord] = {}
    for _, _, record in reader.records(kinds=_KINDS):
        if isinstance(record, FrameTaken):
            file = reader.frame_path(record.frame_id)
            frames[record.frame_id] = FrameOnRecord(taken=record, file=file)
            continue
        frame = frames.get(getattr(record, "frame_id", None) or -1)
        if frame is None:
            continue
        match record:
            case Solution():
                frame.solution = record
            case FollowedAgain():
                frame.predicted = None
            case TrackState(kind="predicted", is_lead=True):
                frame.predicted = record
    for row in rows:
        if row.frame_id in frames and not row.is_superseded:
            frames[row.frame_id].rows.append(row)
    return frames


def chosen(frames: dict[int, FrameOnRecord], numbers: tuple[int, ...] | None) -> list[int]:
    """The frames asked for, all with None. Raises ExportError for one that there is not."""
    if numbers is None:
        return sorted(frames)
    unknown = [str(number) for number in numbers if number not in frames]
    if unknown:
        known = f"{min(frames)} to {max(frames)}" if frames else "none"
        raise ExportError(f"the session has no frame {', '.join(unknown)}; it has {known}")
    return sorted(numbers)


def parse_numbers(text: str) -> tuple[int, ...]:
    """``3,9-12`` as numbers. Raises ValueError."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ValueError(f"{part.strip()!r} is no frame: write them like 3,9-12")
        begin, end = int(first), int(last or first)
        if end < begin or end - begin > 1_000_000:
            raise ValueError(f"{part.strip()!r} is no range of frames: the smaller number first")
        numbers.update(range(begin, end + 1))
    return tuple(sorted(numbers))
