"""Base of the live screen and the review: a night's panes, and the keys for the view."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from textual.app import ComposeResult
from textual.screen import Screen

from rsoconsole.console.actions.picture_actions import PictureActions
from rsoconsole.console.actions.track_actions import TracksPane
from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.dialogs.ask import LineDialog
from rsoconsole.console.drawing.pane_layout import Name
from rsoconsole.console.orbit.lines import orbit_lines
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.panes.last_line import Mode
from rsoconsole.console.panes.log_pane import LogPane
from rsoconsole.console.panes.panes import LinesPane, StopBanner
from rsoconsole.console.screens._message_list import MessageActions
from rsoconsole.console.screens._opening_actions import OpeningActions
from rsoconsole.console.screens._pane_places import PanePlacement
from rsoconsole.console.tuning.tuning_pane import TunePane
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.console.watches.watch import OutlookWatch
from rsoconsole.console.words import words
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.sky_view import sky_lines
from rsoconsole.control import AnswerControlRequest, StopNews

if TYPE_CHECKING:
    from rsoconsole.pipeline import SkyOutlook

Draw = Callable[[], None]


class ChangedPartsDrawer:
    """Drawer of a screen's changed parts; a part is drawn once for all changes by one message."""

    def __init__(self, screen: Screen[None], table: Mapping[Draw, Iterable[str]]) -> None:
        """``table``: each drawing function with the names of the reactives that it draws."""
        self._screen, self._draws = screen, tuple(table)
        self._stale: set[Draw] = set()
        for draw, names in table.items():
            for name in names:
                screen.watch(screen, name, self._watcher(draw), init=False)

    def _watcher(self, draw: Draw) -> Draw:
        def changed() -> None:
            if not self._stale:
                self._screen.call_next(self.draw)
            self._stale.add(draw)

        return changed

    def draw(self) -> None:
        """Draw the changed parts, in the order of the table."""
        stale, self._stale = self._stale, set()
        for draw in self._draws:
            if draw in stale:
                draw()

    def draw_all(self) -> None:
        """Draw every part, as for the first paint."""
        self._stale.clear()
        for draw in self._draws:
            draw()


KNOWN = ("night", "engine", "outlook", "orbit_ahead")


