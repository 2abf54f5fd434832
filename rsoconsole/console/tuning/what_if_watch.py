"""Computes on a thread of its own what the night would have been with what is being tried."""

import logging
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, NAMES, Value
from rsoconsole.night import FrameRow, NightView, Quality, Update, quality_of
from rsoconsole.pipeline import LogOfOneSession, Question, WhatIfProcess
from rsoconsole.tracking import lag_one
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


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackQuality(Quality):
    """Of the frames in which it was looked for."""

    frames: int
    misses: int
    lag_one: float | None
    """Correlation of each residual, in its sigmas, with the next: None where there are too few."""

    @property
    def lag_one_bound(self) -> float:
        """Within which that lies for a sound filter, 95 times in 100."""
        return 2.0 / math.sqrt(self.updates)


def track_quality(night: NightView, last: int = LAST_FRAMES) -> TrackQuality | None:
    """Of the lead's last frames; None before it has been measured against a prediction."""
    rows = frames_of_track(night, last)
    updates = [
        Update(row.residual_arcsec, row.sigma_arcsec, row.nis)
        for row in rows
        if row.residual_arcsec is not None and row.nis is not None
    ]
    if night.track is None or not updates:
        return None
    in_sigmas = [
        (each.residual_arcsec[0] / sigma[0], each.residual_arcsec[1] / sigma[1])
        for each in updates
        if (sigma := each.sigma_arcsec) is not None and min(sigma) > 0.0
    ]
    return TrackQuality(
        **asdict(quality_of(updates)),
        frames=len(rows),
        misses=sum(row.miss is not None for row in rows),
        lag_one=lag_one(in_sigmas),
    )


def frames_of_track(night: NightView, last: int = LAST_FRAMES) -> list[FrameRow]:
    """The lead's last frames: processed, and pointed at it. The tuning pane shows these."""
    first = night.track_frame_id if night.track is not None else 0
    own = (row for row in night.rows if row.frame_id >= first)
    return [row for row in own if row.was_sought and row.is_reduced][-last:]


def of_settings_now(night: NightView, last: int) -> int:
    """How many of those frames were processed with what is in force now, whenever that was."""
    now = {name: night.setting(name) for name in NAMES}
    return sum(
        all(night.setting(name, row.settings) == value for name, value in now.items())
        for row in frames_of_track(night, last)
    )
