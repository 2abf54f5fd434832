"""Computes on a thread of its own what the night would have been with what is being tried."""

import logging
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.config import Config
from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, Value
from rsoconsole.errors import RsoconsoleError
from rsoconsole.pipeline.replay import LogOfOneSession, Question, WhatIfProcess
from rsoconsole.words import NO_EFFECT

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures

log = logging.getLogger(__name__)


class WhatIfWatch:
    """Takes the newest question only; an older one that is still being computed is dropped.

    What was recorded is added up here; what is tried is computed in a process of its own.
    """

    def __init__(
        self, on_seen: Callable[["TrackFigures | None", "TrackFigures | None", str], None]
    ) -> None:
        """``on_seen``: hears the figures as recorded, those with what is tried, and a fault."""
        self._on_seen = on_seen
        self._asked: Question | None = None
        self._wake = threading.Event()
        self._is_closing = False
        self._log, self._process = LogOfOneSession(), WhatIfProcess()
        self._thread: threading.Thread | None = None

    def ask(
        self,
        folder: Path,
        config: Config,
        changes: Mapping[str, Value],
        *,
        until_seq: int | None = None,
        last: int | None = LAST_FRAMES,
    ) -> None:
        """Compute with these settings tried (any thread).

        ``until_seq``: as of that place of the log, None: its end; ``last``: over how many frames,
        None: over all.
        """
        self._asked = Question(
            folder=folder,
            config=config,
            changes=dict(changes),
            until_seq=until_seq,
            last=last,
            of_lead=True,
        )
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="console-what-if", daemon=True)
            self._thread.start()
        self._wake.set()

    def prepare(self) -> None:
        """Start what computes trials, before there is one: its libraries take seconds to load."""
        starting = threading.Thread(
            target=self._process.start, name="console-what-if-start", daemon=True
        )
        starting.start()

    def close(self) -> None:
        """End."""
        self._is_closing = True
        self._wake.set()
        self._process.close()

    def _run(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._is_closing:
                return
            asked, self._asked = self._asked, None
            if asked is None:
                continue
            try:
                self._answer(asked)
            except RsoconsoleError as error:
                if not self._is_closing:
                    self._on_seen(None, None, str(error))
            except Exception as error:  # the seat must hear of it, whatever it is
                log.exception(NO_EFFECT)
                self._on_seen(None, None, f"{NO_EFFECT}: {error}")

    def _answer(self, asked: Question) -> None:
        from rsoconsole.night import as_recorded

        records = self._log.until(asked.folder, asked.until_seq)
        now = as_recorded(records, asked.last, of_lead=asked.of_lead)
        then = self._process.ask(asked) if asked.changes else None
        if self._asked is None and not self._is_closing:
            self._on_seen(now, then, "")
