"""A session gathered for others: who observed with what, and every measurement that counts."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, assert_never

from rsoconsole import __version__
from rsoconsole.config import Config, ExposureConfig
from rsoconsole.export.rows import MeasuredRow, row_of
from rsoconsole.pipeline.frame import shutter_time, usual_sigma_s
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
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.session.reading import SessionReader, clock_notes

OfFrame: TypeAlias = Measurement | TrackState | NotFollowed | Ruling | FollowedAgain
KINDS = (FrameTaken, Measurement, TrackState, NotFollowed, Ruling, FollowedAgain, Identified)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedNight:
    """What the writers of all formats are given."""

    name: str
    """Of the session's folder."""
    title: str
    config: Config
    about: Mapping[str, Any]
    """What the session says of itself, without its configuration."""
    rows: tuple[MeasuredRow, ...]
    """In order of time."""
    clock_notes: tuple[str, ...] = ()
    """What happened to the clock that all these times are by, a line each."""
    names: Mapping[int, Identified] = field(default_factory=dict)
    """The last name of each track on record, by track id."""
    taken: Mapping[int, FrameTaken] = field(default_factory=dict)
    """The frames, by their numbers."""

    @property
    def tracks(self) -> tuple[int, ...]:
        """Ids of the tracks that took something."""
        return tuple(sorted({row.track for row in self.rows if row.track is not None}))

    def of_track(self, track: int) -> tuple[MeasuredRow, ...]:
        """What it took and what counts, in order of time."""
        return tuple(row for row in self.rows if row.track == track and not row.is_superseded)

    @property
    def is_simulated(self) -> bool:
        """Whether no telescope was there."""
        return self.about.get("is_simulated") is True

    def time_sigma_s(self, row: MeasuredRow) -> float:
        """One sigma of a row's time by the shutter alone."""
        taken = self.taken.get(row.frame_id)
        exposure = self.config.exposure
        if taken is None:
            return exposure.timing_sigma_s
        return shutter_time(taken, exposure).total_sigma_s

    def shutter_sigma_s(self, row: MeasuredRow) -> float:
        """What of it the row's own errors have: the shutter's scatter, without a bias's error."""
        taken = self.taken.get(row.frame_id)
        exposure = self.config.exposure
        return exposure.timing_sigma_s if taken is None else shutter_time(taken, exposure).sigma_s

    def facts(self) -> dict[str, Any]:
        """What a table says of where it comes from; plain values."""
        site, optics = self.config.site, self.config.optics
        facts: dict[str, Any] = {
            "session": self.name,
            "title": self.title,
            "is_simulated": self.is_simulated,
            "is_closed": self.about.get("is_closed") is True,
            "site": site.model_dump(mode="json"),
            "optics": optics.model_dump(mode="json"),
            "exposure_s": self.config.exposure.exposure_s,
            "timing_sigma_s": usual_sigma_s(self.config.exposure),
            **_shutter_facts(self.config.exposure),
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


@dataclass(slots=True, kw_only=True)
class _Followed:
    """What was made of one frame, once."""

    measured: list[Measurement] = field(default_factory=list)
    predicted: dict[int, TrackState] = field(default_factory=dict)
    """By track id."""
    corrected: dict[str, TrackState] = field(default_factory=dict)
    """By the id of the measurement that the track took."""
    shared: dict[str, list[int]] = field(default_factory=dict)
    """By the id of a streak of more than one satellite, the tracks that share it."""
    lead_id: int | None = None
    refusals: dict[int, NotFollowed] = field(default_factory=dict)
    """By the measurement's place in ``measured``; the lead's, which come first."""

    def of(self, measurement: Measurement) -> tuple[TrackState | None, TrackState | None]:
        """Before and after, of the track that took it; before, of the lead, where none did."""
        corrected = self.corrected.get(measurement.measurement_id)
        track_id = self.lead_id if corrected is None else corrected.track_id
        return None if track_id is None else self.predicted.get(track_id), corrected

    def refuse(self, record: NotFollowed) -> None:
        for place, each in enumerate(self.measured):
            if each == record.measurement:
                self.refusals.setdefault(place, record)


@dataclass(slots=True, kw_only=True)
class _FrameStory:
    """A frame, and all that was made of it; the last counts."""

    taken: FrameTaken
    seen: list[Measurement] = field(default_factory=list)
    """By the detector; the operator's own belong to what their decision led to."""
    decision: Ruling | None = None
    folds: list[_Followed] = field(default_factory=lambda: [_Followed()])

    @property
    def last(self) -> _Followed:
        return self.folds[-1]

    def measured_again(self) -> list[Measurement]:
        """What there is to follow by the operator's word."""
        if self.decision is None:
            return list(self.seen)
        left = [m for m in self.seen if m not in self.decision.refused]
        own = self.decision.taken
        return left if own is None or own in left else [*left, own]


def read_night(session: Path, *, everything: bool = False) -> ExportedNight:
    """Gather a session's or a branch's measurements, no matter who took them.

    Without ``everything`` only what counts: not what the operator refused, and of frames that
    were followed again by their decision only the last reading. Raises SessionError.
    """
    reader = SessionReader(session)
    about = reader.about()
    config = reader.config()
    about.pop("config", None)
    stories: dict[int, _FrameStory] = {}
    names: dict[int, Identified] = {}
    for _, _, record in reader.records(kinds=KINDS):
        match record:
            case FrameTaken():
                stories[record.frame_id] = _FrameStory(taken=record)
            case Identified():
                names[record.track_id] = record
            case Measurement() | TrackState() | NotFollowed() | Ruling() | FollowedAgain():
                if record.frame_id in stories:
                    _receive(stories[record.frame_id], record)
            case (
                Detections()
                | Solution()
                | NotSolved()
                | Miss()
                | SlewCommand()
                | StateChange()
                | ParameterChange()
                | OperatorAction()
                | CycleTiming()
                | Closeup()
                | OrbitEstimate()
                | PairMotions()
                | ExpectedMembers()
                | LeapDone()
                | LowPass()
                | Event()
            ):
                pass  # no direction, nor a word on one
            case _:
                assert_never(record)
    rows = sorted(_rows(stories, everything), key=lambda row: row.t_mid_utc_ns)
    name = session.resolve().name
    return ExportedNight(
        name=name,
        title=str(about.get("title") or name),
        config=config,
        about=about,
        rows=tuple(rows),
        taken={frame_id: story.taken for frame_id, story in stories.items()},
        clock_notes=clock_notes(reader),
        names=names,
    )


def _shutter_facts(exposure: ExposureConfig) -> dict[str, Any]:
    """The shutter as it was calibrated; nothing where it was not."""
    if not exposure.calibrated:
        return {}
    return {"shutter": [each.model_dump(mode="json") for each in exposure.calibrated]}


def _receive(story: _FrameStory, record: OfFrame) -> None:
    match record:
        case Measurement():
            if record.source == "network":
                story.seen.append(record)
                story.last.measured.append(record)
        case Ruling():
            story.decision = record
        case FollowedAgain():
            story.folds.append(_Followed(measured=story.measured_again()))
        case NotFollowed():
            story.last.refuse(record)
        case TrackState():
            if record.is_lead:
                story.last.lead_id = record.track_id
            if record.kind == "predicted":
                story.last.predicted[record.track_id] = record
            elif record.measurement_id is not None and record.shared_with is not None:
                story.last.shared.setdefault(record.measurement_id, []).append(record.track_id)
            elif record.measurement_id is not None:
                story.last.corrected[record.measurement_id] = record
        case _:
            assert_never(record)


def _rows(stories: Mapping[int, _FrameStory], everything: bool) -> Iterator[MeasuredRow]:
    firsts = _firsts(stories)
    for story in stories.values():
        for fold in story.folds:
            is_last = fold is story.last
            if is_last or everything:
                yield from _rows_of(story, fold, firsts if is_last else {})


def _rows_of(
    story: _FrameStory,
    fold: _Followed,
    firsts: Mapping[str, int],
) -> Iterator[MeasuredRow]:
    is_last = fold is story.last
    for place, measurement in enumerate(fold.measured):
        began = firsts.get(measurement.measurement_id)
        predicted, corrected = fold.of(measurement)
        is_taken = corrected is not None or began is not None
        refusal = fold.refusals.get(place)
        track = began
        if began is None and corrected is not None:
            track = corrected.track_id
        yield row_of(
            measurement,
            story.taken,
            track=track if is_taken and is_last else None,
            is_taken=is_taken,
            reason=_reason(story, measurement, refusal, is_taken=is_taken and is_last),
            nis=None if refusal is None or is_taken else refusal.nis,
            predicted=predicted,
            corrected=corrected,
            is_superseded=not is_last,
        )


def _reason(
    story: _FrameStory, measurement: Measurement, refusal: NotFollowed | None, *, is_taken: bool
) -> str | None:
    """Why it does not count, or why no track took it."""
    if is_taken:
        return None
    if story.decision is not None and measurement in story.decision.refused:
        return f"refused by {story.decision.by}"
    if (of := story.last.shared.get(measurement.measurement_id)) is not None:
        return f"one streak of tracks {' and '.join(map(str, sorted(of)))}"
    return None if refusal is None else text(refusal.reason)


def _firsts(stories: Mapping[int, _FrameStory]) -> dict[str, int]:
    """By id: the measurements of earlier frames with which tracks began, and those tracks."""
    return {
        each: state.track_id
        for story in stories.values()
        for state in story.last.corrected.values()
        if state.begun_with is not None
        for each in (state.begun_with[0], *state.begun_through)
    }
