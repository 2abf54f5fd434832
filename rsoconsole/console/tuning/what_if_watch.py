"""The thread for figures with changed settings, and the quality of the lead track."""

import logging
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config, FilterConfig
from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, TuneFigures
from rsoconsole.console.words.tunable import NAMES, Value
from rsoconsole.control import Poller
from rsoconsole.night import (
    FilterQuality,
    FilterUpdate,
    FrameRow,
    NightView,
    filter_quality,
)
from rsoconsole.pipeline import SessionLogCache, WhatIfProcess, WhatIfQuestion
from rsoconsole.tracking import lag_one_correlation, settle
from rsoconsole.words import NO_EFFECT

log = logging.getLogger(__name__)

FILTER = "filter."
"""Beginning of the names of the filter's settings."""
IDLE_S = 60.0
"""Most seconds between two looks for a question; a question wakes the thread at once."""


class WhatIfWatch(Poller):
    """Thread that computes the figures of the newest request, dropping older ones.

    The figures as recorded are computed on the thread, those with changed settings in a separate
    process.
    """

    def __init__(
        self,
        on_seen: Callable[[TuneFigures, str], None],
        on_proposal: Callable[[Mapping[str, Value], str], None],
    ) -> None:
        """Store what is called with each result.

        ``on_seen``: with the figures and a fault, as often as more is known; ``on_proposal``: with
        proposed settings and the verdict in words.
        """
        super().__init__("what-if", IDLE_S)
        self._on_seen, self._on_proposal = on_seen, on_proposal
        self._asked: WhatIfQuestion | None = None
        self._in_force: FilterConfig | None = None
        self._log, self._process = SessionLogCache(), WhatIfProcess()

    def ask(
        self,
        folder: Path,
        config: Config,
        changes: Mapping[str, Value],
        *,
        in_force: FilterConfig | None = None,
        until_seq: int | None = None,
        last: int | None = LAST_FRAMES,
    ) -> None:
        """Request the figures with changed settings; may be called from any thread.

        ``in_force``: the filter's settings at present; None: those of the newest frames.
        ``until_seq``: last place of the log to use; None: the log's end.
        ``last``: number of last frames to use; None: all.
        """
        self._in_force = in_force
        self._asked = WhatIfQuestion(
            folder=folder,
            config=config,
            changes=dict(changes),
            until_seq=until_seq,
            last=last,
            of_lead=True,
        )
        if not (self.is_running or self._is_closing):
            self.start()
        self.poll_now()

    def propose(self, folder: Path, config: Config) -> None:
        """Request the likeliest Q and R of a session; it takes a while, figures wait."""
        self._asked = WhatIfQuestion(folder=folder, config=config, changes={}, proposes=True)
        if not (self.is_running or self._is_closing):
            self.start()
        self.poll_now()

    def prepare(self) -> None:
        """Start the process before any request, since its libraries take seconds to load."""
        threading.Thread(target=self._process.start, name="what-if-start", daemon=True).start()

    def close(self) -> None:
        """End thread and process."""
        self._is_closing = True
        self._process.close()
        super().close()

    def _look(self) -> None:
        asked, self._asked = self._asked, None
        if asked is None or self._is_closing:
            return
        try:
            self._answer(asked)
        except RsoconsoleError as error:
            if not self._is_closing:
                self._on_seen(TuneFigures(), str(error))
        except Exception as error:  # the seat must hear of it, whatever it is
            log.exception(NO_EFFECT)
            self._on_seen(TuneFigures(), f"{NO_EFFECT}: {error}")

    def _answer(self, asked: WhatIfQuestion) -> None:
        from rsoconsole.night import lead_figures

        if asked.proposes:
            found = self._process.propose(asked)
            self._on_proposal(found.changes, found.words)
            return
        records = self._log.records_until(asked.folder, asked.until_seq)
        now, newest = lead_figures(records, asked.config, asked.last)
        figures = TuneFigures(now=now)
        if newest is not None:
            settings = self._in_force or newest.update.settings
            changed = {n: v for n, v in asked.changes.items() if n.startswith(FILTER)}
            changed = {name.removeprefix(FILTER): value for name, value in changed.items()}
            after = settings.model_copy(update=changed)
            figures = figures._replace(
                settled=settle(newest.update, settings, newest.cadence_s),
                settled_then=settle(newest.update, after, newest.cadence_s),
            )
        if asked.changes:
            self._show(figures)  # the process takes its time
            figures = figures._replace(then=self._process.ask(asked))
        self._show(figures)

    def _show(self, figures: TuneFigures) -> None:
        if self._asked is None and not self._is_closing:
            self._on_seen(figures, "")


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackQuality(FilterQuality):
    """Figures of the lead track over its last frames: filter quality, frames, misses."""

    frames: int
    misses: int
    lag_one: float | None
    """Correlation of each residual, in its sigmas, with the next; None: too few residuals."""

    @property
    def lag_one_bound(self) -> float:
        """Bound that the ``lag_one`` of a consistent filter exceeds in 5 % of cases."""
        return 2.0 / math.sqrt(self.updates)


def track_quality(night: NightView, last: int = LAST_FRAMES) -> TrackQuality | None:
    """Return the lead track's quality over its last frames; None before its first update."""
    rows = lead_track_frames(night, last)
    updates = [
        FilterUpdate(row.residual_arcsec, row.sigma_arcsec, row.nis)
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
        **asdict(filter_quality(updates)),
        frames=len(rows),
        misses=sum(row.miss is not None for row in rows),
        lag_one=lag_one_correlation(in_sigmas),
    )


def lead_track_frames(night: NightView, last: int = LAST_FRAMES) -> list[FrameRow]:
    """Return the last ``last`` processed frames that were pointed at the lead track."""
    first = night.track_frame_id if night.track is not None else 0
    own = (row for row in night.rows if row.frame_id >= first)
    return [row for row in own if row.was_sought and row.is_reduced][-last:]


def count_present_settings_frames(night: NightView, last: int) -> int:
    """Return how many of the lead's last frames were processed with the settings in force now."""
    now = {name: night.setting(name) for name in NAMES}
    return sum(
        all(night.setting(name, row.settings) == value for name, value in now.items())
        for row in lead_track_frames(night, last)
    )
