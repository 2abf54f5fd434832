"""The console as an application: colours, keys for all screens, session and engine watch."""

import asyncio
import contextlib
import locale
import logging
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from textual.app import App, SystemCommand
from textual.binding import Binding, BindingType
from textual.events import Event, Key
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Input, TextArea

from rsoconsole.config import ConsoleConfig, IndiConfig
from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.commands.command import KeyCommand, Place
from rsoconsole.console.commands.commands import commands_in
from rsoconsole.console.commands.keymap import Orders, bindings
from rsoconsole.console.dialogs.help import HelpDialog
from rsoconsole.console.dialogs.tour import TourDialog
from rsoconsole.console.drawing.blocks import HALF_BLOCKS, QUADRANTS, BlockSet
from rsoconsole.console.drawing.plain import (
    COLOURS,
    NIGHT_CSS,
    THEMES,
    TRACK_COLOURS,
    TRACK_CSS,
    AsciiFilter,
    ControlCharacterFilter,
)
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.night.engine_view import EngineView, alerts_between, notification_sequence
from rsoconsole.console.panes.last_line import MODE_WORDS, Mode
from rsoconsole.console.picture.picture import Picture
from rsoconsole.console.screens.live import LiveScreen
from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.screens.review import ReviewScreen
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.console.watches.watch import EngineWatch, SessionWatch
from rsoconsole.control import ControlClient, Found
from rsoconsole.night import NightView

log = logging.getLogger(__name__)

if TYPE_CHECKING:
    from rsoconsole.console.dialogs.tour import TourMemory
    from rsoconsole.console.picture.graphics import GraphicsKind

StopDirectly = Callable[[Callable[[Found], None], IndiConfig | None], None]
"""Stops the mount without the engine; takes a callback for what is found, and INDI settings."""


def is_utf8() -> bool:
    """Return True where the terminal takes more than ASCII, by the locale's encoding.

    In the locale C, Python puts UTF-8 into its own environment (PEP 538), so the environment that
    the program was started with is read.
    """
    given = _given_environment()
    said = next((given[name] for name in ("LC_ALL", "LC_CTYPE", "LANG") if given.get(name)), "")
    if said in {"C", "POSIX"}:
        return False
    # Textual writes to stderr.
    stream = sys.__stderr__
    encoding = stream.encoding if stream is not None else locale.getpreferredencoding(False)
    return encoding.upper().replace("-", "") == "UTF8"


def _given_environment() -> Mapping[str, str]:
    """Return the environment of the program's start, where the system provides it."""
    if not os.environ.get("LC_CTYPE", "").startswith("C."):
        return os.environ
    try:
        entries = Path("/proc/self/environ").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return os.environ
    return dict(entry.partition("=")[::2] for entry in entries if "=" in entry)


UNCHANGED_ROUNDS = 3
"""Rounds without another focus or screen after which what a key has set off is over."""
SETTLES_WITHIN_S = 5.0
"""Longest wait, s, of a key for what the key before it has set off."""
SEARCH_POLL_S = 0.01


def command_action(owner: Any, key: KeyCommand) -> Callable[[], Any]:
    """Return the function that runs a command; ``owner``: the application or screen that has it."""
    if key.sends is not None:
        return partial(owner.action_hand_over, key.name)
    action: Callable[[], Any] = getattr(owner, f"action_{key.name}")
    return action


