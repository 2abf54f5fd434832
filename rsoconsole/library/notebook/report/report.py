"""The report of a night: tracks, their quality, the paper's figures, every measurement.

One HTML file that loads nothing from elsewhere, for a screen (light or dark) and for paper. Text
that people wrote (titles, notes) is always escaped.
"""

import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rsoconsole import __version__
from rsoconsole.control import one_line
from rsoconsole.library.formats.api import ExportResult
from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.night import read_exported_night as read_rows
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.notebook.night.night import DrawnNight, read_drawn_night
from rsoconsole.library.notebook.report._report_facts import (
    NightLogLines,
    TrackSummary,
    filter_consistency_text,
    read_log_lines,
    summarise_tracks,
)
from rsoconsole.library.notebook.report._report_light import MAX_TRACKS, summarise_light
from rsoconsole.library.notebook.report._report_pictures import inline_figures, report_frames
from rsoconsole.night import (
    FRAME_FACTS,
    LeadSummary,
    frame_quantities,
    lead_summary,
    median_and_range_text,
    merit,
    tracks_of,
)
from rsoconsole.pipeline import usual_timing_sigma_s
from rsoconsole.records import (
    ExpectedMembers,
    LeapDone,
    LowPass,
    PairMotion,
    PairMotions,
    Record,
    UnseenMember,
)
from rsoconsole.session import SessionReader
from rsoconsole.sky import day_of
from rsoconsole.words import (
    count_words,
    date_span_words,
    format_dec,
    format_ra,
    settings_words,
    shutter_words,
    utc_text,
)

MAX_PAIRS = 40
"""Largest number of pairs in the page's table, the nearest first; the session holds all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairSummary:
    """A pair of tracks: its last relative motion, and its least separation on record."""

    last: PairMotion
    nearest_arcsec: float
    """Least separation of the pair on record."""
    nearest_utc_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenObject:
    """A catalogued object that was expected in the field and followed by no track."""

    looks: int
    """Number of comparisons with the catalogue that expected it while no track was of it."""
    of_looks: int
    """Number of all comparisons with the catalogue on record."""
    lit: int
    """Number of ``looks`` at which the Sun shone on it."""
    last: UnseenMember


def find_pairs_and_unseen(
    records: Iterable[Record],
) -> tuple[tuple[PairSummary, ...], tuple[UnseenObject, ...]]:
    """Return the pairs of tracks, closest first, and unseen objects, most often missed first."""
    pairs: dict[tuple[int, int], PairSummary] = {}
    unseen: dict[int, tuple[int, int, UnseenMember]] = {}
    looks = 0
    for record in records:
        match record:
            case PairMotions():
                for each in record.pairs:
                    ids = each.track_id, each.other_track_id
                    pairs[ids] = _nearer(pairs.get(ids), each)
            case ExpectedMembers():
                looks += 1
                for member in record.unseen:
                    count, lit, _ = unseen.get(member.norad_id, (0, 0, member))
                    unseen[member.norad_id] = (count + 1, lit + member.is_lit, member)
            case _:
                pass
    return (
        tuple(sorted(pairs.values(), key=lambda each: each.nearest_arcsec)),
        tuple(
            UnseenObject(looks=count, of_looks=looks, lit=lit, last=member)
            for _, (count, lit, member) in sorted(
                unseen.items(), key=lambda item: (-item[1][0], item[0])
            )
        ),
    )


def _nearer(before: PairSummary | None, now: PairMotion) -> PairSummary:
    if before is not None and before.nearest_arcsec <= now.separation_arcsec:
        return replace(before, last=now)
    return PairSummary(last=now, nearest_arcsec=now.separation_arcsec, nearest_utc_ns=now.t_utc_ns)


PARTS = ("slew_s", "settle_s", "shutter_s", "open_s", "readout_s", "wait_s")
"""Durations of the parts of a leap, in order, as fields of ``LeapDone``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PassSummary:
    """Pass of a low satellite, with the results of its leaps (slews ahead of the satellite)."""

    over: LowPass
    leaps: int
    """Number of leaps ordered."""
    met: int
    at_close: int
    """Number of leaps ordered as the shutter of the exposure before closed."""
    unmet: str
    """Results of the leaps that did not meet the satellite, counted: ``2 another streak``."""
    total_s: float | None
    """Median time from the order of a leap until the next could be ordered; None without a leap."""
    parts_s: tuple[float, ...]
    """Median durations of the parts of a leap, in the order of ``PARTS``; empty without a leap."""
    along_arcsec: float | None
    """Median distance from the prediction along the motion; None where no leap met it."""
    across_arcsec: float | None


