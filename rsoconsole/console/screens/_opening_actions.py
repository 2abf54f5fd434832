"""What opens over the panes: a frame, recorded nights, what became of each streak."""

import time
from collections.abc import Callable
from pathlib import Path

from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.dialogs.candidates import CandidatesDialog
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.frame.sheet_actions import MarkTo

DEAF_S = 1.0
"""So long enter does nothing after a dialog has closed."""


class OpeningActions:
    """Each looks at the night from nearer; none changes what is shown behind it."""

    def __init__(
        self, seat: Seat, sessions_root: Path, mark_to: Callable[[], MarkTo | None]
    ) -> None:
        """``sessions_root``: under which recorded nights lie; ``mark_to``: where a mark of the
        opened frame goes."""
        self._seat, self._sessions_root, self._mark_to = seat, sessions_root, mark_to
        self._deaf_after_s = time.monotonic()
        """Enter opens no frame right behind a dialog that was closed since."""

    def action_open_frame(self) -> None:
        """The frame that is shown, at full resolution."""
        if self._deaf_after_s < Dialog.closed_s > time.monotonic() - DEAF_S:
            return  # a second enter was still meant for the dialog
        shown = self._seat.picture or self._seat.night.frame
        if shown is None or self._seat.night.folder is None:
            self._seat.say("no frame has been shown yet", "warn")
            return
        self._seat.ask(
            FrameSheet(
                self._seat.night.folder,
                shown.frame_id,
                self._seat.night.config,
                status=self._seat.top,
                alert=self._alert_elsewhere,
                keymap=self._seat.keymap,
                mark_to=self._mark_to(),
                seat=self._seat,
            )
        )

    def _alert_elsewhere(self) -> str:
        """The alert for a screen over this one, which covers what came of a STOP."""
        news = self._seat.stop_news
        stopped = f"STOP {news.text}" if news else ""
        return " · ".join(part for part in (stopped, self._seat.alert) if part)

    def action_sessions(self) -> None:
        """The recorded nights; the chosen one is opened for review."""
        seat = self._seat
        from rsoconsole.console.dialogs.session_list import SessionListDialog

        def decided(folder: Path | None) -> None:
            if folder is not None:
                seat.open_session(folder)

        seat.ask(SessionListDialog(self._sessions_root, seat.night.folder), decided)

    def action_verdicts(self) -> None:
        """Every streak of the shown frame, and what became of it."""
        seat = self._seat
        if seat.picture is None:
            seat.say("no frame has been shown yet", "warn")
            return
        seat.ask(CandidatesDialog([(seat.picture.detail, "")], seat.night.tau, seat.keymap))
