"""A session gathered for export: site, instruments, and every measurement that counts."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole import __version__
from rsoconsole.config import Config
from rsoconsole.library.formats.rows import MeasuredRow, make_measured_row, rows_with_ranges
from rsoconsole.night import NightFrame, frames_of
from rsoconsole.pipeline import frame_timing, usual_timing_sigma_s
from rsoconsole.records import (
    Detections,
    FollowedAgain,
    FrameTaken,
    Identified,
    Measurement,
    NotFollowed,
    OrbitEstimate,
    Photometry,
    Ruling,
    TrackState,
)
from rsoconsole.session import SessionReader, clock_fault_lines
from rsoconsole.words import text

KINDS = (
    FrameTaken,
    Detections,
    Measurement,
    TrackState,
    NotFollowed,
    Ruling,
    FollowedAgain,
    Identified,
    OrbitEstimate,
    Photometry,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedNight:
    """A session as the writers of all formats receive it."""

    name: str
    """Name of the session's folder."""
    title: str
    config: Config
    about: Mapping[str, Any]
    """Metadata of the session, without its configuration."""
    rows: tuple[MeasuredRow, ...]
    """The measurements, in order of time."""
    clock_notes: tuple[str, ...] = ()
    """Faults of the computer's clock during the session, a line each."""
    names: Mapping[int, Identified] = field(default_factory=dict)
    """Last identification of each track, by track id."""
    taken: Mapping[int, FrameTaken] = field(default_factory=dict)
    """Records of the exposures, by frame number."""
    photometry: Mapping[int, Photometry] = field(default_factory=dict)
    """Brightness of the frames' streaks, and their zero points, by frame number."""

    @property
    def tracks(self) -> tuple[int, ...]:
        """Ids of the tracks to which measurements are assigned, in ascending order."""
        return tuple(sorted({row.track for row in self.rows if row.track is not None}))

    def track_measurements(self, track: int) -> tuple[MeasuredRow, ...]:
        """Return the measurements assigned to a track, except superseded ones, in order of time."""
        return tuple(row for row in self.rows if row.track == track and not row.is_superseded)

    @property
    def is_simulated(self) -> bool:
        """True where the observatory was simulated."""
        return self.about.get("is_simulated") is True

    @property
    def is_closed(self) -> bool:
        """True where the session was closed: False while it goes on, and where it was cut off."""
        return self.about.get("is_closed") is True

    def time_sigma_s(self, row: MeasuredRow) -> float:
        """Return one sigma of a measurement's time, s: the shutter's scatter and bias error."""
        taken = self.taken.get(row.frame_id)
        exposure = self.config.exposure
        if taken is None:
            return exposure.timing_sigma_s
        return frame_timing(taken, exposure).total_sigma_s

    def shutter_sigma_s(self, row: MeasuredRow) -> float:
        """Return the shutter's scatter, s: the part of ``time_sigma_s`` in the row's covariance."""
        taken = self.taken.get(row.frame_id)
        exposure = self.config.exposure
        return exposure.timing_sigma_s if taken is None else frame_timing(taken, exposure).sigma_s

    def table_metadata(self) -> dict[str, Any]:
        """Return metadata of the session (site, versions and so on) for a table, as plain
        values.
        """
        site, optics = self.config.site, self.config.optics
        shutter = [each.model_dump(mode="json") for each in self.config.exposure.calibrated]
        facts: dict[str, Any] = {
            "session": self.name,
            "title": self.title,
            "is_simulated": self.is_simulated,
            "is_closed": self.is_closed,
            "site": site.model_dump(mode="json"),
            "optics": optics.model_dump(mode="json"),
            "exposure_s": self.config.exposure.exposure_s,
            "timing_sigma_s": usual_timing_sigma_s(self.config.exposure),
            **({"shutter": shutter} if shutter else {}),
            "clock_offset_s": self.about.get("clock_offset_s"),
            "clock_faults": list(self.clock_notes),
            "filter_preset": self.config.filter.preset,
            "directions": "ICRS, astrometric: relative to catalogue stars",
            "times": "UTC, mid-exposure by the shutter",
            "exported_by": f"rsoconsole {__version__}",
            "versions": self.about.get("versions"),
        }
        about_keys = {"branch_of", "tried"}
        facts.update((key, value) for key, value in self.about.items() if key in about_keys)
        # Whatever identifies the model and, where a session has one, its contents.
        marks = ("sha256", "digest")
        facts.update((k, v) for k, v in self.about.items() if any(mark in k for mark in marks))
        return facts


