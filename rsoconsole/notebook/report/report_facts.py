"""What the report says: figures of the night, its tracks, its course, what the operator did."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rsoconsole.control import command_words
from rsoconsole.export import MeasuredRow
from rsoconsole.night import NightFrame, NightTrack, consistency_of, rms
from rsoconsole.notebook.night import DrawnNight
from rsoconsole.records import (
    Event,
    OperatorAction,
    ParameterChange,
    Ruling,
    StateChange,
)
from rsoconsole.session.reading import SessionReader
from rsoconsole.sky import utc_ns_to_iso
from rsoconsole.words import text

GEO_RATE_ARCSEC_S = 15.041
GEO_WITHIN_ARCSEC_S = 0.3
MOST_TEXT = 400
"""Letters of one entry."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A line of the night's course."""

    t_utc: str
    frame_id: int | None
    kind: str
    text: str
    level: str = "info"


@dataclass(frozen=True, slots=True, kw_only=True)
class Course:
    """What happened, in the order of the record."""

    entries: tuple[Entry, ...]
    actions: tuple[Entry, ...]
    changes: tuple[Entry, ...]
    locked_frame: int | None
    """The frame with which a track was first had."""
    last_state: str
    alarms: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFacts:
    """One track at a glance."""

    number: int
    first: MeasuredRow
    last: MeasuredRow
    count: int
    sigma_arcsec: tuple[float, float]
    """Median one sigma of its measurements, right ascension on the sky and declination."""
    rms_arcsec: float | None
    rate_arcsec_s: tuple[float, float] | None
    """On the sky at its end."""
    known: NightTrack | None = None
    """Its orbit, its name and how it ended; None where the record has nothing of that number."""

    @property
    def minutes(self) -> float:
        """From its first measurement to its last."""
        return (self.last.t_mid_utc_ns - self.first.t_mid_utc_ns) / 6e10

    @property
    def is_geostationary(self) -> bool:
        """Whether it moves as what stands still over the turning Earth."""
        if self.rate_arcsec_s is None:
            return False
        east, north = self.rate_arcsec_s
        still = GEO_RATE_ARCSEC_S * math.cos(math.radians(self.last.dec_icrs_deg))
        return math.hypot(east - still, north) < GEO_WITHIN_ARCSEC_S


def clock(t_utc_ns: int) -> str:
    """Time of day, to the second."""
    return utc_ns_to_iso(t_utc_ns, decimals=0)[11:19]


def filter_words(night: DrawnNight) -> str:
    """Whether the filter believed itself rightly at the end, in words."""
    judged = consistency_of(night.frames)
    words = {
        "sound": "the filter's errors are as large as it says",
        "too few": "too few updates to judge the filter",
        "over-confident": f"the filter trusts itself too much: {judged.words}",
        "under-confident": f"the filter trusts itself too little: {judged.words}",
    }
    return words[judged.verdict]


def track_facts(
    rows: Sequence[MeasuredRow], known: Mapping[int, NightTrack]
) -> tuple[TrackFacts, ...]:
    """Every track that took something, in order; ``known``: what the record has of each."""
    numbers = sorted({row.track for row in rows if row.track is not None})
    return tuple(
        replace(_track(number, [r for r in rows if r.track == number]), known=known.get(number))
        for number in numbers
    )


def _track(number: int, rows: list[MeasuredRow]) -> TrackFacts:
    residuals = [
        math.hypot(row.residual_ra_arcsec, row.residual_dec_arcsec)
        for row in rows
        if row.residual_ra_arcsec is not None and row.residual_dec_arcsec is not None
    ]
    last = rows[-1]
    rate = (last.rate_ra_arcsec_s, last.rate_dec_arcsec_s)
    return TrackFacts(
        number=number,
        first=rows[0],
        last=last,
        count=len(rows),
        sigma_arcsec=(
            statistics.median(row.sigma_ra_arcsec for row in rows),
            statistics.median(row.sigma_dec_arcsec for row in rows),
        ),
        rms_arcsec=rms(residuals),
        rate_arcsec_s=None if rate[0] is None or rate[1] is None else (rate[0], rate[1]),
    )


def read_course(session: Path, night: DrawnNight, tracks: Mapping[int, NightTrack]) -> Course:
    """States, events, misses of all tracks, orders and changed settings. Raises SessionError."""
    kinds = (StateChange, Event, OperatorAction, ParameterChange, Ruling)
    entries: list[tuple[int, Entry]] = []
    actions: list[Entry] = []
    changes: list[Entry] = []
    locked: int | None = None
    state, alarms = "", 0
    for _, t_utc_ns, record in SessionReader(session).records(kinds=kinds):
        match record:
            case StateChange():
                state = record.after
                locked = record.frame_id if locked is None and state == "TRACK" else locked
                words = f"{record.before} → {record.after}: {text(record.reason)}"
                entries.append((t_utc_ns, _entry(t_utc_ns, record.frame_id, "state", words)))
            case Event():
                alarms += record.level == "alarm"
                entry = _entry(t_utc_ns, record.frame_id, record.level, record.text)
                entries.append((t_utc_ns, entry))
            case OperatorAction():
                words = command_words(record.verb, record.arguments)
                actions.append(
                    _entry(t_utc_ns, None, record.by, f"{words}: {text(record.outcome)}")
                )
            case ParameterChange():
                words = f"{record.name}: {record.before} → {record.after}"
                changes.append(_entry(t_utc_ns, None, record.by, words))
            case Ruling():
                refused = len(record.refused)
                words = "one streak taken" if record.taken is not None else "nothing taken"
                words += f", {refused} refused" if refused else ""
                words += _of_tracks(record)
                actions.append(_entry(t_utc_ns, record.frame_id, record.by, f"decision: {words}"))
    for frame in night.frames:
        for words in _missed(frame, tracks):
            entry = _entry(frame.t_mid_utc_ns, frame.frame_id, "missed", words)
            entries.append((frame.t_mid_utc_ns, entry))
    entries.sort(key=lambda pair: pair[0])
    return Course(
        entries=tuple(entry for _, entry in entries),
        actions=tuple(actions),
        changes=tuple(changes),
        locked_frame=locked,
        last_state=state,
        alarms=alarms,
    )


def _of_tracks(decision: Ruling) -> str:
    """What a decision says of whole tracks."""
    said = (("dropped", decision.dropped), ("kept", decision.kept), ("released", decision.released))
    return "".join(f", track {n} {what}" for what, numbers in said for n in numbers)


def _missed(frame: NightFrame, tracks: Mapping[int, NightTrack]) -> list[str]:
    """Why a frame did not show what was followed: once for tracks with the same reason."""
    if len(tracks) < 2:
        return [] if frame.missed is None else [frame.missed]
    numbers: dict[str, list[int]] = {}
    for each in tracks.values():
        if frame.frame_id in each.missed:
            numbers.setdefault(each.missed[frame.frame_id], []).append(each.number)
    if not numbers:
        return [] if frame.missed is None else [frame.missed]
    return [
        f"track{'s' if len(of) > 1 else ''} {' '.join(map(str, of))}: {why}"
        for why, of in numbers.items()
    ]


def _entry(t_utc_ns: int, frame_id: int | None, kind: str, text: str) -> Entry:
    is_bad = kind in {"alarm", "warning", "missed"}
    return Entry(
        t_utc=clock(t_utc_ns),
        frame_id=frame_id or None,
        kind=kind,
        text=text if len(text) <= MOST_TEXT else text[: MOST_TEXT - 1] + "…",
        level=kind if is_bad else "info",
    )
