"""The panes over one instant of a night, and the keys that only look: live and review have them."""

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

from textual import events
from textual.app import ComposeResult

from rsoconsole.console.actions import TracksPane
from rsoconsole.console.commands import BY_NAME, first_key
from rsoconsole.console.drawing import (
    MOST_ALERT_ROWS,
    Box,
    Line,
    Name,
    banner_box,
    fold,
    has_tune_of_its_own,
    orbit_box,
    sky_lines,
    tune_box,
)
from rsoconsole.console.orbit import OrbitShown, orbit_lines, orbit_shown, target_words
from rsoconsole.console.panes import (
    FramePane,
    Key,
    LinesPane,
    LogPane,
    Mode,
    StopBanner,
    key_at,
    key_line,
    notice_rows,
)
from rsoconsole.console.picture import Drawing, Picture
from rsoconsole.console.screens.picture_actions import PictureActions
from rsoconsole.console.tuning import TunePane
from rsoconsole.console.watches import OrbitSeen, OutlookSeen
from rsoconsole.console.words import fact_lines, kept_words, words
from rsoconsole.control import StopNews

DEFAULT_ASPECT = 4 / 3


class NightScreen(PictureActions):
    """Shows a night as it is at one instant; which one, and what may be done, its heirs say."""

    PANES: ClassVar[tuple[Name, ...]] = (
        *("top", "alert", "frame", "closeup", "confidence", "east"),
        *("north", "axis", "nis", "facts", "sky", "log", "keys"),
    )
    LOG: ClassVar[type[LogPane]] = LogPane
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
        self.is_log_open = False
        self.is_orbit_open = False
        self._drawn_keys: tuple[list[Key], str] = ([], "")
        """The keys and the notice that the last line shows."""
        self._rows_of_alert = 0
        """For which the panes have been laid out."""
        self.on_plots_made()

    def compose(self) -> ComposeResult:
        """Every pane; where each lies depends on the terminal."""
        yield LinesPane(id="top")
        yield LinesPane(id="alert")
        yield FramePane(self.picture_words, id="frame")
        yield FramePane(self.picture_words, id="closeup")
        for name in ("confidence", "east", "north", "axis", "nis", "facts", "sky"):
            yield LinesPane(id=name)
        yield self.LOG(id="log")
        yield LinesPane(id="orbit")
        yield LinesPane(id="curves")
        yield TracksPane(id="tracks")
        yield TunePane(id="tune")
        yield LinesPane(id="keys")
        yield StopBanner(id="stop")

    def on_mount(self) -> None:
        """First paint."""
        self.place_panes()
        self.show_night()
        self.show_engine()

    def on_resize(self) -> None:
        """Another terminal, other places."""
        self.place_panes()
        self.call_after_refresh(self._look_after_resize)

    def _look_after_resize(self) -> None:
        self.show_picture()
        self.look_again()

    @property
    def drawing(self) -> Drawing | None:
        """How the large pane's picture is drawn; None while nothing is."""
        return self.query_one("#frame", FramePane).drawing

    # -- what is known ----------------------------------------------------------------------

    def on_outlook_seen(self, message: OutlookSeen) -> None:
        """What the next hours bring."""
        self.outlook = message.outlook
        self.pane("sky").show(partial(sky_lines, self.night.config, self.outlook))
        self.show_engine()

    def on_orbit_seen(self, message: OrbitSeen) -> None:
        """Where the orbit leads."""
        self.orbit_ahead = message.ahead
        self.show_engine()

    @property
    def orbit(self) -> OrbitShown:
        """What is known of the orbit."""
        return orbit_shown(self.night, self.engine, self.orbit_ahead)

    def show_night(self) -> None:
        """What the record says."""
        self.show_picture()
        self.show_plots()
        self.show_log()
        self.show_tuning()

    def show_log(self) -> None:
        """The lines of the log."""
        is_reading = words.is_past_unread(self.night, self.engine)
        self.query_one("#log", LogPane).show(self.night.log, is_reading=is_reading)

    def show_engine(self) -> None:
        """What the engine says, and what both together do."""
        night, engine = self.night, self.engine
        self.pane("top").show(self.top)
        self.pane("orbit").show(partial(orbit_lines, self.orbit))
        self.pane("facts").show(
            partial(fact_lines, night, engine, self.outlook, keymap=self.keymap)
        )
        alert = self.alert or self.intro
        self.pane("alert").set_class(not self.alert, "-calm")
        if self.alert_rows() != self._rows_of_alert:
            self.place_panes()
            self.call_after_refresh(self.look_again)
        cut = f"… ({first_key('read', self.keymap)} shows all) …"
        self.pane("alert").show(
            lambda width, height: words.wrapped(f" {alert}", width, height, cut)
        )
        self.show_keys()

    def top(self, width: int, rows: int) -> list[Line]:
        """State and since when, who holds the mount, the target, the frame clock."""
        night, engine, found = self.night, self.engine, target_words(self.orbit)
        now, is_asked_for = words.present_utc_ns(night, engine), self.is_following_again
        kept = kept_words(engine, self.keymap, now, is_asked_for=is_asked_for)
        return words.top_lines(
            night,
            engine,
            self.read_only,
            width,
            rows,
            found=found,
            kept=kept,
            is_stopping=self.is_stopping,
        )

    @property
    def alert(self) -> str:
        """What must not be missed."""
        return words.alert_text(self.night, self.engine)

    @property
    def intro(self) -> str:
        """What stands in the alert's place while there is none; empty as a rule."""
        return ""

    def alert_rows(self) -> int:
        """How many rows the alert, or what stands in its place, takes."""
        alert = self.alert or self.intro
        return len(words.wrapped(f" {alert}", self.size.width, MOST_ALERT_ROWS)) if alert else 0

    def show_keys(self) -> None:
        """The keys that matter now, and a word about what was just done."""
        self._drawn_keys = self.keys, self.notice[0]
        self._place_keys()
        self.pane("keys").show(key_line(self.keys, self.notice))

    def _place_keys(self) -> None:
        """The last line, and what is said over it."""
        pane, (width, height) = self.pane("keys"), self.size
        rows = 1 + notice_rows(self.notice[0], width, height)
        if pane.styles.height is None or pane.styles.height.value != rows:
            pane.styles.height = rows
            pane.styles.offset = (0, height - rows)

    @property
    def keys(self) -> list[Key]:
        """The keys that matter now."""
        return []

    async def on_click(self, event: events.Click) -> None:
        """A key of the last line, by the mouse."""
        pane = self.pane("keys")
        if event.widget is not pane or event.y != pane.size.height - 1:
            return
        keys, notice = self._drawn_keys
        key = key_at(keys, notice if pane.size.height == 1 else "", pane.size.width, event.x)
        if key is not None and key.command:
            is_apps = BY_NAME[key.command].is_everywhere
            self.is_click = True
            try:
                await self.run_action(f"app.{key.command}" if is_apps else key.command)
            finally:
                self.is_click = False

    @property
    def mode(self) -> Mode:
        """What the keys are for."""
        if self.is_log_open:
            return "log"
        if isinstance(self.focused, TracksPane):
            return "tracks"
        return "tune" if isinstance(self.focused, TunePane) else "live"

    # -- where it lies ----------------------------------------------------------------------

    def place_panes(self) -> None:
        """Where each pane lies, for this terminal."""
        width, height = self.size
        alert_rows = self._rows_of_alert = self.alert_rows()
        boxes = fold(
            width,
            height,
            alert_rows=alert_rows,
            is_log_open=self.is_log_open,
            timeline_rows=self.timeline_rows(height),
            aspect=self.aspect_of(self.picture),
        )
        for name in self.PANES:
            widget, box = self.query_one(f"#{name}"), boxes.get(name)
            widget.display = box is not None
            if box is not None:
                widget.styles.offset = (box.x, box.y)
                widget.styles.width, widget.styles.height = box.width, box.height
        self._place_keys()
        self._place_orbit(boxes.get("orbit"), alert_rows)
        self.place_curves(
            alert_rows=alert_rows,
            timeline_rows=self.timeline_rows(height),
            aspect=self.aspect_of(self.picture),
        )
        tune = self.query_one("#tune", TunePane)
        has_own = has_tune_of_its_own(width, height)
        tune.display = (self.is_tune_open or has_own) and not self.is_log_open
        if tune.display:
            place = tune_box(
                width,
                height,
                alert_rows=alert_rows,
                timeline_rows=self.timeline_rows(height),
                aspect=self.aspect_of(self.picture),
            )
            tune.styles.offset = (place.x, place.y)
            tune.styles.width, tune.styles.height = place.width, place.height
            self._make_room(boxes, place)
        banner, box = self.query_one("#stop"), banner_box(width, height, alert_rows=alert_rows)
        banner.styles.height = box.height
        banner.styles.offset = (0, box.y)

    def _make_room(self, boxes: Mapping[Name, Box], over: Box) -> None:
        """What reaches beneath the tuning pane from its left ends before it: no word is cut."""
        box = boxes.get("facts")
        if box is None or not box.x < over.x < box.x + box.width:
            return
        if box.y < over.y + over.height and over.y < box.y + box.height:
            self.query_one("#facts").styles.width = over.x - box.x

    def _place_orbit(self, standing: Box | None, alert_rows: int) -> None:
        """Over the plots when it is opened; else where it always stands, if it does."""
        (width, height), box = self.size, standing
        is_open = self.is_orbit_open and not self.is_log_open
        if is_open:
            box = orbit_box(
                width,
                height,
                alert_rows=alert_rows,
                timeline_rows=self.timeline_rows(height),
                aspect=self.aspect_of(self.picture),
            )
        pane = self.pane("orbit")
        pane.display = box is not None
        pane.set_class(is_open, "-open")
        if box is not None:
            pane.styles.offset = (box.x, box.y)
            pane.styles.width, pane.styles.height = box.width, box.height

    def timeline_rows(self, height: int) -> int:
        """How many rows over the keys a time line takes, in a terminal of so many lines."""
        _ = height
        return 0

    def covers_plots(self) -> bool:
        """The log, an open orbit and a tuning pane without a place of its own do."""
        has_own = has_tune_of_its_own(*self.size)
        return self.is_log_open or self.is_orbit_open or (self.is_tune_open and not has_own)

    @staticmethod
    def aspect_of(picture: Picture | None) -> float:
        """Of the camera's frames: width over height."""
        return picture.aspect if picture is not None else DEFAULT_ASPECT

    # -- keys that only look ------------------------------------------------------------------

    def show_stop(self, news: StopNews | None) -> None:
        """What came of a STOP, over everything else."""
        super().show_stop(news)
        self.pane("top").show(self.top)
        banner = self.query_one("#stop", StopBanner)
        banner.display = news is not None
        if news is None:
            return
        banner.set_class(news.phase == "stopped", "-stopped")
        self.show_stop_words()

    def show_stop_words(self) -> None:
        """In the banner; nothing where there is none."""
        news = self.stop_news
        if news is None:
            return
        ending = "  (esc)" if news.phase in {"stopped", "failed"} else ""
        text = f"{self.stop_words(news)}{ending}"
        banner = self.query_one("#stop", StopBanner)
        banner.show(lambda width, height: words.wrapped(text, width, height))

    def stop_words(self, news: StopNews) -> str:
        """What came of a STOP."""
        return f"STOP {news.text}"

    def action_log(self) -> None:
        """All panes to the log, and back."""
        self.is_log_open = not self.is_log_open
        self.place_panes()
        log = self.query_one("#log", LogPane)
        log.can_focus = self.is_log_open
        if self.is_log_open:
            log.focus()
        else:
            self.set_focus(None)
            log.scroll_home(animate=False)
            self.forget_notice()
        self.show_keys()

    def action_orbit(self) -> None:
        """Over the plots, and back; a log or a tuning pane that lies there gives way."""
        if self.is_log_open:
            self.action_log()
            self.is_orbit_open = False
        self.is_orbit_open = not self.is_orbit_open
        if self.is_orbit_open and self.is_tune_open:
            self.close_tune()
        if not self.is_orbit_open:
            self.forget_notice()
        self.place_panes()
        self.show_keys()

    def covers_picture(self) -> bool:
        """Whether an open orbit lies over it."""
        picture, orbit = self.query_one("#frame"), self.pane("orbit")
        is_there = self.is_orbit_open and picture.display
        return is_there and orbit.region.overlaps(picture.region)

    def action_tune(self) -> None:
        """Where the orbit lay."""
        self.is_orbit_open = False
        super().action_tune()

    def action_put_away(self) -> None:
        """The log first, what came of a STOP, the orbit, a page of curves, the filter, a notice."""
        log = self.query_one("#log", LogPane)
        if self.is_log_open and log.wanted and log.always_shown:
            self.clear_log_filter()
        elif self.is_log_open:
            self.action_log()
        elif self.stop_news is not None and self.stop_news.phase in {"stopped", "failed"}:
            self.show_stop(None)
        elif self.is_orbit_open:
            self.action_orbit()
        elif self.page is not None:
            self.show_page(None)
        elif log.wanted:
            self.clear_log_filter()
        else:
            self.say("")

    def text(self) -> str:
        """Every shown pane's words, for anyone who cannot see the terminal."""
        return "\n".join(pane.text for pane in self.query(LinesPane) if pane.display)