class NightScreen(PanePlacement, PictureActions, MessageActions, OpeningActions):
    """Base of live screen and review: the panes of a night, and the keys that only look."""

    PANES: ClassVar[tuple[Name, ...]] = (
        *("top", "alert", "frame", "closeup", "confidence", "east"),
        *("north", "axis", "nis", "facts", "sky", "strip", "log", "keys"),
    )
    LOG: ClassVar[type[LogPane]] = LogPane
    TUNE: ClassVar[type[TuneActions]] = TuneActions
    AUTO_FOCUS = None
    DEFAULT_CSS = """
    NightScreen { layers: base over; overflow: hidden; }
    NightScreen > LinesPane, NightScreen > FramePane, NightScreen > LogPane { position: absolute; }
    NightScreen > #alert { background: $error; color: $text; text-style: bold; text-wrap: wrap; }
    NightScreen > #alert.-calm { background: $panel; text-style: none; }
    NightScreen > #tune, NightScreen > #orbit, NightScreen > #curves,
    NightScreen > #tracks { layer: over; }
    NightScreen > #curves { background: $surface; }
    NightScreen > #orbit.-open { background: $surface; }
    NightScreen > #top { background: $panel; }
    NightScreen > #keys { background: $panel; layer: over; }
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.tune = self.TUNE(self)
        self.outlook_watch = OutlookWatch(
            partial(call_between_messages, self, self.update_outlook),
            partial(call_between_messages, self, partial(setattr, self, "orbit_ahead")),
        )

    def compose(self) -> ComposeResult:
        """Make every pane; ``place_panes`` lays them out."""
        yield LinesPane(id="top")
        yield LinesPane(id="alert")
        yield FramePane(self.picture_words, id="frame")
        yield FramePane(self.picture_words, id="closeup")
        for name in ("confidence", "east", "north", "axis", "nis", "facts", "sky", "strip"):
            yield LinesPane(id=name)
        yield self.LOG(id="log")
        yield LinesPane(id="orbit")
        yield LinesPane(id="curves")
        yield TracksPane(id="tracks")
        yield TunePane(id="tune")
        yield LinesPane(id="keys")
        yield StopBanner(id="stop")

    def on_mount(self) -> None:
        """Start the outlook's thread, and draw everything for the first time."""
        self.outlook_watch.start()
        self.drawn = ChangedPartsDrawer(self, self.draw_dependencies())
        self.place_panes()
        self.drawn.draw_all()

    def on_resize(self) -> None:
        """Lay the panes out for another size of the terminal."""
        self.place_panes()
        self.call_after_refresh(self._look_after_resize)

    def _look_after_resize(self) -> None:
        self.show_picture()
        self.handle_view_change()

    # -- the parts, their panes and messages --------------------------------------------------

    def on_tune_pane_wanted(self, message: TunePane.Wanted) -> None:
        """Handle a request posted by one of the tuning pane's keys."""
        message.stop()
        self.tune.handle_pane_request(message)

    def on_unmount(self) -> None:
        """End the threads that compute figures and outlook."""
        self.tune.end_figures_thread()
        self.outlook_watch.close()

    # -- what is known ----------------------------------------------------------------------

    def update_outlook(self, outlook: "SkyOutlook") -> None:
        """Take the outlook for the next hours, and draw the sky."""
        self.outlook = outlook
        self.pane("sky").show(partial(sky_lines, self.night.config, outlook))

    def draw_dependencies(self) -> dict[Draw, tuple[str, ...]]:
        """Return each drawing function with the names of the reactives that it draws.

        A STOP is drawn at once and is not among them.
        """
        return {
            self.show_picture: ("night", "picture"),
            self.show_plots: ("night",),
            self.show_log: ("night",),
            self.tune.show: ("night",),
            self.show_top: KNOWN,
            self.show_orbit: KNOWN,
            self.show_figures: KNOWN,
            self.show_alert: KNOWN,
            self.show_keys: KNOWN,
        }

    def show_log(self) -> None:
        """Draw the log."""
        is_reading = words.is_past_unread(self.night, self.engine)
        self.query_one(LogPane).show(self.night.log, is_reading=is_reading)

    def show_top(self) -> None:
        """Draw the first line."""
        self.pane("top").show(self.top_lines)

    def show_orbit(self) -> None:
        """Draw the orbit pane."""
        self.pane("orbit").show(partial(orbit_lines, self.orbit))

    def show_figures(self) -> None:
        """Draw the pane of figures."""
        lines = partial(figure_lines, self.night, self.engine, self.outlook, keymap=self.keymap)
        self.pane("facts").show(lines)

    @property
    def mode(self) -> Mode:
        """What the keys mean now, by what is open or has the focus."""
        if self.is_log_open:
            return "log"
        if isinstance(self.focused, TracksPane):
            return "tracks"
        return "tune" if isinstance(self.focused, TunePane) else "live"

    # -- keys that only look ------------------------------------------------------------------

    def show_stop(self, news: StopNews | None) -> None:
        """Show a STOP's state in the banner; None: close the banner."""
        super().show_stop(news)
        self.show_top()
        self.query_one("#stop", StopBanner).display = news is not None
        if self.is_log_open:
            self.place_panes()
        self.show_stop_words()

    def show_stop_words(self) -> None:
        """Write the state of the last STOP into the banner."""
        news = self.stop_news
        if news is not None:
            self.query_one("#stop", StopBanner).say(self.stop_words(news), news.phase)

    def stop_words(self, news: StopNews) -> str:
        """Return a STOP's state in words."""
        return f"STOP {news.text}"

    def action_log(self) -> None:
        """Give the whole screen to the log; pressed again, show the other panes."""
        self.is_log_open = not self.is_log_open
        self.place_panes()
        log = self.query_one(LogPane)
        log.can_focus = self.is_log_open
        if self.is_log_open:
            log.focus()
        else:
            self.set_focus(None)
            log.scroll_home(animate=False)
            self.forget_notice()
        self.show_keys()

    def action_orbit(self) -> None:
        """Open the orbit over the plots, or close it; an open log or tuning pane closes."""
        if self.is_log_open:
            self.action_log()
            self.is_orbit_open = False
        self.is_orbit_open = not self.is_orbit_open
        if self.is_orbit_open and self.tune.is_open:
            self.tune.close()
        if not self.is_orbit_open:
            self.forget_notice()
        self.place_panes()
        self.show_keys()

    def clear_filter(self) -> None:
        """Remove the log's filter, so that every line is shown."""
        self.query_one(LogPane).filter("")
        self.say("log: every line")

    def action_filter_log(self) -> None:
        """Ask for a text; the log then shows only lines that contain it."""
        log = self.query_one(LogPane)

        def decided(wanted: str | None) -> None:
            if wanted is None:
                return
            log.filter(wanted)
            lines = f"lines with {wanted!r}, changes of state and alarms"
            self.say(f"log: {lines if wanted else 'every line'}")

        self.app.push_screen(
            LineDialog("filter the log", "nothing: every line", log.wanted), decided
        )

    def is_picture_covered(self) -> bool:
        """True where the open orbit pane lies over the picture."""
        picture, orbit = self.picture_panes()[0], self.pane("orbit")
        is_there = self.is_orbit_open and picture.display
        return is_there and orbit.region.overlaps(picture.region)

    def action_tune(self) -> None:
        """Open or close the tuning pane; the orbit closes."""
        self.is_orbit_open = False
        self.tune.action_tune()

    def action_put_away(self) -> None:
        """Close the first open one of: log, STOP banner, orbit, page, filter, notice."""
        log = self.query_one(LogPane)
        if self.is_log_open and log.wanted and log.always_shown:
            self.clear_filter()
        elif self.is_log_open:
            self.action_log()
        elif self.stop_news is not None and self.stop_news.phase in {"stopped", "failed"}:
            self.show_stop(None)
        elif self.is_orbit_open:
            self.action_orbit()
        elif self.page is not None:
            self.show_page(None)
        elif log.wanted:
            self.clear_filter()
        else:
            self.say("")

    def action_leave(self) -> None:
        """Leave the console; a derived screen may ask first."""
        self.app.exit("quit")

    # -- whose control it is --------------------------------------------------------------------

    @property
    def control_requester(self) -> str | None:
        """The console that requests control from this one; None: no request, or no control here."""
        is_ours = bool(self.seat_name) and self.engine.seat == self.seat_name
        return self.engine.seat_asked_by if is_ours else None

    def answer_control_request(self, *, gives: bool) -> None:
        """Give control to the console that requests it; with ``gives`` False refuse the request."""
        if self.control_requester is None:
            self.say("nobody asks for control")
        else:
            self.send(AnswerControlRequest(gives=gives, to=self.control_requester))

    def action_give_seat(self) -> None:
        """Give control to the console that asks for it."""
        self.answer_control_request(gives=True)

    def action_keep_seat(self) -> None:
        """Refuse another console's request for control."""
        self.answer_control_request(gives=False)
