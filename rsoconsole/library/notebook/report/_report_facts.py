"""Data for the report: tracks, log of the night, actions of the operator."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.notebook.night.night import DrawnNight
from rsoconsole.night import LogLine, Night, NightTrack, consistency_of, line_of
from rsoconsole.records import OperatorAction, ParameterChange
from rsoconsole.session import SessionReader

GEO_RATE_ARCSEC_S = 15.041
GEO_WITHIN_ARCSEC_S = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class NightLogLines:
    """Lines of a night's log, each group in the order of the log: entries, actions, settings."""

    entries: tuple[LogLine, ...]
    actions: tuple[LogLine, ...]
    changes: tuple[LogLine, ...]
    locked_frame: int | None
    """Number of the first frame after which the loop was in TRACK; None: it never was."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackSummary:
    """Summary of one track for the report."""

    known: NightTrack
    first: MeasuredRow
    last: MeasuredRow
    count: int
    sigma_arcsec: tuple[float, float]
    """Medians of its measurements' sigmas in right ascension (on the sky) and declination."""
    rate_arcsec_s: tuple[float, float] | None
    """Rate at its last measurement: right ascension (on the sky), declination; None: not known."""

    @property
    def minutes(self) -> float:
        """Minutes from its first measurement to its last."""
        return (self.last.t_mid_utc_ns - self.first.t_mid_utc_ns) / 6e10

    @property
    def is_geostationary(self) -> bool:
        """True where its last rate is that of a satellite fixed over one point of the Earth."""
        if self.rate_arcsec_s is None:
            return False
        east, north = self.rate_arcsec_s
        still = GEO_RATE_ARCSEC_S * math.cos(math.radians(self.last.dec_icrs_deg))
        return math.hypot(east - still, north) < GEO_WITHIN_ARCSEC_S


def filter_consistency_text(night: DrawnNight) -> str:
    """Return, in words, whether the filter was consistent at the end of the night."""
    judged = consistency_of(night.frames)
    words = {
        "sound": "the filter's errors are as large as it says",
        "too few": "too few updates to judge the filter",
        "over-confident": f"the filter trusts itself too much: {judged.words}",
        "under-confident": f"the filter trusts itself too little: {judged.words}",
    }
    return words[judged.verdict]


def summarise_tracks(
    rows: Sequence[MeasuredRow], known: Mapping[int, NightTrack]
) -> tuple[TrackSummary, ...]:
    """Summarise the tracks to which measurements are assigned, in the order of ``known``.

    ``rows``: the session's measurements; ``known``: the session's tracks by number.
    """
    taken = {number: [row for row in rows if row.track == number] for number in known}
    return tuple(_track(known[number], own) for number, own in taken.items() if own)


def _track(known: NightTrack, rows: list[MeasuredRow]) -> TrackSummary:
    last = rows[-1]
    rate = (last.rate_ra_arcsec_s, last.rate_dec_arcsec_s)
    return TrackSummary(
        known=known,
        first=rows[0],
        last=last,
        count=len(rows),
        sigma_arcsec=(
            statistics.median(row.sigma_ra_arcsec for row in rows),
            statistics.median(row.sigma_dec_arcsec for row in rows),
        ),
        rate_arcsec_s=None if rate[0] is None or rate[1] is None else (rate[0], rate[1]),
    )


def read_log_lines(session: Path) -> NightLogLines:
    """Read the log lines of a night, with every order and setting. Raises SessionError."""
    reader = SessionReader(session)
    night = Night(session, reader.read_meta(), reader.config())
    done: list[LogLine] = []
    for seq, t_utc_ns, record in reader.records():
        night.fold_record(t_utc_ns, record, seq)
        if isinstance(record, OperatorAction | ParameterChange):
            done += filter(None, [line_of(record, t_utc_ns)])
    actions, changes = OperatorAction.__name__, ParameterChange.__name__
    locked = (line.frame_id for line in night.log if line.change[1:2] == ("TRACK",))
    return NightLogLines(
        entries=tuple(line for line in night.log if line.kind not in {actions, changes}),
        actions=tuple(line for line in done if line.kind == actions),
        changes=tuple(line for line in done if line.kind == changes),
        locked_frame=next(locked, None),
    )
