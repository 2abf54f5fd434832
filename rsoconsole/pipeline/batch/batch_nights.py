"""Nights of recorded frames, each made into a session; sessions already made are skipped.

A session is written in a temporary folder and renamed when it is complete: an interruption of any
kind leaves no half-made session, and the night is processed again from its start.
"""

import contextlib
import glob
import hashlib
import json
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from rsoconsole import __version__
from rsoconsole.base import (
    BatchError,
    FrameError,
    RsoconsoleError,
    SessionError,
    lock_file,
    system_errors_as,
)
from rsoconsole.config import Config
from rsoconsole.night import TrackFigures
from rsoconsole.pipeline.batch.batch_pool import (
    ProcessedFrame,
    WorkerPool,
    process_files,
    run_tasks,
)
from rsoconsole.pipeline.frame.frame_site import site_of_frames
from rsoconsole.pipeline.frame.reduce import open_reducer
from rsoconsole.pipeline.replays.branches import new_branch_folder, save_branch
from rsoconsole.pipeline.replays.what_if_log import RerunCounts, what_if_session
from rsoconsole.records import Detections, Event, FrameTaken, Measurement, Miss, StateChange
from rsoconsole.session import DATABASE, BatchRecording, SessionReader, replace_folder
from rsoconsole.vision import Network

FRAME_SUFFIXES = (".fits", ".fit", ".fts", ".fz", ".gz", ".bz2", ".tif", ".tiff", ".png")
LOCK = ".batch.lock"
_DIGITS = re.compile(r"(\d+)")

