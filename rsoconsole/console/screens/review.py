"""Review: the screen of a night over a recorded session, at any moment of it; no key acts.

The requested moment is marked on the time line at once; its contents follow from the thread that
reads the session.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType

from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.commands.keymap import bindings
from rsoconsole.console.dialogs.ask import LineDialog
from rsoconsole.console.drawing.pane_layout import Name
from rsoconsole.console.drawing.plot import Line
from rsoconsole.console.orbit.lines import target_words
from rsoconsole.console.panes.frame_pane import FramePane, Sight
from rsoconsole.console.panes.last_line import Key, Mode, review_keys
from rsoconsole.console.panes.log_pane import LogPane
from rsoconsole.console.panes.panes import MomentField, TimelinePane
from rsoconsole.console.picture.picture import DrawnPicture, Picture
from rsoconsole.console.screens._compare import ReviewComparison
from rsoconsole.console.screens._pane_places import frame_aspect
from rsoconsole.console.screens._review_log import ReviewLogPane, ReviewTuneActions
from rsoconsole.console.screens._review_moves import ANY, FOUND, PLAY_S
from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.timeline.lines import recorded_engine_view, review_top_lines, timeline_lines
from rsoconsole.console.timeline.moments import Moment, ReviewWatch
from rsoconsole.console.timeline.timeline import Player, Timeline
from rsoconsole.console.tuning.tuning_pane import TuneFigures
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.night import LogLine, NightView

if TYPE_CHECKING:
    from rsoconsole.pipeline import SkyOutlook

LIVE_S = 0.5
LINES = 200
OUTLOOK_GOOD_NS = 600 * 10**9
OUTLOOK_AFTER_S = 0.7
"""Seconds that a moment must stay before its outlook is computed."""
HEAD = "head"
"""Value of ``start`` for the last frame of a night that goes on, which the review then follows."""


class ReviewScreen(ReviewComparison):
    """The review of a recorded night, or of the night that goes on."""

    BINDINGS: ClassVar[list[BindingType]] = [*bindings("review")]
    PANES: ClassVar[tuple[Name, ...]] = (*NightScreen.PANES, "timeline")
    LOG: ClassVar[type[LogPane]] = ReviewLogPane
    TUNE: ClassVar[type[TuneActions]] = ReviewTuneActions
    tune: ReviewTuneActions
    DEFAULT_CSS = """
    ReviewScreen > #timeline { background: $surface; }
    """

    def __init__(
        self,
        *arguments: Any,
        folder: Path | None,
        start: str = "",
        live: NightScreen | None = None,
        **named: Any,
    ) -> None:
        """Make the review; further arguments as for ``OperatorScreen``.

        ``folder``: session to show; None: ask which.
        ``start``: a frame, a UTC time or ``HEAD``; empty: the first frame.
        ``live``: the live screen behind the review, to return to; None: there is none.
        """
        super().__init__(*arguments, read_only=True, **named)
        self._live = live
        self._first = (folder, start)
        self._start: str | None = None
        """Where to begin in the session being opened; None once the review is there."""
        self._fault = ""
        self._watch_session = ReviewWatch(
            partial(call_between_messages, self, self.update_timeline),
            partial(call_between_messages, self, self.show_moment),
            partial(call_between_messages, self, self.show_fault),
        )

    def compose(self) -> ComposeResult:
        """Make the panes of a night, the time line and the field for a moment."""
        yield from super().compose()
        yield TimelinePane(id="timeline")
        yield MomentField()

    def on_mount(self) -> None:
        """Start to read the session; if none is given, ask for one."""
        self._watch_session.start()
        self.set_interval(PLAY_S, self.show_due_frame)
        if self._live is not None:
            self.set_interval(LIVE_S, self.show_live_state)
        folder, start = self._first
        if folder is None:
            self.call_after_refresh(self.action_sessions)
        else:
            self.open_session(folder, start)

    def on_unmount(self) -> None:
        """End the thread that reads the session."""
        self._watch_session.close()

    def open_session(self, folder: Path, start: str = "") -> None:
        """Show another session, from ``start`` on: a frame, a UTC time or ``HEAD``."""
        self.folder, self._start, self._fault = folder, start, ""
        self.timeline, self.lines, self.moment = Timeline(), (), None
        self.seq, self.is_at_head = 0, False
        self.forget_moment_a()
        self.kind, self.searched, self.player = ANY, "", Player()
        self.night, self.picture, self.outlook = NightView(folder=folder), None, None
        self.orbit_ahead = None
        self.engine = recorded_engine_view(self.night)
        self._watch_session.follow(folder)
        self.show_timeline()

    # -- what is known ----------------------------------------------------------------------

    def update_timeline(self, folder: Path, timeline: Timeline, lines: tuple[LogLine, ...]) -> None:
        """Take the session's time line and its log's lines, as far as they have been read."""
        if folder != self.folder:
            return
        self.timeline, self.lines, self._fault = timeline, lines, ""
        if self._start is not None:
            self._begin()
        elif self.is_at_head:
            last = self.timeline.step(self.timeline.last_seq, 0)
            if last is not None and last != self.seq:
                self.want(last)
        self._ask_outlook()
        self.show_timeline()
        self.show_live_state()
        if self.is_log_open:
            self.show_log()

    def _begin(self) -> None:
        """Go to the moment at which the session is to be opened."""
        start, self._start = self._start, None
        self.player.settle(self.timeline)
        if not self.timeline.frames:
            self.want(self.timeline.last_seq)
        elif start == HEAD:
            self.action_last_frame()
        else:
            self.action_first_frame()
            if start:
                self.go_to_text(start)

    def show_moment(self, folder: Path, moment: Moment) -> None:
        """Show a moment that has been read, and what is computed for it."""
        if folder != self.folder:
            return
        has_other_shape = frame_aspect(moment.picture) != frame_aspect(self.picture)
        self.moment, self.night, self.picture = moment, moment.view, moment.picture
        self.engine, self.outlook = recorded_engine_view(moment.view), self.outlook
        if has_other_shape and moment.picture is not None:
            self.place_panes()
        self._ask_outlook()
        self.show_timeline()
        self.compare_when_ready()
        self._compute_here()

    def _when_it_stays(self, act: Callable[[], None]) -> None:
        """Call ``act`` if this moment is still shown after ``OUTLOOK_AFTER_S``."""
        moment = self.moment
        self.set_timer(OUTLOOK_AFTER_S, lambda: act() if self.moment is moment else None)

    def _compute_here(self) -> None:
        """Clear the tuning pane's figures of another moment; compute those of this one later."""
        self.tune.figures = TuneFigures()
        self.tune.show()
        if not self.player.is_playing:
            self._when_it_stays(
                lambda: self.tune.request_figures() if self.tune.pane.display else None
            )

    def _ask_outlook(self) -> None:
        """Request the outlook once the moment stays: its computation takes the processor."""
        if self.timeline.is_whole and self.moment is not None:
            self._when_it_stays(lambda: self.outlook_watch.update(self.night, self.engine))

    def show_fault(self, folder: Path, text: str) -> None:
        """Show why the session cannot be read."""
        if folder == self.folder and text != self._fault:
            self._fault = text
            self.show_alert()

    def want(self, seq: int) -> None:
        """Request a moment by its place in the log; the time line marks the place at once."""
        self.seq = seq
        if self.folder is not None:
            self._watch_session.want(self.folder, seq)
        self.show_timeline()

    # -- what is shown ----------------------------------------------------------------------

    def show_live_state(self) -> None:
        """Draw what depends on the live night behind: first line, alert and keys."""
        self.show_top()
        self.show_alert()
        self.show_keys()

    def validate_outlook(self, outlook: "SkyOutlook | None") -> "SkyOutlook | None":
        """Return the outlook if it is for about the shown moment, else None; called by Textual."""
        now = self.night.last_utc_ns or 0
        is_near = outlook is not None and abs(outlook.t_utc_ns - now) <= OUTLOOK_GOOD_NS
        return outlook if is_near else None

    def show_timeline(self) -> None:
        """Draw the time line."""
        lines = partial(timeline_lines, self.timeline, self.place)
        self.query_one("#timeline", TimelinePane).show(lines)

    def top_lines(self, width: int, rows: int) -> list[Line]:
        """Build the first lines: that this is a review, the state then, and the live state."""
        live = None if self._live is None else (self._live.night, self._live.engine)
        found = target_words(self.orbit)
        return review_top_lines(self.night, self.engine, live, width, rows, found=found)

    @property
    def alert_words(self) -> str:
        """The live night's alert, then why the session cannot be read; empty: neither."""
        live = "" if self._live is None else self._live.alert_words
        return " · ".join(part for part in (f"LIVE: {live}" if live else "", self._fault) if part)

    def picture_words(
        self, picture: Picture | None, sight: Sight, drawing: DrawnPicture | None
    ) -> tuple[list[str], list[str]]:
        """Return the picture's title and caption; for a frame without a picture only its number."""
        frame = self.night.frame
        if picture is not None or sight != "field":
            return super().picture_words(picture, sight, drawing)
        return ["no frame yet" if frame is None else f"frame {frame.frame_id:04d}"], []

    def show_picture(self) -> None:
        """Draw the picture of the moment's frame; if there is none, the pane says so."""
        absent = "no picture of it was kept" if self.night.frame is not None else "no frame yet"
        if self.moment is None:
            absent = "" if self.folder is None else "reading …"
        self.query_one("#frame", FramePane).absent = absent
        self.query_one("#closeup", FramePane).absent = ""
        super().show_picture()

    def show_log(self) -> None:
        """Draw the log's lines up to the moment; in the opened log those of the whole night."""
        pane = self.query_one("#log", ReviewLogPane)
        pane.seq = self.seq
        pane.show(self.lines if self.is_log_open else self.night.log[-LINES:])

    @property
    def keys(self) -> list[Key]:
        """The keys that the last line shows."""
        return review_keys(
            is_playing=self.player.is_playing,
            has_live=self._live is not None,
            has_mark=self.kept is not None,
            mode=self.mode,
            keymap=self.keymap,
            has_several=len(self.night.tracks) > 1,
        )

    @property
    def mode(self) -> Mode:
        """What the keys mean now."""
        modes: dict[Mode, Mode] = {
            "log": "review log",
            "tune": "review tune",
            "tracks": "review tracks",
        }
        return modes.get(super().mode, "review")

    def place_panes(self) -> None:
        """Lay out the panes, and the field for a moment over the keys."""
        super().place_panes()
        self.query_one(MomentField).styles.offset = (0, self.size.height - 1)

    # -- the log ----------------------------------------------------------------------------

    def action_log(self) -> None:
        """Open the log of the whole night, the moment's line chosen; or close it."""
        super().action_log()
        pane = self.query_one("#log", ReviewLogPane)
        if self.is_log_open:
            pane.open_at(self.lines, self.seq)
        else:
            pane.close()
            self.show_log()

    def action_filter_log(self) -> None:
        """Ask for a text, and search the whole night's log for it."""

        def decided(wanted: str | None) -> None:
            if wanted is None:
                return
            self.searched, self.kind = wanted, FOUND if wanted else ANY
            if not self.is_log_open:
                self.action_log()
            pane = self.query_one("#log", ReviewLogPane)
            pane.filter(wanted)
            pane.choose_line_near(self.seq)
            self.show_timeline()
            count = len(self.found)
            self.say(f"{count} lines have {wanted!r}" if wanted else "log: every line")

        words = "words in any line of the night; nothing: every line"
        self.app.push_screen(LineDialog("search the log", words, self.searched), decided)

    def action_go_to_line(self) -> None:
        """Go to the moment of the log's chosen line."""
        line = self.query_one("#log", ReviewLogPane).chosen
        if line is not None:
            self.action_log()
            self.go(self.moment_seq(line))

    # -- the rest ---------------------------------------------------------------------------

    def action_tune_scope(self) -> None:
        """Compute the tuning pane's figures over all frames so far, or again over the last ones."""
        self.tune.change_figures_scope()

    def check_can_act(self) -> bool:
        """Return False and show a notice: a recorded night cannot be changed."""
        self.say("nothing is changed here: what is tried can be kept as a preset (w)")
        return False

    def answer_control_request(self, *, gives: bool) -> None:
        """Pass the answer on to the live screen behind, which has the control that is requested."""
        if self._live is not None:
            self._live.answer_control_request(gives=gives)

    def action_put_away(self) -> None:
        """Close the field or the uppermost overlay; with nothing open, pause."""
        if self.close_field():
            return
        is_bare = not (self.is_log_open or self.is_orbit_open) and self.stop_news is None
        if is_bare and self.player.is_playing:
            self.action_play()
        else:
            super().action_put_away()

    def action_leave(self) -> None:
        """Return to the live night; without one, leave the console."""
        if self._live is not None:
            self.app.pop_screen()
        else:
            self.app.exit("quit")