def summarise_passes(records: Iterable[Record]) -> tuple[PassSummary, ...]:
    """Return the passes on record in a session, in order of time."""
    leaps: dict[int, list[LeapDone]] = {}
    passes: list[LowPass] = []
    for record in records:
        if isinstance(record, LeapDone):
            leaps.setdefault(record.begun_frame_id, []).append(record)
        elif isinstance(record, LowPass):
            passes.append(record)
    return tuple(_facts(each, leaps.get(each.begun_frame_id, [])) for each in passes)


def _facts(over: LowPass, leaps: Sequence[LeapDone]) -> PassSummary:
    met = [each for each in leaps if each.result == "met"]
    others = [each.result for each in leaps if each.result != "met"]
    count_words = (f"{others.count(kind)} {kind}" for kind in dict.fromkeys(others))
    along, across = (
        _median([abs(off) for each in met if (off := getattr(each, name)) is not None])
        for name in ("off_along_arcsec", "off_across_arcsec")
    )
    return PassSummary(
        over=over,
        leaps=len(leaps),
        met=len(met),
        at_close=sum(each.ordered == "at close" for each in leaps),
        unmet=", ".join(count_words),
        total_s=_median([each.total_s for each in leaps]),
        parts_s=tuple(_median([getattr(each, part) for each in leaps]) or 0.0 for part in PARTS)
        if leaps
        else (),
        along_arcsec=along,
        across_arcsec=across,
    )


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None


TEMPLATE = "report.html.j2"
MAX_ROWS = 2000
"""Largest number of measurements in the page's table; the CSV holds all."""
MAX_ENTRIES = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The report's page, and a summary of its content."""

    html: str
    made: ExportResult


def render_report(session: Path) -> Report:
    """Make the report of a session or a branch.

    Raises SessionError when the session cannot be read or holds no frame.
    """
    night, exported = read_drawn_night(session), read_rows(session)
    known = tracks_of(night.frames)
    log = [record for _, _, record in SessionReader(session).records()]
    pairs, unseen = find_pairs_and_unseen(log)
    course = read_log_lines(session)
    figures = lead_summary(night.frames)
    tracks = summarise_tracks(exported.rows, known)
    said = filter_consistency_text(night)
    shown = report_frames(session, night, exported.rows)
    lights = summarise_light(night.frames)
    rows, changes = exported.rows, exported.about.get("tried")
    html = (
        _environment()
        .get_template(TEMPLATE)
        .render(
            night=night,
            span=date_span_words(night.frames[0].t_mid_utc_ns, night.frames[-1].t_mid_utc_ns),
            changes=settings_words(changes) if isinstance(changes, Mapping) else "",
            exported=exported,
            course=course,
            entries=course.entries[:MAX_ENTRIES],
            entries_left_out=max(len(course.entries) - MAX_ENTRIES, 0),
            figures=figures,
            verdict=_conclusion(night, figures, tracks, said),
            key_figures=_key_figures(figures, course),
            tracks=tracks,
            lights=lights[:MAX_TRACKS],
            lights_left_out=max(len(lights) - MAX_TRACKS, 0),
            pairs=pairs[:MAX_PAIRS],
            pairs_left_out=max(len(pairs) - MAX_PAIRS, 0),
            unseen=unseen,
            passes=summarise_passes(log),
            drawings=inline_figures(night, _with_firsts(night, rows)),
            alts=_alts(night, figures),
            pictures=shown,
            pictures_left_out=len(night.frames) - len(shown),
            rows=rows[:MAX_ROWS],
            rows_left_out=max(len(rows) - MAX_ROWS, 0),
            shutter=_shutter(exported),
            quality=_quality(night),
            version=__version__,
        )
    )
    made = ExportResult(
        format="html",
        measurements=len(rows),
        tracks=len(tracks),
        is_simulated=exported.is_simulated,
    )
    return Report(html=html, made=made)