State: TypeAlias = Literal["done", "skipped", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchNight:
    """One night's frames, and the session to make of them."""

    source: Path
    session: Path
    frames: tuple[tuple[int, Path], ...]
    """(number, file) of each frame, in order."""
    config: Config
    is_again: bool = False
    """True where a session that exists already is made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NightOutcome:
    """Result of processing one night, with the figures of its session."""

    source: Path
    session: Path
    state: State
    frames: int = 0
    unreadable: tuple[str, ...] = ()
    detections: int = 0
    measurements: int = 0
    misses: int = 0
    without_time: int = 0
    """Number of frames without a time of exposure, which measure nothing."""
    locked_after_frames: int | None = None
    last_state: str | None = None
    error: str | None = None
    """Reason why no session was made of the night; None where one was."""


def nights_of_folders(
    folders: Sequence[Path], root: Path, config: Config, *, is_again: bool = False
) -> tuple[BatchNight, ...]:
    """Return a night for each folder, of frames or of a session that has kept its frames.

    ``root``: folder in which the sessions are made; ``is_again``: True to make existing sessions
    again. Frames are in the order of their names, with numbers compared as numbers. Raises
    BatchError where two folders would become the same session.
    """
    nights = tuple(
        BatchNight(
            source=folder,
            session=root / folder.resolve().name,
            frames=_frames_in(folder.resolve()),
            config=config,
            is_again=is_again,
        )
        for folder in folders
    )
    names = [night.session.name for night in nights]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BatchError(f"two nights would become the session '{twice[0]}': rename one folder")
    return nights


def process_nights(
    nights: Sequence[BatchNight],
    pool_of: Callable[[int], WorkerPool],
    *,
    on_done: Callable[[], None] = lambda: None,
) -> Iterator[NightOutcome]:
    """Process the nights and yield their outcomes in order.

    ``pool_of``: returns a pool for a number of nights, those already done not counted. ``on_done``:
    called once for each night. Raises BatchError where there is no worker.
    """
    done = [_already_done(night) for night in nights]
    todo = [night for night, outcome in zip(nights, done, strict=True) if outcome is None]
    for night in nights:  # those that are done too: two workers may have had one
        for left in night.session.parent.glob(f".{glob.escape(night.session.name)}.*part"):
            shutil.rmtree(left, ignore_errors=True)  # of work that was ended
    paths = [path for night in todo for path in (night.session.parent, night.source)]
    outcomes = run_tasks(
        process_night, todo, pool_of(len(todo)), failed=failed_night, paths=paths, on_done=on_done
    )
    for outcome in done:
        if outcome is not None:
            on_done()
        yield next(outcomes) if outcome is None else outcome


def _already_done(night: BatchNight) -> NightOutcome | None:
    """Outcome of a night already made; None where there is work or an error to report."""
    if night.is_again or not (night.session / DATABASE).exists():
        return None
    try:
        made = SessionReader(night.session).read_meta()
        return _outcome(night, "skipped") if _is_made(made, _identity(night)) else None
    except RsoconsoleError:
        return None


def _is_made(about: dict[str, Any], identity: dict[str, Any]) -> bool:
    """True where a session is complete and was made of just these frames by just these settings."""
    return about.get("batch") == identity and about.get("is_closed") is True


def process_night(night: BatchNight) -> NightOutcome:
    """Process one night into a session; a failure of any kind gives a failed outcome.

    Unless ``night.is_again``, a session that exists already is a failure.
    """
    try:
        return _processed(night)
    except (RsoconsoleError, OSError) as error:
        return failed_night(night, str(error))
    except Exception as error:  # one night must not end the others
        return failed_night(night, f"something broke: {type(error).__name__}: {error}")


def failed_night(night: BatchNight, reason: str) -> NightOutcome:
    """Return the outcome of a night that failed for this reason."""
    return NightOutcome(source=night.source, session=night.session, state="failed", error=reason)


@contextlib.contextmanager
def lock_batch_folder(root: Path) -> Iterator[None]:
    """Lock a folder against other batches for the time of the context.

    Raises BatchError where another batch has locked it, or where it cannot be locked.
    """
    try:
        root.mkdir(parents=True, exist_ok=True)
        lock = lock_file(root / LOCK)
    except BlockingIOError as error:
        raise BatchError(f"another batch works in {root}: wait for it to end") from error
    except OSError as error:
        raise BatchError(f"{root} cannot hold sessions: {error}") from error
    try:
        yield
    finally:
        os.close(lock)


def _processed(night: BatchNight) -> NightOutcome:
    if not night.frames:
        raise FrameError(f"{night.source} holds no frame: name folders of FITS, TIFF or PNG files")
    identity = _identity(night)
    if (night.session / DATABASE).exists():
        made = SessionReader(night.session).read_meta()
        if "batch" not in made:
            raise SessionError(f"{night.session} holds a session that no batch has made")
        if not night.is_again and _is_made(made, identity):
            return _outcome(night, "done")  # by a worker that died before it could say so
        if not night.is_again:
            raise SessionError(
                f"{night.session} was made of other frames, by other settings or another version:"
                " --again makes it again"
            )
    elif night.session.exists():
        raise SessionError(f"{night.session} is there and holds no session: move it away")
    # Its own: a worker that was given up may write on, and neither may touch the other's.
    beside = night.session.with_name(f".{night.session.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        _record(night, beside, identity)
        replace_folder(beside, night.session)
    except BaseException:
        shutil.rmtree(beside, ignore_errors=True)
        raise
    return _outcome(night, "done")


def _record(night: BatchNight, folder: Path, identity: dict[str, Any]) -> None:
    place = site_of_frames([path for _, path in night.frames], night.config)
    one_thread = night.config.detector.model_copy(update={"threads": 1})
    config = place.config.model_copy(update={"detector": one_thread})
    with open_reducer(config) as (reducer, sha256):
        recording = BatchRecording(
            folder, place.config, sha256, title=night.session.name, batch=identity
        )
        is_usable, first_error = False, ""
        numbers, paths = zip(*night.frames, strict=True)
        try:
            for result in process_files(paths, reducer, config, numbers=numbers):
                if isinstance(result, ProcessedFrame):
                    is_usable = True
                    recording.append(result.records, result.t_mid_utc_ns)
                else:
                    path, error = result
                    first_error = first_error or str(error)
                    recording.append((Event(level="warning", text=f"{path.name}: {error}"),), None)
        finally:
            recording.close()
    if not is_usable:
        raise FrameError(f"none of its {len(paths)} frames can be used; the first: {first_error}")
    if recording.faults:
        raise SessionError("; ".join(recording.faults))


def _outcome(night: BatchNight, state: State) -> NightOutcome:
    reader = SessionReader(night.session)
    frames = detections = measurements = misses = timeless = 0
    locked: int | None = None
    last = "SEARCH"
    unreadable = []
    # Other events are news of a night that went well, such as an orbit.
    of_a_frame = tuple(f"{path.name}: " for _, path in night.frames)
    kinds = (FrameTaken, Detections, Measurement, Miss, StateChange, Event)
    for _, _, record in reader.records(kinds=kinds):
        match record:
            case FrameTaken():
                frames += 1
                timeless += record.t_start_utc_ns is None or record.exposure_s is None
            case Detections():
                detections += len(record.detections)
            case Measurement():
                measurements += 1
            case Miss():
                misses += 1
            case StateChange():
                last = record.after
                if record.after == "TRACK" and locked is None:
                    locked = record.frame_id
            case Event() if record.level == "warning" and record.text.startswith(of_a_frame):
                unreadable.append(record.text)
    return NightOutcome(
        source=night.source,
        session=night.session,
        state=state,
        frames=frames,
        unreadable=tuple(unreadable),
        detections=detections,
        measurements=measurements,
        misses=misses,
        without_time=timeless,
        locked_after_frames=locked,
        last_state=last,
    )


def _identity(night: BatchNight) -> dict[str, Any]:
    """Return the identity of a night: frames, settings, network and version."""
    network = Network.load(night.config.detector.model, 1)
    frames = []
    for number, path in night.frames:
        with system_errors_as(FrameError, f"{path} cannot be read: "):
            found = path.stat()
        frames.append([number, path.name, found.st_size, found.st_mtime_ns])
    return {
        "frames": len(frames),
        "frames_sha256": _digest(frames),
        "config_sha256": _digest(night.config.model_dump(mode="json")),
        "model_sha256": str(network.card["sha256"]),
        "verifier_sha256": "" if network.verifier is None else network.verifier.card["sha256"],
        "version": __version__,
    }


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _frames_in(folder: Path) -> tuple[tuple[int, Path], ...]:
    if (folder / DATABASE).exists():
        reader = SessionReader(folder)
        taken = (record for _, _, record in reader.records(kinds=(FrameTaken,)))
        numbers = [each.frame_id for each in taken if isinstance(each, FrameTaken)]
        kept = ((number, reader.frame_path(number)) for number in numbers)
        return tuple((number, path) for number, path in kept if path is not None)
    with system_errors_as(BatchError, f"{folder} cannot be looked into: "):
        paths = [
            p
            for p in folder.iterdir()
            if p.is_file()
            and not p.name.startswith(".")
            and p.name.lower().endswith(FRAME_SUFFIXES)
        ]
    return tuple(enumerate(sorted(paths, key=lambda path: _natural(path.name)), start=1))


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a sort key that puts frame_2 before frame_10."""
    parts = _DIGITS.split(name.lower())
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts if part]


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchWhatIf:
    """Task of a batch: a what-if of one session.

    The fields are the arguments of ``what_if_session``; ``save`` and ``force`` those of
    ``save_branch``.
    """

    session: Path
    changes: Mapping[str, float | str] = field(default_factory=dict)
    detector: bool = False
    solver: bool = False
    save: str | None = None
    force: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIfFigures:
    """Figures of a what-if, without the frames and the log, which may be large."""

    changes: Mapping[str, float | str]
    before: Mapping[str, object] = field(default_factory=dict)
    recorded: TrackFigures | None = None
    what_if: TrackFigures | None = None
    is_reproduced: bool = False
    rerun: RerunCounts | None = None
    branch: Path | None = None
    error: str | None = None
    """Reason why the what-if failed; None where it succeeded."""


