"""Screens opened over the panes: a frame, recorded nights, the outcome of each streak."""

import time
from pathlib import Path
from typing import Any

from rsoconsole.config import SessionConfig
from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.dialogs.candidates import CandidatesDialog
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.frame.sheet_actions import MarkCallbacks

ENTER_PAUSE_S = 1.0
"""Seconds after a dialog has closed during which enter opens no frame."""


class OpeningActions(Seat):
    """Opens a frame, a recorded night or the streaks of a frame over the panes."""

    def __init__(self, *arguments: Any, sessions_root: Path | None = None, **named: Any) -> None:
        """``sessions_root``: folder of recorded nights, None: the default one."""
        super().__init__(*arguments, **named)
        self.sessions_root = sessions_root or SessionConfig().root
        self._enter_paused_after_s = time.monotonic()
        """Monotonic time in seconds; only dialogs closed after it delay enter."""

    @property
    def mark_callbacks(self) -> MarkCallbacks | None:
        """Callbacks for a mark of the opened frame; None: a night that is over takes none."""
        return None

    def action_open_frame(self) -> None:
        """Open the frame that is shown, at full resolution."""
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
                status=self.top,
                alert=self._alert_elsewhere,
                keymap=self.keymap,
                mark_to=self.mark_callbacks,
                seat=self,
            )
        )

    def _alert_elsewhere(self) -> str:
        """Return the alert for a screen over this one, which covers a STOP's outcome."""
        news = self.stop_news
        stopped = f"STOP {news.text}" if news else ""
        return " · ".join(part for part in (stopped, self.alert) if part)

    def action_sessions(self) -> None:
        """List the recorded nights; the chosen one is opened for review."""
        from rsoconsole.console.dialogs.session_list import SessionListDialog

        def decided(folder: Path | None) -> None:
            if folder is not None:
                self.open_session(folder)

        self.app.push_screen(SessionListDialog(self.sessions_root, self.night.folder), decided)

    def action_verdicts(self) -> None:
        """List every streak of the shown frame, and its outcome."""
        if self.picture is None:
            self.say("no frame has been shown yet", "warn")
            return
        self.app.push_screen(
            CandidatesDialog([(self.picture.detail, "")], self.night.tau, self.keymap)
        )