def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("rsoconsole.library.notebook"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["ra"] = lambda deg: format_ra(deg, 3)
    environment.filters["dec"] = lambda deg: _minus(format_dec(deg, 2))
    environment.filters["clock"] = lambda t_utc_ns: utc_text(t_utc_ns, zone="")
    environment.policies["truncate.leeway"] = 0
    environment.filters["fixed"] = _fixed
    environment.filters["one_line"] = one_line
    environment.filters["g"] = "{:g}".format
    environment.filters["nis"] = lambda value: _fixed(value, 2 if (value or 0.0) < 100.0 else 0)
    environment.filters["signed"] = lambda value, digits=2: _fixed(value, digits, "+")
    return environment


def _fixed(value: float | None, digits: int = 2, sign: str = "") -> str:
    return "–" if value is None else _minus(f"{value:{sign}.{digits}f}")


def _minus(text: str) -> str:
    """Text with a true minus sign, but none before what rounds to nothing."""
    if text.startswith(("-", "+")) and not text.strip("+-0:."):
        return text[1:]
    return text.replace("-", "−")


def _conclusion(
    night: DrawnNight, figures: LeadSummary, tracks: tuple[TrackSummary, ...], said: str
) -> str:
    """The night in a sentence or three."""
    exposures = count_words(len(night.frames), "exposure")
    if not tracks:
        measured = sum(
            bool(f.other_measurements) or f.lead_measured is not None for f in night.frames
        )
        return f"Nothing was followed: {exposures}, something was measured in {measured} of them."
    objects = "One object was" if len(tracks) == 1 else f"{len(tracks)} objects were"
    first, last = tracks[0].first.t_mid_utc_ns, tracks[-1].last.t_mid_utc_ns
    count = sum(track.count for track in tracks)
    words = (
        f"{objects} followed from {utc_text(first, zone='')}"
        f" to {utc_text(last, zone='')} UTC"
        f" and measured {count_words(count, 'time')} in {exposures}, {_misses(figures.misses)}."
    )
    if len(tracks) == 1 and tracks[0].is_geostationary:
        words += " It moves as a geostationary satellite does."
    if figures.residual_rms_arcsec is not None:
        words += (
            f" Predictions met the next measurement within"
            f" {figures.residual_rms_arcsec:.2f} arcsec (rms on the sky); {said}."
        )
    else:
        words += f" {said[0].upper()}{said[1:]}."
    return words


def _misses(number: int) -> str:
    if number == 0:
        return "without a miss"
    return "with one miss" if number == 1 else f"with {number} misses"


def _key_figures(figures: LeadSummary, course: NightLogLines) -> list[tuple[str, str, str]]:
    """Cells (label, figure, note) of the head's row."""
    beside = {
        merit.LOCK: "" if course.locked_frame is None else f"with frame {course.locked_frame}",
        merit.MISSES: "frames without the object",
        merit.RMS: "measured − predicted",
        merit.NIS_MEAN: f"{merit.BAND.label} {merit.BAND.words(figures)}",
        merit.INSIDE: "of residuals, on both axes",
    }
    return [
        ("exposures", str(figures.frames), f"{figures.updates} updates of the track"),
        *((each.label, each.words(figures), words) for each, words in beside.items()),
    ]


def _with_firsts(night: DrawnNight, rows: tuple[MeasuredRow, ...]) -> DrawnNight:
    """The night with the measurement from which a track began among those that it took."""
    taken = {(row.frame_id, row.x_px, row.y_px) for row in rows if row.is_taken}
    firsts = (
        each.measurement_id
        for frame in night.frames
        for each in frame.measurements
        if (each.frame_id, each.x_px, each.y_px) in taken
    )
    return replace(night, firsts=frozenset(firsts))


def _alts(night: DrawnNight, figures: LeadSummary) -> dict[str, str]:
    """The figures in words."""
    measured = [f.lead_measured.confidence for f in night.frames if f.lead_measured is not None]
    alts: dict[str, str] = {}
    if measured:
        alts["confidence"] = (
            f"Confidence against time: from {min(measured):.2f} to {max(measured):.2f} in"
            f" {count_words(len(measured), 'frame')}, {_misses(figures.misses)}."
        )
    if figures.residual_rms_arcsec is not None and figures.inside_3sigma is not None:
        share = f"{100.0 * figures.inside_3sigma:.0f} per cent"
        alts["residuals"] = (
            f"Residuals against time: {figures.residual_rms_arcsec:.2f} arcsec rms, {share}"
            " within three sigma on both axes."
        )
    if figures.nis_mean is not None:
        alts["nis"] = f"Normalised innovation squared against time: mean {figures.nis_mean:.2f}."
    return alts


def _shutter(exported: ExportedNight) -> str:
    exposure = exported.config.exposure
    if not exposure.calibrated or not exported.rows:
        return f"shutter known to {usual_timing_sigma_s(exposure) * 1e3:g} ms"
    return shutter_words(exposure, day_of(exported.rows[0].t_mid_utc_ns))


def _quality(night: DrawnNight) -> Iterator[tuple[str, str]]:
    """Image and sky quality of the night's frames."""
    facts = [frame_quantities(frame) for frame in night.frames]
    for fact in FRAME_FACTS:
        if said := median_and_range_text(fact, [each[fact.name] for each in facts]):
            yield f"{fact.label[0].upper()}{fact.label[1:]}", said
