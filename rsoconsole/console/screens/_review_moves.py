"""Moves of a review through its night: by frames, by events, by playing, to a typed time."""

import time
from functools import partialmethod
from pathlib import Path
from typing import Any

from textual.widgets import Input

from rsoconsole.console.panes.panes import MomentField, TimelinePane
from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.timeline.lines import (
    SIGNS,
    TimelineMarks,
    cell_end_utc_ns,
    place_words,
    reading_progress_words,
)
from rsoconsole.console.timeline.moments import Moment
from rsoconsole.console.timeline.timeline import (
    KINDS,
    Player,
    Timeline,
    TimelineEventKind,
    parse_place,
    speed_words,
    typed_place_seq,
)
from rsoconsole.night import LogLine

ANY, FOUND = "any", "found"
PLAY_S = 0.1
_IN_FRAME = frozenset(("Miss", "NotFollowed", "NotSolved", "StateChange"))
"""Kinds of log lines whose moment is the end of their frame."""


class ReviewNavigation(NightScreen):
    """Base of the review: its place in the night, and the keys that change that place."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.folder: Path | None = None
        self.timeline = Timeline()
        self.lines: tuple[LogLine, ...] = ()
        self.moment: Moment | None = None
        """The shown moment; None before the first one is read."""
        self.kept: Moment | None = None
        """Moment A, to compare with; None: none is kept."""
        self.seq = 0
        self.is_at_head = False
        """True where the review follows a night that goes on, and shows its last frame."""
        self.kind: str = ANY
        """Kind of event to jump to; ``ANY``: all; ``FOUND``: lines that a search has found."""
        self.searched = ""
        self.player = Player()
        self._played_s = 0.0

    def want(self, seq: int) -> None:
        """Request a moment by its place in the log; empty here, the screen overrides it."""

    def show_timeline(self) -> None:
        """Draw the time line; empty here, the screen overrides it."""

    # -- where ----------------------------------------------------------------------------------

    def go(self, seq: int | None) -> bool:
        """Stop playing and go to a place of the log; return False if ``seq`` is None."""
        if seq is None:
            self.say("the session has no frames", "warn")
            return False
        self.player.is_playing = False
        self.forget_notice()  # it was said of another moment
        last = self.timeline.step(self.timeline.last_seq, 0)
        self.is_at_head = seq == last and not self.timeline.is_closed
        self.want(seq)
        self.show_keys()
        return True

    def _step_frames(self, by: int) -> None:
        before = self.seq
        if self.go(self.timeline.step(before, by)) and self.seq == before:
            self.say("the first frame" if by < 0 else "the last frame")

    action_frame_back = partialmethod(_step_frames, -1)
    action_frame_on = partialmethod(_step_frames, 1)
    action_ten_back = partialmethod(_step_frames, -10)
    action_ten_on = partialmethod(_step_frames, 10)
    action_hundred_back = partialmethod(_step_frames, -100)
    action_hundred_on = partialmethod(_step_frames, 100)

    def action_first_frame(self) -> None:
        """Go to the night's first frame."""
        self.go(self.timeline.step(0, 1))

    def action_last_frame(self) -> None:
        """Go to the last frame; while the night goes on, show each new frame from then on."""
        self.go(self.timeline.step(self.timeline.last_seq, 0))

    def on_timeline_pane_pointed(self, message: TimelinePane.Pointed) -> None:
        """Go to the last frame begun by the time at the mouse on the time line."""
        timeline = self.timeline
        t_utc_ns = cell_end_utc_ns(timeline, message.column, message.columns)
        seq = None if t_utc_ns is None else timeline.frame_end_seq_at_time(t_utc_ns)
        if seq != self.seq:
            self.go(seq)

    def action_goto_moment(self) -> None:
        """Open the field of the last line, to type a frame or a time."""
        self.query_one(MomentField).open()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Go to the typed frame or time."""
        event.stop()
        self.close_field()
        if event.value.strip():
            self.go_to_text(event.value)

    def close_field(self) -> bool:
        """Close the field of the last line; False where it was closed already."""
        field = self.query_one(MomentField)
        is_open = field.display
        if is_open:
            field.close()
            self.set_focus(None)
        return is_open

    def go_to_text(self, text: str) -> None:
        """Go to a frame or a time given as text; a notice says why if there is no such moment."""
        try:
            self.go(typed_place_seq(parse_place(text), self.timeline))
        except ValueError as error:
            self.say(str(error), "warn")

    # -- events ---------------------------------------------------------------------------------

    @property
    def kinds(self) -> tuple[TimelineEventKind, ...]:
        """Kinds of events at which the keys for the next and the previous event stop."""
        return tuple(kind for kind in KINDS if self.kind in {ANY, kind})

    @property
    def found(self) -> tuple[int, ...]:
        """Places in the log of the lines that a search found; empty unless jumps go there."""
        if self.kind != FOUND:
            return ()
        wanted = self.searched.lower()
        return tuple(self.moment_seq(line) for line in self.lines if wanted in line.text.lower())

    def moment_seq(self, line: LogLine) -> int:
        """Return the place in the log at which to show a line: its own, or the end of its frame."""
        index = self.timeline.frame_index(line.seq)
        if line.kind not in _IN_FRAME or index is None:
            return line.seq
        return self.timeline.frame_end_seq(index)

    def _jump(self, *, is_on: bool) -> None:
        if self.kind == FOUND:
            ahead = [seq for seq in self.found if (seq > self.seq if is_on else seq < self.seq)]
            seq = (min if is_on else max)(ahead, default=None)
            what = f"{self.searched!r}"
        else:
            event = self.timeline.next_event(self.seq, self.kinds, is_on=is_on)
            seq = None if event is None else self.timeline.moment_seq(event)
            what = self.kind if seq is None else ", ".join(self.timeline.event_kinds_at(seq))
        if seq is None:
            what = "event" if what == ANY else what
            unread = "" if self.timeline.is_whole else " in what has been read so far"
            self.say(f"no {'later' if is_on else 'earlier'} {what}{unread}")
            return
        self.go(seq)
        self.say(f"{place_words(self.timeline, seq, None)[0]}: {what}")

    action_event_back = partialmethod(_jump, is_on=False)
    action_event_on = partialmethod(_jump, is_on=True)

    def action_event_kind(self) -> None:
        """Choose the next kind of event to jump to, of those that the night has."""
        present = {each.kind for each in self.timeline.events}
        kinds = [ANY, *(kind for kind in KINDS if kind in present)]
        if self.searched:
            kinds.append(FOUND)
        at = kinds.index(self.kind) if self.kind in kinds else -1
        self.kind = kinds[(at + 1) % len(kinds)]
        count = len(self.found) if self.kind == FOUND else 0
        count += sum(each.kind in self.kinds for each in self.timeline.events)
        self.show_timeline()
        self.say(f"events: {self.jump_kind_words} ({count} in the night)")

    @property
    def jump_kind_words(self) -> str:
        """The kind of event to jump to, in words."""
        if self.kind == FOUND:
            return f"log has {self.searched!r}"
        return next((f"{SIGNS[kind]} {kind}" for kind in KINDS if kind == self.kind), "any event")

    # -- playing --------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play from the shown moment, or pause; at the end of a closed night, from its start."""
        if self.player.is_playing:
            self.player.is_playing = False
        elif self.timeline.frames:
            timeline = self.timeline
            first, last = timeline.step(0, 1), timeline.step(timeline.last_seq, 0)
            if self.seq == last and self.timeline.is_closed and first is not None:
                self.want(first)
            self.is_at_head = False
            self.player.begin(self.timeline, self.seq)
            self._played_s = time.monotonic()
        self.show_timeline()
        self.show_keys()

    def show_due_frame(self) -> None:
        """Show the frame that is due by now; do nothing while paused."""
        if not self.player.is_playing:
            return
        now_s = time.monotonic()
        seq = self.player.after(self.timeline, self.seq, now_s - self._played_s)
        self._played_s = now_s
        if seq != self.seq:
            self.want(seq)
        elif not self.player.is_playing:
            self.show_timeline()
            self.show_keys()

    def _change_speed(self, by: int) -> None:
        self.player.change(by)
        self.show_timeline()
        self.say(f"speed: {speed_words(self.player.speed)} of what it was")

    action_slower = partialmethod(_change_speed, -1)
    action_faster = partialmethod(_change_speed, 1)

    # -- in words -------------------------------------------------------------------------------

    @property
    def place(self) -> TimelineMarks:
        """What the time line marks: the shown moment, moment A, the events to jump to."""
        return TimelineMarks(
            seq=self.seq,
            words=tuple(word for word in self._place_words() if word),
            kept_seq=self.kept.seq if self.kept is not None else None,
            kinds=self.kinds if self.kind != FOUND else (),
            found=self.found,
        )

    def _place_words(self) -> list[str]:
        if self.folder is None:
            return ["no session"]
        moment, timeline = self.moment, self.timeline
        is_there = moment is not None and moment.seq == self.seq
        t_utc_ns = self.night.last_utc_ns if is_there else timeline.frame_start_utc_ns(self.seq)
        speed = speed_words(self.player.speed)
        pace = f"{'play' if self.player.is_playing else 'paused'} {speed}"
        if self.is_at_head:
            pace = "follows the live night"
        partly = "" if moment is None or moment.is_whole else "earlier frames still to come"
        kept = "" if self.kept is None else "A " + place_words(timeline, self.kept.seq, None)[0]
        return [
            *place_words(timeline, self.seq, t_utc_ns),
            pace,
            reading_progress_words(timeline),
            partly,
            self.jump_kind_words,
            kept,
        ]
