"""Thread that reads one frame of a session and processes it again on request.

Network and plate solver are used by this thread alone. A new request replaces an older one that
still waits. The thread has low priority, for the sake of an engine on the same computer.
"""

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.picture.picture import Picture, read_picture
from rsoconsole.night import Night, NightFrame
from rsoconsole.records import MapMode
from rsoconsole.session import SessionReader

if TYPE_CHECKING:
    from rsoconsole.console.picture.sheet_pixels import FramePixelPyramid
    from rsoconsole.pipeline import ComparedCandidate, RecordedFrame, ReprocessedFrame, Reprocessor
    from rsoconsole.vision import FrameMap

log = logging.getLogger(__name__)

STEP_BACK = 10
"""Increment of the thread's niceness, so that an engine has priority."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSettings:
    """Settings to process the frame with; None: the value that was in force."""

    tau: float | None = None
    map_mode: MapMode | None = None
    solves_again: bool = False
    wants_map: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameOpened:
    """The frame's record, posted before its pixels are read."""

    recorded: "RecordedFrame"
    detail: NightFrame
    preview: Picture | None
    bytes: int
    """Size of the file of pixels; 0 where there is none."""
    candidates: tuple["ComparedCandidate", ...]
    """Candidates as recorded; none has a new result beside it yet."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelsLoaded:
    """The frame's pixels, posted once they are read."""

    pixels: "FramePixelPyramid"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameProcessed:
    """News with the result of processing the frame with some settings."""

    wanted: FrameSettings
    result: "ReprocessedFrame"
    maps: tuple["FrameMap", ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFault:
    """Posted where the frame cannot be read or processed; ``text``: the fault with its remedy."""

    text: str
    wanted: FrameSettings | None = None
    """The settings that could not be processed with; None: the frame itself cannot be read."""


News = FrameOpened | PixelsLoaded | FrameProcessed | FrameFault


class FrameReprocessor:
    """Thread that reads one frame, then processes it again at each request."""

    def __init__(
        self, folder: Path, frame_id: int, config: Config | None, on_news: Callable[[News], None]
    ) -> None:
        """``config``: None: the session's own; ``on_news``: called on the thread, returns soon."""
        self._folder, self._frame_id, self._config = folder, frame_id, config
        self._on_news = on_news
        self._wanted: FrameSettings | None = None
        self._wake = threading.Event()
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name="console-sheet", daemon=True)

    def start(self) -> None:
        """Start the thread, which reads the frame."""
        self._thread.start()

    def ask(self, wanted: FrameSettings) -> None:
        """Process with these settings next; may be called from any thread.

        An earlier request that still waits is dropped.
        """
        self._wanted = wanted
        self._wake.set()

    def close(self) -> None:
        """End the thread once its present work is finished."""
        self._is_closing = True
        self._wake.set()

    def _run(self) -> None:
        with contextlib.suppress(AttributeError, OSError):  # not on every system
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), STEP_BACK)
        processor: Reprocessor | None = None
        try:
            processor = self._open()
            while processor is not None and not self._is_closing:
                self._wake.wait()
                self._wake.clear()
                wanted, self._wanted = self._wanted, None
                if wanted is not None and not self._is_closing:
                    self._fulfil(processor, wanted)
        except RsoconsoleError as error:
            # The session is known; its path would take the room that the remedy needs.
            self._post(FrameFault(text=str(error).replace(f"{self._folder}/", "")))
        except Exception as error:  # the seat must go on, whatever lies in the folder
            log.exception("frame %d cannot be shown", self._frame_id)
            self._post(FrameFault(text=f"frame {self._frame_id} cannot be shown: {error}"))
        finally:
            if processor is not None:
                processor.close()

    def _open(self) -> "Reprocessor | None":
        from rsoconsole.console.picture.sheet_pixels import FramePixelPyramid
        from rsoconsole.pipeline import (
            Reprocessor,
            pair_candidates,
            read_frame_records,
            read_recorded_frame,
        )

        reader = SessionReader(self._folder)
        recorded = read_frame_records(reader, self._frame_id, self._config)
        detail = read_night_frame(reader, self._frame_id)
        size = recorded.path.stat().st_size if recorded.path is not None else 0
        preview = read_picture(reader, self._frame_id, detail)
        self._post(
            FrameOpened(
                recorded=recorded,
                detail=detail,
                preview=preview,
                bytes=size,
                candidates=pair_candidates(recorded.seen.detections, None),
            )
        )
        if self._is_closing:
            return None
        frame = read_recorded_frame(recorded)
        if self._is_closing:
            return None
        pixels = FramePixelPyramid(frame.pixels)
        pixels.prepare_block_means()
        self._post(PixelsLoaded(pixels=pixels))
        return Reprocessor(recorded, frame)

    def _fulfil(self, processor: "Reprocessor", wanted: FrameSettings) -> None:
        try:
            result = processor.run(wanted.tau, wanted.map_mode, solves_again=wanted.solves_again)
            maps = processor.network_maps(result.map_mode) if wanted.wants_map else ()
        except RsoconsoleError as error:
            self._post(FrameFault(text=str(error), wanted=wanted))
        except Exception as error:  # another try may go well
            log.exception("frame %d cannot be processed", self._frame_id)
            self._post(FrameFault(text=f"the frame cannot be processed: {error}", wanted=wanted))
        else:
            self._post(FrameProcessed(wanted=wanted, result=result, maps=maps))

    def _post(self, news: News) -> None:
        if not self._is_closing:
            self._on_news(news)


def read_night_frame(reader: SessionReader, frame_id: int) -> NightFrame:
    """Read what a session has on record of one frame."""
    night = Night(reader.folder, {}, None)
    for _, t_utc_ns, record in reader.records(frame_id=frame_id):
        night.fold_record(t_utc_ns, record)
    return night.frame(frame_id)
