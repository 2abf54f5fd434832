"""Through the time of a recorded night: by frames, by events, by playing, by what is typed."""

import time
from pathlib import Path
from typing import Any

from textual.widgets import Input

from rsoconsole.console.night import LogLine
from rsoconsole.console.panes import MomentField, TimelinePane
from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.timeline import (
    KINDS,
    SIGNS,
    HappeningKind,
    Moment,
    Player,
    Timeline,
    place_words,
    seq_of,
    speed_words,
    time_at,
    understood,
)

PLAY_S = 0.1
"""How often it is looked whether another frame is due."""
ANY, FOUND = "any", "found"
_IN_FRAME = frozenset(("Miss", "NotFollowed", "NotSolved", "StateChange"))
"""Kinds of lines that are seen whole at their frame's end."""


class ReviewMoves(NightScreen):
    """Holds which moment is wanted, and changes it."""

    folder: Path | None = None
    timeline = Timeline()
    lines: tuple[LogLine, ...] = ()
    """Of the whole log, as far as it has been read."""
    moment: Moment | None = None
    """The one that is shown; None before the first."""
    seq = 0
    """The one that is wanted."""
    is_at_head = False
    """Whether a night that goes on is followed."""
    kind: str = ANY
    searched = ""
    """Words that the log has been searched for."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.player = Player()
        self._played_s = 0.0

    # -- for the screen that shows it -----------------------------------------------------------

    def want(self, seq: int) -> None:
        """Have that moment shown."""
        self.seq = seq

    def show_place(self) -> None:
        """Draw the time line again."""

    # -- where ----------------------------------------------------------------------------------

    def go(self, seq: int | None) -> bool:
        """To that moment, by hand: playing ends; False where there is none."""
        if seq is None:
            self.say("the session has no frames", "warn")
            return False
        self.player.is_playing = False
        last = self.timeline.step(self.timeline.last_seq, 0)
        self.is_at_head = seq == last and not self.timeline.is_closed
        self.want(seq)
        self.show_keys()
        return True

    def _step(self, by: int) -> None:
        before = self.seq
        if self.go(self.timeline.step(before, by)) and self.seq == before:
            self.say("the first frame" if by < 0 else "the last frame")

    def action_frame_back(self) -> None:
        """One frame."""
        self._step(-1)

    def action_frame_on(self) -> None:
        """One frame."""
        self._step(1)

    def action_ten_back(self) -> None:
        """Ten frames."""
        self._step(-10)

    def action_ten_on(self) -> None:
        """Ten frames."""
        self._step(10)

    def action_hundred_back(self) -> None:
        """A hundred frames."""
        self._step(-100)

    def action_hundred_on(self) -> None:
        """A hundred frames."""
        self._step(100)

    def action_first_frame(self) -> None:
        """Of the night."""
        self.go(self.timeline.step(0, 1))

    def action_last_frame(self) -> None:
        """Of the night; one that goes on is followed."""
        self.go(self.timeline.step(self.timeline.last_seq, 0))

    def on_timeline_pane_pointed(self, message: TimelinePane.Pointed) -> None:
        """The mouse on the time line."""
        t_utc_ns = time_at(self.timeline, message.column, message.columns)
        seq = None if t_utc_ns is None else self.timeline.at_time(t_utc_ns)
        if seq != self.seq:
            self.go(seq)

    def action_goto_moment(self) -> None:
        """Ask which, in the last line."""
        self.query_one(MomentField).open()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """To what was typed there."""
        event.stop()
        self.close_field()
        if event.value.strip():
            self.go_to_text(event.value)

    def close_field(self) -> bool:
        """Nothing is typed any more; whether something was."""
        field = self.query_one(MomentField)
        is_open = field.display
        if is_open:
            field.close()
            self.set_focus(None)
        return is_open

    def go_to_text(self, text: str) -> None:
        """To what was typed; why not, where there is no such moment."""
        try:
            self.go(seq_of(understood(text), self.timeline))
        except ValueError as error:
            self.say(str(error), "warn")

    # -- events ---------------------------------------------------------------------------------

    @property
    def kinds(self) -> tuple[HappeningKind, ...]:
        """What is jumped to, of what the time line has."""
        return tuple(kind for kind in KINDS if self.kind in {ANY, kind})

    @property
    def found(self) -> tuple[int, ...]:
        """Moments of the lines with the words that were searched for; empty for other kinds."""
        if self.kind != FOUND:
            return ()
        wanted = self.searched.lower()
        return tuple(self.moment_of(line) for line in self.lines if wanted in line.text.lower())

    def moment_of(self, line: LogLine) -> int:
        """The place from which a line of the log is best seen."""
        index = self.timeline.index_of(line.seq)
        if line.kind not in _IN_FRAME or index is None:
            return line.seq
        return self.timeline.end_of(index)

    def action_event_back(self) -> None:
        """The one before."""
        self._jump(is_on=False)

    def action_event_on(self) -> None:
        """The next one."""
        self._jump(is_on=True)

    def _jump(self, *, is_on: bool) -> None:
        if self.kind == FOUND:
            ahead = [seq for seq in self.found if (seq > self.seq if is_on else seq < self.seq)]
            seq = (min if is_on else max)(ahead, default=None)
            what = f"{self.searched!r}"
        else:
            happening = self.timeline.jump(self.seq, self.kinds, is_on=is_on)
            seq = None if happening is None else self.timeline.moment_of(happening)
            what = self.kind if seq is None else ", ".join(self.timeline.kinds_at(seq))
        if seq is None:
            what = "event" if what == ANY else what
            unread = "" if self.timeline.is_whole else " in what has been read so far"
            self.say(f"no {'later' if is_on else 'earlier'} {what}{unread}")
            return
        self.go(seq)
        self.say(f"{place_words(self.timeline, seq, None)[0]}: {what}")

    def action_event_kind(self) -> None:
        """The next kind that the night has."""
        present = {each.kind for each in self.timeline.happenings}
        kinds = [ANY, *(kind for kind in KINDS if kind in present)]
        if self.searched:
            kinds.append(FOUND)
        at = kinds.index(self.kind) if self.kind in kinds else -1
        self.kind = kinds[(at + 1) % len(kinds)]
        count = len(self.found) if self.kind == FOUND else 0
        count += sum(each.kind in self.kinds for each in self.timeline.happenings)
        self.show_place()
        self.say(f"events: {self.kind_words} ({count} in the night)")

    @property
    def kind_words(self) -> str:
        """What is jumped to."""
        if self.kind == FOUND:
            return f"log has {self.searched!r}"
        return next((f"{SIGNS[kind]} {kind}" for kind in KINDS if kind == self.kind), "any event")

    # -- playing --------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play from here, or stay here; at the end of a night, from its beginning."""
        if self.player.is_playing:
            self.player.is_playing = False
        elif self.timeline.frames:
            first, last = self.timeline.step(0, 1), self.timeline.step(self.timeline.last_seq, 0)
            if self.seq == last and self.timeline.is_closed and first is not None:
                self.want(first)
            self.is_at_head = False
            self.player.begin(self.timeline, self.seq)
            self._played_s = time.monotonic()
        self.show_place()
        self.show_keys()

    def play_on(self) -> None:
        """The moment that is due by now."""
        if not self.player.is_playing:
            return
        now_s = time.monotonic()
        seq = self.player.after(self.timeline, self.seq, now_s - self._played_s)
        self._played_s = now_s
        if seq != self.seq:
            self.want(seq)
        elif not self.player.is_playing:
            self.show_place()
            self.show_keys()

    def action_slower(self) -> None:
        """One step."""
        self._change_speed(-1)

    def action_faster(self) -> None:
        """One step."""
        self._change_speed(1)

    def _change_speed(self, by: int) -> None:
        self.player.change(by)
        self.show_place()
        self.say(f"speed: {speed_words(self.player.speed)} of what it was")
