"""One session, gathered frame by frame for the figures."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, assert_never

from rsoconsole.config import Config
from rsoconsole.control import one_line
from rsoconsole.errors import SessionError
from rsoconsole.foreign_text import json_of
from rsoconsole.reason_text import text
from rsoconsole.records import (
    Closeup,
    CycleTiming,
    Detections,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    LeapDone,
    LowPass,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    PairMotions,
    ParameterChange,
    Record,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.session.reading import SessionReader
from rsoconsole.sky import wrap_180

SAME_FRAME_S = 1.0
OfFrame: TypeAlias = Measurement | TrackState | Miss | FollowedAgain
KINDS = (FrameTaken, Measurement, TrackState, Miss, FollowedAgain, ParameterChange)


@dataclass(slots=True, kw_only=True)
class NightFrame:
    """What the session says of one exposure."""

    frame_id: int
    t_mid_utc_ns: int
    measured: Measurement | None = None
    """The one the lead took."""
    others: tuple[Measurement, ...] = ()
    predicted: TrackState | None = None
    corrected: TrackState | None = None
    """After the measurement; the first state of a track too."""
    beside: dict[int, TrackState] = field(default_factory=dict)
    """The other tracks of the frame by their ids, each as it was known last."""
    missed: str | None = None
    """Why the lead was not measured; None when it was, or when there was no track."""
    tau: float = 0.0

    @property
    def track(self) -> TrackState | None:
        """The best that was known at mid-exposure, the frame itself included."""
        return self.corrected or self.predicted


@dataclass(frozen=True, slots=True, kw_only=True)
class Night:
    """A session's frames in order of time, and how it was set up."""

    title: str
    frames: tuple[NightFrame, ...]
    config: Config

    def seconds(self, frame: NightFrame) -> float:
        """From the middle of the first exposure to that of this one."""
        return (frame.t_mid_utc_ns - self.frames[0].t_mid_utc_ns) / 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class TruePlace:
    """Where a simulated satellite really was at mid-exposure, astrometric ICRS."""

    name: str
    ra_icrs_deg: float
    dec_icrs_deg: float


class NightFold:
    """Gathers a night record by record, in the order of the log; a live one goes on growing."""

    def __init__(self, title: str, config: Config) -> None:
        self._title, self._config = title, config
        self._tau = config.detector.tau
        self._frames: dict[int, NightFrame] = {}
        self._measured: dict[int, list[Measurement]] = {}
        self._changed: set[int] = set()
        """Frames with measurements of which it is not settled which one the track took."""

    def take(self, record: Record) -> None:
        """One record."""
        match record:
            case ParameterChange():
                self._tau = float(record.after) if record.name == "detector.tau" else self._tau
            case FrameTaken():
                if record.t_mid_utc_ns is not None:
                    self._frames[record.frame_id] = NightFrame(
                        frame_id=record.frame_id, t_mid_utc_ns=record.t_mid_utc_ns, tau=self._tau
                    )
                    self._measured.pop(record.frame_id, None)
            case Measurement() | TrackState() | Miss() | FollowedAgain():
                if record.frame_id in self._frames:
                    _put(self._frames[record.frame_id], record, self._measured)
                    self._changed.add(record.frame_id)
            case (
                Detections()
                | Solution()
                | NotSolved()
                | NotFollowed()
                | SlewCommand()
                | StateChange()
                | OperatorAction()
                | CycleTiming()
                | Closeup()
                | Ruling()
                | OrbitEstimate()
                | Identified()
                | PairMotions()
                | ExpectedMembers()
                | LeapDone()
                | LowPass()
                | Event()
            ):
                pass  # nothing of it is drawn
            case _:
                assert_never(record)

    def night(self) -> Night:
        """Its frames so far; those without a time are left out."""
        for frame_id in self._changed & self._measured.keys():
            _assign(self._frames[frame_id], self._measured[frame_id])
        self._changed.clear()
        in_order = tuple(sorted(self._frames.values(), key=lambda frame: frame.t_mid_utc_ns))
        return Night(title=self._title, frames=in_order, config=self._config)