class ConsoleApp(App[str]):
    """The console as a Textual application. Its result is "quit" or "stop engine"."""

    TITLE = "rsoconsole"
    CSS = TRACK_CSS + NIGHT_CSS
    BINDINGS: ClassVar[list[BindingType]] = [
        *bindings(None),
        # An x right behind the escape key.
        Binding("alt+x", "stop", "STOP", priority=True, show=False),
        # Leaving is never by accident: the screen asks first.
        Binding("ctrl+q,ctrl+c", "leave", "Leave", priority=True, show=False),
    ]

    def __init__(
        self,
        wire: Callable[[], ControlClient],
        *,
        session: Path | None = None,
        read_only: bool = False,
        stop_directly: StopDirectly | None = None,
        keymap: Mapping[str, str] | None = None,
        settings: ConsoleConfig | None = None,
        seat_name: str = "",
        graphics: "GraphicsKind | None" = None,
        blocks: BlockSet = QUADRANTS,
        review: tuple[Path | None, str] | None = None,
        sessions_root: Path | None = None,
        tour: "TourMemory | None" = None,
    ) -> None:
        """Make the application over an engine, or over one recorded session.

        ``wire``: makes a client of the engine's socket.
        ``session``: recorded session to show; None: the engine's own.
        ``read_only``: True where no command but STOP may be sent.
        ``stop_directly``: stops the mount where the engine does not.
        ``keymap``: other keys for commands, by the command's name.
        ``settings``: the console's part of the configuration.
        ``seat_name``: the engine's name for this console.
        ``graphics``: the terminal's own graphics for pictures; None: characters.
        ``blocks``: the characters that draw pictures where there are no graphics.
        ``review``: opens a review instead of the live screen: (session or None to ask for one, the
            frame or time to begin at).
        ``sessions_root``: folder of recorded nights.
        ``tour``: remembers whether the tour has been shown; None: there is no tour.
        """
        super().__init__()
        self.graphics = graphics
        self._tour = tour
        self.blocks = blocks
        self._settings = settings or ConsoleConfig()
        self._keys: deque[Key] = deque()
        """Keys that wait until what the keys before them have set off is over."""
        self._last_key: Key | None = None
        """The key that was handed over last."""
        self._is_handing_over = False
        self._last: tuple[NightView, EngineView] = (NightView(), EngineView())
        self._newest: tuple[NightView, Picture | None] | None = None
        """Newest (night, picture) not shown yet; older ones are dropped while a screen is busy."""
        self._newest_lock = threading.Lock()
        self._own_keys = dict(keymap or {})
        self._is_recorded = session is not None or review is not None
        self._engine_watch = EngineWatch(wire(), self._engine_seen)
        self._session_watch = SessionWatch(self._night_seen)
        self._session_watch.follow(session)
        past_engine = None
        if stop_directly is not None and session is None:
            directly = stop_directly

            def past_engine(on_found: Callable[[Found], None]) -> None:
                directly(on_found, self._session_watch.indi)

        self.live = LiveScreen(
            Orders(wire, past_engine),
            read_only=read_only or session is not None,
            ask_now=self._engine_watch.poll_now,
            on_known=self.ring_alerts,
            seat_name=seat_name,
            keymap=self._own_keys,
            sessions_root=sessions_root,
        )
        self.root: OperatorScreen = self.live
        """The lowest screen, under all others; it handles the STOP key."""
        if review is not None:
            self.root = ReviewScreen(
                self.live.orders,
                keymap=self._own_keys,
                sessions_root=sessions_root,
                folder=review[0],
                start=review[1],
            )

    def get_theme_variable_defaults(self) -> dict[str, str]:
        """Return the colours of the tracks' numbers, for themes that have none of their own."""
        return TRACK_COLOURS

    def on_mount(self) -> None:
        """Apply settings and themes and show the first screen, then start the watches."""
        wants_ascii = self._settings.ascii
        if wants_ascii is None:
            wants_ascii = not is_utf8()
        self._filters.append(ControlCharacterFilter())
        if wants_ascii:
            self._filters.append(AsciiFilter())
            self.graphics, self.blocks = None, HALF_BLOCKS
        loop = asyncio.get_running_loop()
        with contextlib.suppress(RuntimeError, ValueError):  # not in the main thread
            for number in (signal.SIGTERM, signal.SIGINT):
                loop.add_signal_handler(number, self.exit, "quit")
        for theme in THEMES:
            self.register_theme(theme)
        if "TEXTUAL_THEME" not in os.environ:
            self.theme = THEMES[0].name
        self.set_keymap(self._own_keys)
        self.push_screen(self.root)
        if self.root is not self.live:
            return
        self._session_watch.start()
        if self._is_recorded:
            self._engine_seen(EngineView(reach="recorded"))
        else:
            self._engine_watch.start()

    def on_unmount(self) -> None:
        """End the watches of session and engine."""
        self._engine_watch.close()
        self._session_watch.close()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Return False for STOP's letter while a text field has the focus; ctrl+x works there."""
        if action == "stop_by_letter":
            return not isinstance(self.focused, Input | TextArea)
        return super().check_action(action, parameters)

    # -- keys that arrive together ------------------------------------------------------------

    async def on_event(self, event: Event) -> None:
        """Handle an event; a key waits until what the keys before it have set off is over.

        So keys that arrive together go in their order to the field or dialog that the first of them
        opens. STOP's keys never wait.
        """
        if not isinstance(event, Key) or event.is_forwarded or self._is_stop(event.key):
            await super().on_event(event)
            return
        self._keys.append(event)
        if not self._is_handing_over:
            self._is_handing_over = True
            self.run_worker(self._hand_over_keys())

    def _is_stop(self, key: str) -> bool:
        return key in {"ctrl+x", "alt+x"} or (
            key == "x" and bool(self.check_action("stop_by_letter", ()))
        )

    async def _hand_over_keys(self) -> None:
        """Hand the waiting keys over, each to what has the focus by then."""
        while self._keys:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(SETTLES_WITHIN_S):
                    await self._settle()
            if self._keys:
                self._last_key = self._keys.popleft()
                await super().on_event(self._last_key)
        self._is_handing_over = False

    async def _settle(self) -> None:
        """Wait until what the last key has set off is over.

        Each round goes behind every message that lies between the focus and the application.
        """
        unchanged = 0
        while unchanged < UNCHANGED_ROUNDS:
            place = self._place_of_keys
            for node in place.ancestors_with_self:
                is_done = asyncio.Event()
                if node.call_later(is_done.set):
                    await is_done.wait()
            is_same = place is self._place_of_keys
            unchanged = unchanged + 1 if is_same and not self._is_searching else 0
            if self._is_searching:
                await asyncio.sleep(SEARCH_POLL_S)

    @property
    def _place_of_keys(self) -> Widget:
        """The widget with the focus; without one the uppermost screen."""
        focused = self.focused
        return self.screen if focused is None else focused

    @property
    def _is_searching(self) -> bool:
        """True while the list of commands is being searched for what was typed."""
        return any(each.node is self.screen and each.is_running for each in self.workers)

    @property
    def night_screen(self) -> NightScreen:
        """The uppermost screen that shows a night, live or review, even below a dialog."""
        screens = [screen for screen in self.screen_stack if isinstance(screen, NightScreen)]
        return screens[-1] if screens else self.live

    @property
    def place(self) -> Place:
        """Kind of the uppermost screen that shows a night: live or review."""
        return "review" if isinstance(self.night_screen, ReviewScreen) else "live"

    def get_system_commands(self, screen: Screen[Any]) -> Iterable[SystemCommand]:
        """Yield every command by name for the palette; those of an opened frame come first."""
        if isinstance(screen, FrameSheet):
            yield from screen.system_commands()
        for command in commands_in(self.place):
            if command.name in {"stop_by_letter", "put_away"}:
                continue
            if command.acts and self.live.read_only:
                continue
            owner = self if command.is_everywhere else self.night_screen
            action = command_action(owner, command)
            yield SystemCommand(command.title, command.help, action)

    @property
    def failure(self) -> Exception | None:
        """The exception that ended the console; None where it ended by a command."""
        return self._exception

    def _fatal_error(self) -> None:
        """Keep the exception; the terminal is restored, and the console's caller reports it."""
        log.error("the console broke", exc_info=self._exception)
        self.bell()
        self._close_messages_no_wait()

    async def action_quit(self) -> None:
        """Leave as the uppermost screen provides; Textual's own quit command runs this too."""
        self.action_leave()

    def action_stop(self) -> None:
        """Send STOP, from whatever screen is shown; what was typed before it is dropped."""
        self._keys.clear()
        if self._last_key is not None:
            self._last_key.stop()
        self.root.stop()

    action_stop_by_letter = action_stop

    def action_help(self) -> None:
        """Show the help: keys, signs and terms.

        The first time it is the tour instead, unless the keys have another meaning now (in a pane,
        or while marking).
        """
        if isinstance(self.screen, HelpDialog | TourDialog):
            return
        has_own_keys = bool(MODE_WORDS[self._mode])
        if self._tour is not None and self._tour.is_due and not has_own_keys:
            self._tour.record_tour_shown()
            self._show_tour()
        else:
            self._show_help()

    @property
    def _mode(self) -> Mode:
        """Present meaning of the keys."""
        return self.screen.mode if isinstance(self.screen, FrameSheet) else self.night_screen.mode

    def _show_help(self) -> None:
        mode = self._mode

        def decided(wanted: str | None) -> None:
            if wanted == "tour":
                self._show_tour()

        self.push_screen(HelpDialog(self._own_keys, mode, self.place), decided)

    def _show_tour(self) -> None:
        def decided(wants_help: bool | None) -> None:
            if wants_help:
                self._show_help()

        self.push_screen(TourDialog(self._own_keys), decided)

    def action_suspend(self) -> None:
        """Suspend the console to the shell, as ctrl+z does for other programs."""
        self.action_suspend_process()

    def action_colours(self) -> None:
        """Use the next theme: dark, night, the terminal's own two, light."""
        names = [theme for theme in COLOURS if theme in self.available_themes]
        at = names.index(self.theme) if self.theme in names else -1
        self.theme = names[(at + 1) % len(names)]
        self.night_screen.say(f"colours: {COLOURS[self.theme]}")

    def action_leave(self) -> None:
        """Close an opened frame, then leave as the uppermost screen provides, which may ask
        first.
        """
        if isinstance(self.screen, FrameSheet):
            self.pop_screen()
        screen = self.screen
        if isinstance(screen, NightScreen):
            screen.action_leave()

    def ring_alerts(self, night: NightView, engine: EngineView) -> None:
        """Ring the bell or send a notification for what has changed since the previous call."""
        before, self._last = self._last, (night, engine)
        for alert, words in alerts_between(before, self._last):
            if alert in self._settings.bell:
                self.bell()
            if alert in self._settings.notify and self._driver is not None:
                self._driver.write(notification_sequence(words))

    def _night_seen(self, night: NightView, picture: Picture | None) -> None:
        with self._newest_lock:
            is_waiting, self._newest = self._newest is not None, (night, picture)
        if not is_waiting:
            call_between_messages(self.live, self._show_newest)

    def _show_newest(self) -> None:
        with self._newest_lock:
            newest, self._newest = self._newest, None
        if newest is not None:
            self.live.update_night(*newest)

    def _engine_seen(self, engine: EngineView) -> None:
        self._session_watch.follow(engine.session)
        call_between_messages(self.live, self.live.update_engine, engine)