def read_exported_night(session: Path, *, everything: bool = False) -> ExportedNight:
    """Gather the measurements of a session or a branch, whether or not assigned to a track.

    ``everything``: also those that the operator refused, and, for frames that were processed again
    after an operator's decision, the earlier results. Raises SessionError.
    """
    reader = SessionReader(session)
    about = reader.read_meta()
    config = reader.config()
    about.pop("config", None)
    frames = frames_of((record for _, _, record in reader.records(kinds=KINDS)), config)
    orbits = {each.track_id: each for frame in frames for each in frame.orbits}
    rows = sorted(_rows(frames, everything), key=lambda row: row.t_mid_utc_ns)
    name = session.resolve().name
    return ExportedNight(
        name=name,
        title=str(about.get("title") or name),
        config=config,
        about=about,
        rows=rows_with_ranges(rows, orbits, config.site.to_site()),
        photometry={each.frame_id: each.photometry for each in frames if each.photometry},
        taken={each.frame_id: each.taken for each in frames if each.taken is not None},
        clock_notes=clock_fault_lines(reader),
        names={found.track_id: found for frame in frames for found in frame.names},
    )


def _rows(frames: Iterable[NightFrame], everything: bool) -> Iterator[MeasuredRow]:
    frames = [each for each in frames if each.taken is not None]
    firsts = _firsts(frames)
    for frame in frames:
        folds = [frame]
        while folds[0].first is not None:
            folds.insert(0, folds[0].first)
        for fold in folds if everything else folds[-1:]:
            yield from _rows_of(frame, fold, firsts if fold is frame else {})


def _rows_of(
    frame: NightFrame, fold: NightFrame, firsts: Mapping[str, int]
) -> Iterator[MeasuredRow]:
    """Rows of a frame; ``fold``: the frame, or its result before it was followed again."""
    is_last = fold is frame
    predicted = {each.track_id: each.predicted for each in fold.tracks}
    updates = [each.updated for each in fold.tracks if each.updated is not None]
    corrected_by = {each.measurement_id: each for each in updates if each.shared_with is None}
    lead = next((each.track_id for each in reversed(fold.tracks) if each.is_lead), None)
    for measurement in _measured(frame, fold):
        began = firsts.get(measurement.measurement_id)
        corrected = corrected_by.get(measurement.measurement_id)
        is_taken = corrected is not None or began is not None
        refusal = next(
            (each for each in fold.not_followed if each.measurement == measurement), None
        )
        track = began if corrected is None or began is not None else corrected.track_id
        of_track = lead if corrected is None else corrected.track_id
        yield make_measured_row(
            measurement,
            frame,
            track=track if is_taken and is_last else None,
            is_taken=is_taken,
            not_taken_because=_reason(frame, measurement, refusal, is_taken=is_taken and is_last),
            nis=None if refusal is None or is_taken else refusal.nis,
            predicted=None if of_track is None else predicted.get(of_track),
            corrected=corrected,
            is_superseded=not is_last,
        )


def _measured(frame: NightFrame, fold: NightFrame) -> list[Measurement]:
    """Measurements offered to the tracker: those detected, as the operator's decision left them.

    Of those below tau the ones that a track took.
    """
    seen = [each for each in frame.measurements if each.source != "operator"]
    if fold.first is None:
        return seen
    decision = fold.first.decision
    if decision is None:
        return seen
    left = [each for each in seen if each not in decision.refused]
    own = decision.taken
    return left if own is None or own in left else [*left, own]


def _reason(
    frame: NightFrame, measurement: Measurement, refusal: NotFollowed | None, *, is_taken: bool
) -> str | None:
    """Reason why it does not count, or why no track took it; None where a track took it."""
    if is_taken:
        return None
    if frame.decision is not None and measurement in frame.decision.refused:
        return f"refused by {frame.decision.by}"
    updates = [each.updated for each in frame.tracks if each.updated is not None]
    of = [each.track_id for each in updates if each.measurement_id == measurement.measurement_id]
    if of:  # taken by nobody: it is shared
        return f"one streak of tracks {' and '.join(map(str, sorted(of)))}"
    return None if refusal is None else text(refusal.reason)


def _firsts(frames: Iterable[NightFrame]) -> dict[str, int]:
    """Track ids by the ids of the measurements of earlier frames with which the tracks began."""
    return {
        each: track.track_id
        for frame in frames
        for track in frame.tracks
        if track.updated is not None and track.updated.begun_with is not None
        for each in (track.updated.begun_with[0], *track.updated.begun_through)
    }
