"""Through the time of a recorded night: by frames, by events, by playing, by what is typed."""

import time
from functools import partialmethod
from pathlib import Path
from typing import Any

from rsoconsole.console.panes.panes import MomentField, TimelinePane
from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.timeline.lines import SIGNS, Place, place_words, reading_words, time_at
from rsoconsole.console.timeline.moments import Moment
from rsoconsole.console.timeline.timeline import (
    KINDS,
    Player,
    Timeline,
    TimelineEventKind,
    parse_place,
    seq_of,
    speed_words,
)
from rsoconsole.night import LogLine

ANY, FOUND = "any", "found"


class ReviewSeat(NightScreen):
    """Holds where a review is; the screen above it brings the moments and draws the time line."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.folder: Path | None = None
        self.timeline = Timeline()
        self.lines: tuple[LogLine, ...] = ()
        """Of the whole log, as far as it has been read."""
        self.moment: Moment | None = None
        """The moment that is shown; None before the first."""
        self.kept: Moment | None = None
        """The one to compare with, A; None while none is kept."""
        self.seq = 0
        """The moment that is wanted."""
        self.is_at_head = False
        """Whether a night that goes on is followed."""
        self.kind: str = ANY
        """Of the events that are jumped to."""
        self.searched = ""
        """Words that the log has been searched for."""
        self.player = Player()

    def want(self, seq: int) -> None:
        """Have that moment shown."""

    def show_place(self) -> None:
        """The time line."""


PLAY_S = 0.1
"""How often it is looked whether another frame is due."""
_IN_FRAME = frozenset(("Miss", "NotFollowed", "NotSolved", "StateChange"))
"""Kinds of lines that are seen whole at their frame's end."""


