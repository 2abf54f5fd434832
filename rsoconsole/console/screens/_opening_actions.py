"""Keys that open something over the panes: a frame, the recorded nights, the list of streaks."""

import time
from pathlib import Path
from typing import Any

from rsoconsole.config import SessionConfig
from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.dialogs.candidates import CandidatesDialog
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.frame.sheet_actions import MarkCallbacks

ENTER_PAUSE_S = 1.0
"""Seconds after a dialog has closed during which enter opens no frame."""


class OpeningActions(OperatorScreen):
    """Opens a frame, a recorded night or the list of a frame's streaks over the panes."""

    def __init__(self, *arguments: Any, sessions_root: Path | None = None, **named: Any) -> None:
        """``sessions_root``: folder of recorded nights; None: the default one."""
        super().__init__(*arguments, **named)
        self.sessions_root = sessions_root or SessionConfig().root
        self._enter_paused_after_s = time.monotonic()
        """Monotonic time, s; after a dialog that was closed later, enter opens no frame at once."""

    @property
    def mark_callbacks(self) -> MarkCallbacks | None:
        """The callbacks by which an opened frame's screen sends marks; None: it takes no marks."""
        return None

    def action_open_frame(self) -> None:
        """Open the shown frame at full resolution."""
        if self._enter_paused_after_s < Dialog.closed_s > time.monotonic() - ENTER_PAUSE_S:
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
                status=self.top_lines,
                alert=self._alert_elsewhere,
                keymap=self.keymap,
                mark_to=self.mark_callbacks,
                seat=self,
            )
        )

    def _alert_elsewhere(self) -> str:
        """Return the alert for a screen over this one: it covers the banner of a STOP."""
        news = self.stop_news
        stopped = f"STOP {news.text}" if news else ""
        return " · ".join(part for part in (stopped, self.alert_words) if part)

    def action_sessions(self) -> None:
        """List the recorded nights; the chosen one is opened for review."""
        from rsoconsole.console.dialogs.session_list import SessionListDialog

        def decided(folder: Path | None) -> None:
            if folder is not None:
                self.open_session(folder)

        self.app.push_screen(SessionListDialog(self.sessions_root, self.night.folder), decided)

    def action_verdicts(self) -> None:
        """List every streak of the shown frame and whether it was followed."""
        if self.picture is None:
            self.say("no frame has been shown yet", "warn")
            return
        self.app.push_screen(
            CandidatesDialog([(self.picture.detail, "")], self.night.tau, self.keymap)
        )
