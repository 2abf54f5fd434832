"""Threads that watch the session, the engine and the outlook, one each.

Their results go to a callback, which must return at once. An engine that hangs does not block the
reading of the session.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.base import ControlError, SessionError
from rsoconsole.config import Config, IndiConfig
from rsoconsole.console.night.engine_view import (
    EngineView,
    OrbitPrediction,
    predict_orbit,
    read_engine_view,
)
from rsoconsole.console.picture.marks import frame_marks
from rsoconsole.console.picture.picture import Picture, read_closeup, read_picture
from rsoconsole.control import AskStatus, ControlClient, Poller
from rsoconsole.night import Night, NightView
from rsoconsole.session import SessionReader
from rsoconsole.sky import separation_deg
from rsoconsole.words import NOT_SHOWN

log = logging.getLogger(__name__)

READ_S = 0.25
ASK_S = 0.5
ANSWER_S = 1.0
STARTING_S = 30.0
"""Seconds without an answer after which an engine that was to start counts as gone."""
SHOW_WHILE_READING_S = 0.3
CLOSED_CHECK_S = 2.0


class SessionWatch(Poller):
    """Thread that reads a growing session and its newest picture, four times a second."""

    def __init__(self, on_seen: Callable[[NightView, Picture | None], None]) -> None:
        super().__init__("session", READ_S)
        self._on_seen = on_seen
        self._wanted: Path | None = None
        self._reader: SessionReader | None = None
        self._night: Night | None = None
        self._seq = 0
        self._picture: Picture | None = None
        self._closed_seen_s = 0.0
        self._has_fault = False
        self.indi: IndiConfig | None = None
        """Settings by which the session's engine reaches its instruments; None until read."""

    def follow(self, folder: Path | None) -> None:
        """Read this folder's session from now on (None: no change); callable from any thread."""
        if folder is not None and folder != self._wanted:
            self._wanted = folder
            self.poll_now()

    def _look(self) -> None:
        try:
            self._read()
            if self._has_fault:
                self._has_fault = False
                self._show()
        except SessionError as error:
            self._say_fault(str(error))
        except Exception as error:  # the seat must go on, whatever lies in the folder
            log.exception(NOT_SHOWN)
            self._say_fault(f"{NOT_SHOWN}: {error}")

    def _read(self) -> None:
        wanted = self._wanted
        if wanted is None:
            return
        reader, night = self._reader, self._night
        if reader is None or night is None or reader.folder != wanted:
            reader, night = self._open(wanted)
        has_news = self._read_records(reader, night)
        # The records first: decoding a picture loads a large library.
        if has_news:
            self._show()
        if self._read_picture(reader, night):
            self._show()

    def _open(self, folder: Path) -> tuple[SessionReader, Night]:
        reader = SessionReader(folder)
        config: Config | None = None
        try:
            config = reader.config()
        except SessionError as error:
            log.warning("%s", error)
        self._night = night = Night(folder, reader.read_meta(), config)
        self._reader, self._seq, self._picture = reader, 0, None
        self.indi = config.indi if config is not None else None
        self._show()
        return reader, night

    def _read_records(self, reader: SessionReader, night: Night) -> bool:
        before = self._seq
        shown_s = time.monotonic()
        for seq, t_utc_ns, record in reader.records(since_seq=self._seq):
            night.fold_record(t_utc_ns, record, seq)
            self._seq = seq
            if self._is_closing:
                return False
            if time.monotonic() - shown_s > SHOW_WHILE_READING_S:
                self._show()
                shown_s = time.monotonic()
        is_first = not night.is_past_read
        night.mark_past_read()
        return is_first or self._seq != before or self._has_closed(reader, night)

    def _has_closed(self, reader: SessionReader, night: Night) -> bool:
        now_s = time.monotonic()
        if night.is_closed or now_s - self._closed_seen_s < CLOSED_CHECK_S:
            return False
        self._closed_seen_s = now_s
        if reader.read_meta().get("is_closed") is True:
            night.close()
            return True
        return False

    def _read_picture(self, reader: SessionReader, night: Night) -> bool:
        """Read the newest frame's preview that is there; True when it is another than before."""
        for frame_id in night.newest_frame_ids():
            if self._picture is not None and self._picture.frame_id >= frame_id:
                return self._mark_again(reader, night)
            picture = read_picture(reader, frame_id, night.frame(frame_id))
            if picture is not None:
                self._picture = picture
                return True
        return False

    def _mark_again(self, reader: SessionReader, night: Night) -> bool:
        """Update the picture's marks and close-up; True when they have changed.

        A picture may be there before its frame's records.
        """
        if self._picture is None or self._picture.frame_id not in night.newest_frame_ids():
            return False
        before = self._picture
        detail, closeup = night.frame(before.frame_id), before.closeup
        if closeup is None:
            closeup = read_closeup(reader, detail)
        if detail == before.detail and closeup is before.closeup:
            return False
        self._picture = replace(
            before, detail=detail, marks=frame_marks(detail), closeup=closeup, place=detail.closeup
        )
        return True

    def _show(self) -> None:
        if self._night is not None and not self._is_closing:
            self._on_seen(self._night.view(), self._picture)

    def _say_fault(self, text: str) -> None:
        self._has_fault = True
        view = self._night.view() if self._night is not None else NightView(folder=self._wanted)
        self._on_seen(replace(view, fault=text), self._picture)


