"""What the watches and the commands tell the screens, from their threads."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from textual.message import Message

from rsoconsole.console.night.engine_seen import EngineView, OrbitAhead
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.timeline.moments import Moment
from rsoconsole.console.timeline.timeline import Timeline
from rsoconsole.control import Command, Outcome, StopNews
from rsoconsole.night import LogLine, NightView

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures
    from rsoconsole.pipeline import Outlook


class NightSeen(Message):
    """The session has grown, or another one is read.

    While it waits for a screen that is busy, newer news takes its place: pictures must not pile up.
    """

    def __init__(self, night: NightView, picture: Picture | None) -> None:
        super().__init__()
        self.night, self.picture = night, picture
        self.is_taken = False
        """A screen has looked at it: what comes now needs a message of its own."""


class MarkHeld(Message):
    """The engine keeps a frame in which a mark has been begun, or says why it cannot."""

    def __init__(self, frame_id: int, outcome: Outcome, refused: Callable[[str], None]) -> None:
        super().__init__()
        self.frame_id, self.outcome, self.refused = frame_id, outcome, refused


class EngineSeen(Message):
    """The engine said something else than before, or nothing."""

    def __init__(self, engine: EngineView) -> None:
        super().__init__()
        self.engine = engine


class OutlookSeen(Message):
    """What the next hours bring."""

    def __init__(self, outlook: "Outlook") -> None:
        super().__init__()
        self.outlook = outlook


class OrbitSeen(Message):
    """Where the orbit leads."""

    def __init__(self, ahead: OrbitAhead) -> None:
        super().__init__()
        self.ahead = ahead


class TimelineSeen(Message):
    """A session under review: its course, and every line of its log that has been read."""

    def __init__(self, folder: Path, timeline: Timeline, lines: tuple[LogLine, ...]) -> None:
        super().__init__()
        self.folder, self.timeline, self.lines = folder, timeline, lines


class MomentSeen(Message):
    """One moment of it."""

    def __init__(self, folder: Path, moment: Moment) -> None:
        super().__init__()
        self.folder, self.moment = folder, moment


class ReviewFailed(Message):
    """Why it cannot be read."""

    def __init__(self, folder: Path, text: str) -> None:
        super().__init__()
        self.folder, self.text = folder, text


class Previewed(Message):
    """What the engine says of a move that somebody is typing."""

    def __init__(self, number: int, words: str, outcome: Outcome) -> None:
        super().__init__()
        self.number, self.words, self.outcome = number, words, outcome


class WhatIfSeen(Message):
    """What the night was and what it would have been, or why that cannot be told."""

    def __init__(self, now: "TrackFigures | None", then: "TrackFigures | None", fault: str) -> None:
        super().__init__()
        self.now, self.then, self.fault = now, then, fault


class Pointed(Message):
    """The mouse in a picture, in pixels of the frame."""

    def __init__(self, x_px: float, y_px: float, px_per_square: float, *, is_release: bool) -> None:
        super().__init__()
        self.x_px, self.y_px, self.px_per_square = x_px, y_px, px_per_square
        self.is_release = is_release


class OutcomeCame(Message):
    """What came of a command.

    ``stops``: how many STOPs there had been when it was sent; ``seq``: the last record that was
    known of then; ``then``: what goes right behind it, once it has been taken; None: nothing.
    """

    def __init__(
        self,
        command: Command,
        outcome: Outcome,
        stops: int,
        seq: int,
        then: Command | None = None,
    ) -> None:
        super().__init__()
        self.command, self.outcome, self.stops, self.seq = command, outcome, stops, seq
        self.then = then


class StopNewsCame(Message):
    """How a STOP stands; ``number``: which of this seat's it is."""

    def __init__(self, news: StopNews, number: int | None = None) -> None:
        super().__init__()
        self.news, self.number = news, number
