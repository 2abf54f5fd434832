"""A recorded session with other settings: its figures, and the log as it would have been."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.config import Config, with_changes, with_setting
from rsoconsole.errors import ConfigError, SessionError
from rsoconsole.night import FigureSum, TrackFigures
from rsoconsole.pipeline.replay.refold import LookedAt, ReduceAgain, ReplayedFrame, Walk
from rsoconsole.pipeline.replay.rerun import RerunCounts, open_rerun
from rsoconsole.pipeline.replay.rewrite_log import LogRewriter
from rsoconsole.pipeline.replay.what_if_figures import add_replayed
from rsoconsole.records import Record
from rsoconsole.session.reading import SessionReader

OF_THE_FOLD = (
    "filter.",
    "search.follow",
    "detector.tau",
    "exposure.calibrated",
    "exposure.header_latency_s",
    "exposure.timing_sigma_s",
    "exposure.line_time_us",
    "optics.focal_length_mm",
    "optics.pixel_um",
    "site.",
)
"""Settings that have a part in what is followed, by how their names begin."""
OF_A_PRESET = {"filter.sigma_arcsec": "paper", "filter.q_arcsec2_s3": "tuned"}


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIf:
    """A session as it was recorded and as it would have been."""

    session: Path
    changes: Mapping[str, float | str]
    before: Mapping[str, Any]
    """What the session began with in their places."""
    recorded: TrackFigures
    what_if: TrackFigures
    is_reproduced: bool
    """Whether the recorded settings give the recorded track again, but for rounding."""
    config: Config
    """The session's, with what was tried."""
    frames: tuple[ReplayedFrame, ...]
    """With what was tried; empty where they were not kept."""
    log: tuple[tuple[int, Any], ...]
    """(t_utc_ns, record) of the whole night, as it would have been; empty where not kept."""
    is_kept: bool
    """Whether frames and log are here: of a long night they are large."""
    rerun: RerunCounts | None
    """What of the frames was reduced again; None where that was not asked for."""
    model_sha256: str | None
    """Of the network that reduced them; None as ``rerun``."""


def what_if_session(
    folder: Path,
    changes: Mapping[str, float | str] | None = None,
    *,
    detector: bool = False,
    solver: bool = False,
    keep: bool = True,
    on_frame: Callable[[], None] = lambda: None,
) -> WhatIf:
    """A session with other settings, by their dotted names.

    ``detector``, ``solver``: run them again over the frames that the session has kept; ``on_frame``
    is called before each frame then. Without them their settings, but for tau, cannot be tried.
    ``keep``: frames and log too; without them a night takes little memory however long it is.
    Raises SessionError for a folder that holds no session or one without frames, ConfigError for
    a setting that there is not, that cannot have that value, or that has no part in the track.
    """
    reader = SessionReader(folder)
    config = reader.config()
    changes = dict(changes or {})
    check_changes(changes, config, detector=detector, solver=solver)
    frames: list[ReplayedFrame] = []
    log: list[tuple[int, Record]] = []
    both = _Both(config, keep=(frames, log) if keep else None)
    counts, sha256 = None, None
    if detector or solver:
        begun_with = with_changes(config, changes)
        with open_rerun(
            reader, begun_with, with_detector=detector, with_solver=solver, on_frame=on_frame
        ) as (rerun, sha256):
            begun_with = both.go_through(reader, changes, rerun)
        counts = rerun.counts
    else:
        begun_with = both.go_through(reader, changes, None)
    if not len(both.recorded):
        raise SessionError(f"{folder} holds no frame that was followed: there is nothing to try on")
    return WhatIf(
        session=Path(folder),
        changes=changes,
        before={name: _value(config, name) for name in changes},
        recorded=both.recorded.figures(),
        what_if=both.changed.figures(),
        is_reproduced=both.is_reproduced,
        config=begun_with,
        frames=tuple(frames),
        log=tuple(log),
        is_kept=keep,
        rerun=counts,
        model_sha256=sha256,
    )


class _Both:
    """One way through a log: followed with the recorded settings, and rewritten with others."""

    def __init__(
        self,
        config: Config,
        keep: tuple[list[ReplayedFrame], list[tuple[int, Record]]] | None,
    ) -> None:
        self._config, self._keep = config, keep
        self.recorded, self.changed = FigureSum(), FigureSum()
        self.is_reproduced = True

    def go_through(
        self,
        reader: SessionReader,
        changes: Mapping[str, float | str],
        reduce_again: ReduceAgain | None,
    ) -> Config:
        """Each record is read once; the configuration that the other log begins with."""
        walk = Walk.begin(self._config)
        rewriter = LogRewriter(
            Walk.begin(self._config, changes, reduce_again),
            on_record=self._keep_record,
            on_frame=self._add_changed,
        )
        for _, t_utc_ns, record in reader.records():
            self._add_recorded(walk.receive(record))
            rewriter.receive(t_utc_ns, record)
        self._add_recorded(walk.close())
        rewriter.close()
        return rewriter.config

    def _add_recorded(self, closed: Iterable[ReplayedFrame | LookedAt]) -> None:
        for each in closed:
            if isinstance(each, ReplayedFrame):
                self.is_reproduced = self.is_reproduced and each.is_alike
                add_replayed(self.recorded, each)

    def _add_changed(self, frame: ReplayedFrame) -> None:
        add_replayed(self.changed, frame)
        if self._keep is not None:
            self._keep[0].append(frame)

    def _keep_record(self, t_utc_ns: int, record: Record) -> None:
        if self._keep is not None:
            self._keep[1].append((t_utc_ns, record))


def rewritten_log(what_if: WhatIf) -> Iterator[tuple[int, Record]]:
    """The log of a what-if as it would have been: what was kept, else it is made once more.

    Raises ValueError where that would mean to reduce all frames once more.
    """
    if what_if.is_kept:
        yield from what_if.log
        return
    if what_if.rerun is not None:
        raise ValueError("frames were reduced again for it: its log must be kept")
    reader, rewritten = SessionReader(what_if.session), list[tuple[int, Record]]()
    rewriter = LogRewriter(
        Walk.begin(reader.config(), what_if.changes),
        on_record=lambda t_utc_ns, record: rewritten.append((t_utc_ns, record)),
        on_frame=lambda _: None,
    )
    for _, t_utc_ns, record in reader.records():
        rewriter.receive(t_utc_ns, record)
        yield from rewritten
        rewritten.clear()
    rewriter.close()
    yield from rewritten


def check_changes(
    changes: Mapping[str, float | str], config: Config, *, detector: bool, solver: bool
) -> None:
    """Raises ConfigError for what cannot be tried, with the reason."""
    reduced = (("detector.", detector, "--detector"), ("solver.", solver, "--solver"))
    for name, value in changes.items():
        with_setting(config, name, value)
        if name.startswith(OF_THE_FOLD):
            continue
        for prefix, is_rerun, option in reduced:
            if name.startswith(prefix) and not is_rerun:
                raise ConfigError(f"{name} changes what frames show: {option} runs them again")
            if name.startswith(prefix):
                break
        else:
            raise ConfigError(f"{name} has no part in what is followed: there is nothing to try")
    preset = changes.get("filter.preset", config.filter.preset)
    for name, belongs_to in OF_A_PRESET.items():
        if name in changes and preset != belongs_to:
            raise ConfigError(
                f"{name} belongs to preset {belongs_to}: --preset {belongs_to} has it"
            )


def _value(config: Config, name: str) -> Any:
    section, _, key = name.partition(".")
    return config.model_dump(mode="json")[section][key]