class EngineWatch(Poller):
    """Thread that asks the engine for its status twice a second."""

    def __init__(self, wire: ControlClient, on_seen: Callable[[EngineView], None]) -> None:
        super().__init__("engine", ASK_S)
        self._wire = wire
        self._on_seen = on_seen
        self._last = EngineView()
        self._has_met = False
        self._began_s = time.monotonic()

    def _look(self) -> None:
        seen = self._ask()
        if seen != self._last and not self._is_closing:
            self._last = seen
            self._on_seen(seen)

    def _ask(self) -> EngineView:
        try:
            outcome = self._wire.send(AskStatus(), timeout_s=ANSWER_S)
        except ControlError as error:
            return self._out_of_reach(error)
        except Exception as error:  # whatever it says, the seat goes on
            log.exception("status")
            return replace(self._last, reach="silent", detail=str(error))
        if not outcome.ok:
            return replace(self._last, reach="silent", detail=outcome.message)
        self._has_met = True
        return read_engine_view(outcome.data)

    def _out_of_reach(self, error: ControlError) -> EngineView:
        is_gone = isinstance(error.__cause__, FileNotFoundError | ConnectionRefusedError)
        if not self._has_met and time.monotonic() - self._began_s < STARTING_S:
            return EngineView(detail=str(error))
        since = self._last.since_utc_ns
        if self._last.is_attached:
            since = self._last.now_utc_ns
        return replace(
            self._last,
            reach="gone" if is_gone else "silent",
            since_utc_ns=since,
            detail=str(error),
            faults=(),
            lifted=(),
            next_limit_utc_ns=None,
        )


if TYPE_CHECKING:
    from rsoconsole.pipeline import SkyOutlook


EVERY_S = 30.0
WAIT_S = 1.0
BREATH_S = 2.0
"""Least seconds between two computations for a running engine: simulated nights are fast."""
NEAR_DEG = 0.5
"""Way of the telescope by which no limit's figure changes, degrees."""
MINUTE_NS = 60 * 10**9


class OutlookWatch(Poller):
    """Thread that computes the outlook every half minute, and after what makes it another one.

    That is a change of state or target, another minute, and a telescope that looks elsewhere.
    """

    def __init__(
        self, on_seen: Callable[["SkyOutlook"], None], on_orbit: Callable[[OrbitPrediction], None]
    ) -> None:
        super().__init__("outlook", WAIT_S)
        self._on_seen, self._on_orbit = on_seen, on_orbit
        self._known = (NightView(), EngineView())
        self._computed_s = self._orbit_s = -EVERY_S
        self._computed_of: object = None
        self._minute = 0
        self._direction: tuple[float, float] | None = None
        """Minute of the clock, and the telescope's direction, of the last outlook."""
        self._orbit_of: object = None

    def update(self, night: NightView, engine: EngineView) -> None:
        """Take the present night and engine; may be called from any thread."""
        self._known = (night, engine)

    def _look(self) -> None:
        night, engine = self._known
        now = engine.now_utc_ns if engine.is_attached else night.last_utc_ns
        config = night.config
        if config is None or not now:
            return
        for compute in (self._compute, self._compute_orbit):
            try:
                compute(config, night, engine, now)
            except Exception:  # a panel without it is worth more than no panel
                log.exception("the outlook cannot be computed")

    def _compute(self, config: Config, night: NightView, engine: EngineView, now: int) -> None:
        direction = _direction(night, engine)
        is_known = night.track is not None, direction is not None
        of = (night.folder, night.state, is_known)
        since_s = time.monotonic() - self._computed_s
        if of == self._computed_of:
            is_same = now // MINUTE_NS == self._minute and _is_near(direction, self._direction)
            least_s = BREATH_S if engine.is_attached else 0.0
            if since_s < (EVERY_S if is_same else least_s):
                return
        self._computed_of, self._computed_s = of, time.monotonic()
        self._minute, self._direction = now // MINUTE_NS, direction
        # Late: the sky's computation loads slowly, and the first paint does not wait for it.
        from rsoconsole.pipeline import sky_outlook

        seen = sky_outlook(config, now, direction, night.track)
        if not self._is_closing:
            self._on_seen(seen)

    def _compute_orbit(
        self, config: Config, night: NightView, engine: EngineView, now: int
    ) -> None:
        """Compute the prediction of the recorded orbit, where it is due."""
        found = night.orbit
        if found is None:
            return
        of = (night.folder, found, now // MINUTE_NS)
        since_s = time.monotonic() - self._orbit_s
        if of == self._orbit_of and since_s < EVERY_S:
            return
        if engine.is_attached and since_s < BREATH_S:
            return
        self._orbit_of, self._orbit_s = of, time.monotonic()
        try:
            ahead = predict_orbit(found, config, now, folder=night.folder)
        except Exception:  # an orbit is worth showing that leads nowhere
            log.exception("where the orbit leads cannot be computed")
            ahead = OrbitPrediction(
                folder=night.folder, estimate=found, from_utc_ns=now, outlook=None
            )
        if not self._is_closing:
            self._on_orbit(ahead)


def _is_near(direction: tuple[float, float] | None, before: tuple[float, float] | None) -> bool:
    """Return True for directions (ICRS degrees) so near that no limit differs by a figure."""
    if direction is None or before is None:
        return direction is before
    return separation_deg(*direction, *before) < NEAR_DEG


def _direction(night: NightView, engine: EngineView) -> tuple[float, float] | None:
    """Return the telescope's direction by the mount's report, else by the last frame."""
    if engine.mount_ra_icrs_deg is not None and engine.mount_dec_icrs_deg is not None:
        return engine.mount_ra_icrs_deg, engine.mount_dec_icrs_deg
    pointing = night.pointing
    return None if pointing is None else (pointing.ra_icrs_deg, pointing.dec_icrs_deg)