class ReviewMoves:
    """Changes which moment is wanted."""

    def __init__(self, review: ReviewSeat) -> None:
        self._review = review
        self._played_s = 0.0

    # -- where ----------------------------------------------------------------------------------

    def go(self, seq: int | None) -> bool:
        """To that moment, by hand: playing ends; False where there is none."""
        review = self._review
        if seq is None:
            review.say("the session has no frames", "warn")
            return False
        review.player.is_playing = False
        last = review.timeline.step(review.timeline.last_seq, 0)
        review.is_at_head = seq == last and not review.timeline.is_closed
        review.want(seq)
        review.show_keys()
        return True

    def _step(self, by: int) -> None:
        review = self._review
        before = review.seq
        if self.go(review.timeline.step(before, by)) and review.seq == before:
            review.say("the first frame" if by < 0 else "the last frame")

    action_frame_back = partialmethod(_step, -1)
    action_frame_on = partialmethod(_step, 1)
    action_ten_back = partialmethod(_step, -10)
    action_ten_on = partialmethod(_step, 10)
    action_hundred_back = partialmethod(_step, -100)
    action_hundred_on = partialmethod(_step, 100)

    def action_first_frame(self) -> None:
        """Of the night."""
        self.go(self._review.timeline.step(0, 1))

    def action_last_frame(self) -> None:
        """Of the night; one that goes on is followed."""
        self.go(self._review.timeline.step(self._review.timeline.last_seq, 0))

    def point(self, message: TimelinePane.Pointed) -> None:
        """The mouse on the time line."""
        timeline = self._review.timeline
        t_utc_ns = time_at(timeline, message.column, message.columns)
        seq = None if t_utc_ns is None else timeline.at_time(t_utc_ns)
        if seq != self._review.seq:
            self.go(seq)

    def action_goto_moment(self) -> None:
        """Ask which, in the last line."""
        self._review.query_one(MomentField).open()

    def take(self, typed: str) -> None:
        """To what was typed there."""
        self.close_field()
        if typed.strip():
            self.go_to_text(typed)

    def close_field(self) -> bool:
        """Nothing is typed any more; whether something was."""
        field = self._review.query_one(MomentField)
        is_open = field.display
        if is_open:
            field.close()
            self._review.set_focus(None)
        return is_open

    def go_to_text(self, text: str) -> None:
        """To what was typed; why not, where there is no such moment."""
        try:
            self.go(seq_of(parse_place(text), self._review.timeline))
        except ValueError as error:
            self._review.say(str(error), "warn")

    # -- events ---------------------------------------------------------------------------------

    @property
    def kinds(self) -> tuple[TimelineEventKind, ...]:
        """What is jumped to, of what the time line has."""
        return tuple(kind for kind in KINDS if self._review.kind in {ANY, kind})

    @property
    def found(self) -> tuple[int, ...]:
        """Moments of the lines with the words that were searched for; empty for other kinds."""
        review = self._review
        if review.kind != FOUND:
            return ()
        wanted = review.searched.lower()
        return tuple(self.moment_of(line) for line in review.lines if wanted in line.text.lower())

    def moment_of(self, line: LogLine) -> int:
        """The place from which a line of the log is best seen."""
        index = self._review.timeline.index_of(line.seq)
        if line.kind not in _IN_FRAME or index is None:
            return line.seq
        return self._review.timeline.end_of(index)

    def _jump(self, *, is_on: bool) -> None:
        review = self._review
        if review.kind == FOUND:
            ahead = [seq for seq in self.found if (seq > review.seq if is_on else seq < review.seq)]
            seq = (min if is_on else max)(ahead, default=None)
            what = f"{review.searched!r}"
        else:
            event = review.timeline.jump(review.seq, self.kinds, is_on=is_on)
            seq = None if event is None else review.timeline.moment_of(event)
            what = review.kind if seq is None else ", ".join(review.timeline.kinds_at(seq))
        if seq is None:
            what = "event" if what == ANY else what
            unread = "" if review.timeline.is_whole else " in what has been read so far"
            review.say(f"no {'later' if is_on else 'earlier'} {what}{unread}")
            return
        self.go(seq)
        review.say(f"{place_words(review.timeline, seq, None)[0]}: {what}")

    action_event_back = partialmethod(_jump, is_on=False)
    action_event_on = partialmethod(_jump, is_on=True)

    def action_event_kind(self) -> None:
        """The next kind that the night has."""
        review = self._review
        present = {each.kind for each in review.timeline.events}
        kinds = [ANY, *(kind for kind in KINDS if kind in present)]
        if review.searched:
            kinds.append(FOUND)
        at = kinds.index(review.kind) if review.kind in kinds else -1
        review.kind = kinds[(at + 1) % len(kinds)]
        count = len(self.found) if review.kind == FOUND else 0
        count += sum(each.kind in self.kinds for each in review.timeline.events)
        review.show_place()
        review.say(f"events: {self.kind_words} ({count} in the night)")

    @property
    def kind_words(self) -> str:
        """What is jumped to."""
        review = self._review
        if review.kind == FOUND:
            return f"log has {review.searched!r}"
        return next((f"{SIGNS[kind]} {kind}" for kind in KINDS if kind == review.kind), "any event")

    # -- playing --------------------------------------------------------------------------------

    def action_play(self) -> None:
        """Play from here, or stay here; at the end of a night, from its beginning."""
        review = self._review
        if review.player.is_playing:
            review.player.is_playing = False
        elif review.timeline.frames:
            timeline = review.timeline
            first, last = timeline.step(0, 1), timeline.step(timeline.last_seq, 0)
            if review.seq == last and review.timeline.is_closed and first is not None:
                review.want(first)
            review.is_at_head = False
            review.player.begin(review.timeline, review.seq)
            self._played_s = time.monotonic()
        review.show_place()
        review.show_keys()

    def play_on(self) -> None:
        """The moment that is due by now."""
        review = self._review
        if not review.player.is_playing:
            return
        now_s = time.monotonic()
        seq = review.player.after(review.timeline, review.seq, now_s - self._played_s)
        self._played_s = now_s
        if seq != review.seq:
            review.want(seq)
        elif not review.player.is_playing:
            review.show_place()
            review.show_keys()

    def _change_speed(self, by: int) -> None:
        review = self._review
        review.player.change(by)
        review.show_place()
        review.say(f"speed: {speed_words(review.player.speed)} of what it was")

    action_slower = partialmethod(_change_speed, -1)
    action_faster = partialmethod(_change_speed, 1)


def place_of(review: ReviewSeat, moves: ReviewMoves) -> Place:
    """The wanted moment, the kept moment, and what is jumped to."""
    return Place(
        seq=review.seq,
        words=tuple(word for word in _words(review, moves) if word),
        kept_seq=review.kept.seq if review.kept is not None else None,
        kinds=moves.kinds if review.kind != FOUND else (),
        found=moves.found,
    )


def _words(review: ReviewSeat, moves: ReviewMoves) -> list[str]:
    if review.folder is None:
        return ["no session"]
    moment, timeline = review.moment, review.timeline
    is_there = moment is not None and moment.seq == review.seq
    t_utc_ns = review.night.last_utc_ns if is_there else timeline.time_of(review.seq)
    speed = speed_words(review.player.speed)
    pace = f"{'play' if review.player.is_playing else 'paused'} {speed}"
    if review.is_at_head:
        pace = "follows the live night"
    partly = "" if moment is None or moment.is_whole else "earlier frames still to come"
    kept = "" if review.kept is None else "A " + place_words(timeline, review.kept.seq, None)[0]
    return [
        *place_words(timeline, review.seq, t_utc_ns),
        pace,
        reading_words(timeline),
        partly,
        moves.kind_words,
        kept,
    ]