def read_night(session: Path) -> Night:
    """Gather a session's frames; those without a time are left out.

    Raises SessionError when the folder is no session or holds no frame with a time.
    """
    reader = SessionReader(session)
    fold = NightFold(title_of(reader.about(), session), reader.config())
    for _, _, record in reader.records(kinds=KINDS):
        fold.take(record)
    return with_frames(fold.night(), session)


def title_of(about: Mapping[str, Any], folder: Path) -> str:
    """What a session calls itself, else its folder's name; nothing that steers a terminal."""
    return one_line(str(about.get("title") or folder.resolve().name))


def with_frames(night: Night, session: Path) -> Night:
    """The night. Raises SessionError where it holds no frame with a time."""
    if not night.frames:
        raise SessionError(f"{session} holds no frame with a time: there is nothing to draw")
    return night


def _put(frame: NightFrame, record: OfFrame, measured: dict[int, list[Measurement]]) -> None:
    match record:
        case Measurement():
            measured.setdefault(frame.frame_id, []).append(record)
        case FollowedAgain():
            # By the operator's word: what was made of it before counts no more.
            frame.predicted = frame.corrected = frame.missed = None
            frame.beside.clear()
        case Miss():
            # The lead's come first.
            if record.track_id not in frame.beside:
                frame.missed = text(record.reason)
        case TrackState(is_lead=False):
            frame.beside[record.track_id] = record
        case TrackState(kind="predicted"):
            frame.predicted = record
        case TrackState():
            frame.corrected = record
        case _:
            assert_never(record)


def _assign(frame: NightFrame, candidates: list[Measurement]) -> None:
    """Which measurement the track took: its id is in the state."""
    if frame.corrected is not None:
        named = frame.corrected.measurement_id
        frame.measured = next((m for m in candidates if m.measurement_id == named), None)
    frame.others = tuple(m for m in candidates if m is not frame.measured)


def offset_arcsec(
    ra_deg: float, dec_deg: float, from_ra_deg: float, from_dec_deg: float
) -> tuple[float, float]:
    """(east, north) on the sky of one direction from another, small angles, safe across RA 0h."""
    cos_dec = math.cos(math.radians(from_dec_deg))
    return wrap_180(ra_deg - from_ra_deg) * cos_dec * 3600.0, (dec_deg - from_dec_deg) * 3600.0


def read_truth(path: Path, night: Night) -> dict[int, TruePlace]:
    """True place of the followed satellite by frame, from a simulated observatory's truth.

    One JSON object an exposure. The followed one is that on which most of the track's states lie.
    Raises SessionError when the file is no such truth.
    """
    try:
        with path.open(encoding="utf-8") as lines:
            exposures = [json_of(line) for line in lines if line.strip()]
        by_instant = {
            each["t_start_utc_ns"] / 1e9 + each["exposure_s"] / 2.0: each["satellites"]
            for each in exposures
        }
        places = {
            frame.frame_id: [_place(each) for each in _at(by_instant, frame.t_mid_utc_ns / 1e9)]
            for frame in night.frames
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(f"{path} cannot be read as a simulation's truth: {error}") from error
    name = _followed(night.frames, places)
    return {
        frame_id: each
        for frame_id, satellites in places.items()
        for each in satellites
        if each.name == name
    }


def _at(by_instant: Mapping[float, Any], t_s: float) -> Any:
    nearest = min(by_instant, key=lambda instant: abs(instant - t_s), default=math.inf)
    return by_instant[nearest] if abs(nearest - t_s) < SAME_FRAME_S else ()


def _place(satellite: Mapping[str, Any]) -> TruePlace:
    return TruePlace(
        name=str(satellite["name"]),
        ra_icrs_deg=float(satellite["ra_icrs_deg"]),
        dec_icrs_deg=float(satellite["dec_icrs_deg"]),
    )


def _followed(frames: Iterable[NightFrame], places: Mapping[int, list[TruePlace]]) -> str | None:
    votes: dict[str, int] = {}
    for frame in frames:
        if frame.corrected is None or not places[frame.frame_id]:
            continue
        x = frame.corrected.x
        nearest = min(
            places[frame.frame_id],
            key=lambda true: math.hypot(
                *offset_arcsec(x[0], x[2], true.ra_icrs_deg, true.dec_icrs_deg)
            ),
        )
        votes[nearest.name] = votes.get(nearest.name, 0) + 1
    return max(votes, key=lambda name: votes[name], default=None)