def run_what_if(
    question: BatchWhatIf, on_frame: Callable[[], None] = lambda: None
) -> WhatIfFigures:
    """Run a what-if and return its figures; an error is returned in their field ``error``.

    Where ``question.save`` is a name, the what-if is saved as a branch of that name.
    """
    try:
        if question.save is not None:
            new_branch_folder(question.session, question.save, force=question.force)
        found = what_if_session(
            question.session,
            question.changes,
            detector=question.detector,
            solver=question.solver,
            # Frames that were reduced again are not reduced a second time to be written.
            keep=question.save is not None and (question.detector or question.solver),
            on_frame=on_frame,
        )
        branch = None
        if question.save is not None:
            branch = save_branch(found, question.save, force=question.force)
    except (RsoconsoleError, OSError) as error:
        return failed_what_if(question, str(error))
    return WhatIfFigures(
        changes=dict(found.changes),
        before=dict(found.before),
        recorded=found.recorded,
        what_if=found.what_if,
        is_reproduced=found.is_reproduced,
        rerun=found.rerun,
        branch=branch,
    )


def failed_what_if(question: BatchWhatIf, reason: str) -> WhatIfFigures:
    """Return the figures of a what-if that failed for this reason."""
    return WhatIfFigures(changes=dict(question.changes), error=reason)
