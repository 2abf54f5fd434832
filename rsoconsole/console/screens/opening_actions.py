"""What opens over the panes: a frame, recorded nights, what became of each streak, a filter."""

import time
from pathlib import Path
from typing import Any

from rsoconsole.config import SessionConfig
from rsoconsole.console.dialogs import Dialog, LineDialog, VerdictsDialog
from rsoconsole.console.drawing import Line
from rsoconsole.console.frame import FrameSheet, MarkTo
from rsoconsole.console.panes import LogPane
from rsoconsole.console.screens.reading import ReadingActions

DEAF_S = 1.0
"""So long enter does nothing after a dialog has closed."""


class OpeningActions(ReadingActions):
    """Each looks at the night from nearer; none changes what is shown behind it."""

    def __init__(self, *arguments: Any, sessions_root: Path | None = None, **named: Any) -> None:
        """``sessions_root``: under which recorded nights lie, None: where they do by default."""
        super().__init__(*arguments, **named)
        self.sessions_root = sessions_root or SessionConfig().root
        self._deaf_after_s = time.monotonic()
        """Enter opens no frame right behind a dialog that was closed since."""

    def top(self, width: int, rows: int) -> list[Line]:
        """State and since when, who holds the mount, the target, the frame clock."""
        raise NotImplementedError

    def action_open_frame(self) -> None:
        """The frame that is shown, at full resolution."""
        if self._deaf_after_s < Dialog.closed_s > time.monotonic() - DEAF_S:
            return  # a second enter was still meant for the dialog
        shown = self.picture or self.night.frame
        if shown is None or self.night.folder is None:
            self.say("no frame has been shown yet", "warn")
            return
        self.app.push_screen(
            FrameSheet(
                self.night.folder,
                shown.frame_id,
                self.night.config,
                status=self.top,
                alert=self._alert_elsewhere,
                keymap=self.keymap,
                mark_to=self.mark_to,
                seat=self,
            )
        )

    @property
    def mark_to(self) -> MarkTo | None:
        """Where a mark of the opened frame goes; a night that is over takes none."""
        return None

    def _alert_elsewhere(self) -> str:
        """The alert for a screen over this one, which covers what came of a STOP."""
        news = self.stop_news
        stopped = f"STOP {news.text}" if news else ""
        return " · ".join(part for part in (stopped, self.alert) if part)

    def clear_log_filter(self) -> None:
        """Every line again."""
        self.query_one("#log", LogPane).filter("")
        self.say("log: every line")

    def action_filter_log(self) -> None:
        """Only lines with some words."""

        def decided(wanted: str | None) -> None:
            if wanted is None:
                return
            self.query_one("#log", LogPane).filter(wanted)
            self.say(
                f"log: lines with {wanted!r}, changes of state and alarms"
                if wanted
                else "log: every line"
            )

        present = self.query_one("#log", LogPane).wanted
        self.app.push_screen(LineDialog("filter the log", "nothing: every line", present), decided)

    def action_sessions(self) -> None:
        """The recorded nights; the chosen one is opened for review."""
        from rsoconsole.console.dialogs import SessionListDialog

        def decided(folder: Path | None) -> None:
            if folder is not None:
                self.open_session(folder)

        self.app.push_screen(SessionListDialog(self.sessions_root, self.session_shown()), decided)

    def session_shown(self) -> Path | None:
        """The session that is looked at."""
        return self.night.folder

    def open_session(self, folder: Path) -> None:
        """Review it."""

    def action_verdicts(self) -> None:
        """Every streak of the shown frame, and what became of it."""
        if self.picture is None:
            self.say("no frame has been shown yet", "warn")
            return
        self.app.push_screen(
            VerdictsDialog([(self.picture.detail, "")], self.night.tau, self.keymap)
        )

    def action_leave(self) -> None:
        """Out of the console; a screen that has something to ask before does."""
        self.app.exit("quit")
