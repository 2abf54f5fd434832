"""A recorded session with other settings: its figures, and the log as it would have been."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.config import Config, with_setting
from rsoconsole.errors import ConfigError, SessionError
from rsoconsole.pipeline.replay.refold import ReplayedFrame, replay
from rsoconsole.pipeline.replay.rerun import RerunCounts, open_rerun
from rsoconsole.pipeline.replay.retell import Retold, retell
from rsoconsole.pipeline.replay.what_if_figures import TrackFigures, figures_of
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
    tried: Mapping[str, float | str]
    before: Mapping[str, Any]
    """What the session began with in their places."""
    recorded: TrackFigures
    what_if: TrackFigures
    is_reproduced: bool
    """Whether the recorded settings give the recorded track again, but for rounding."""
    config: Config
    """The session's, with what was tried."""
    frames: tuple[ReplayedFrame, ...]
    """With what was tried."""
    log: tuple[tuple[int, Any], ...]
    """(t_utc_ns, record) of the whole night, as it would have been."""
    rerun: RerunCounts | None
    """What of the frames was reduced again; None where that was not asked for."""
    model_sha256: str | None
    """Of the network that reduced them; None as ``rerun``."""


def what_if_session(
    folder: Path,
    tried: Mapping[str, float | str] | None = None,
    *,
    detector: bool = False,
    solver: bool = False,
    on_frame: Callable[[], None] = lambda: None,
) -> WhatIf:
    """A session with other settings, by their dotted names.

    ``detector``, ``solver``: run them again over the frames that the session has kept; ``on_frame``
    is called before each frame then. Without them their settings, but for tau, cannot be tried.
    Raises SessionError for a folder that holds no session or one without frames, ConfigError for
    a setting that there is not, that cannot have that value, or that has no part in the track.
    """
    reader = SessionReader(folder)
    config = reader.config()
    tried = dict(tried or {})
    check_tried(tried, config, detector=detector, solver=solver)
    log = [(t_utc_ns, record) for _, t_utc_ns, record in reader.records()]
    recorded = tuple(replay((record for _, record in log), config))
    if not recorded:
        raise SessionError(f"{folder} holds no frame that was followed: there is nothing to try on")
    retold, counts, sha256 = _retold(
        reader, log, config, tried, detector=detector, solver=solver, on_frame=on_frame
    )
    return WhatIf(
        session=Path(folder),
        tried=tried,
        before={name: _value(config, name) for name in tried},
        recorded=figures_of(recorded),
        what_if=figures_of(retold.frames),
        is_reproduced=all(each.is_alike for each in recorded),
        config=retold.config,
        frames=retold.frames,
        log=retold.log,
        rerun=counts,
        model_sha256=sha256,
    )


def _retold(
    reader: SessionReader,
    log: list[tuple[int, Any]],
    config: Config,
    tried: Mapping[str, float | str],
    *,
    detector: bool,
    solver: bool,
    on_frame: Callable[[], None],
) -> tuple[Retold, RerunCounts | None, str | None]:
    if not (detector or solver):
        return retell(log, config, tried=tried), None, None
    begun_with = config
    for name, value in tried.items():
        begun_with = with_setting(begun_with, name, value)
    with open_rerun(
        reader, begun_with, with_detector=detector, with_solver=solver, on_frame=on_frame
    ) as (rerun, sha256):
        retold = retell(log, config, tried=tried, reduce_again=rerun)
    return retold, rerun.counts, sha256


def check_tried(
    tried: Mapping[str, float | str], config: Config, *, detector: bool, solver: bool
) -> None:
    """Raises ConfigError for what cannot be tried, with the reason."""
    reduced = (("detector.", detector, "--detector"), ("solver.", solver, "--solver"))
    for name, value in tried.items():
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
    preset = tried.get("filter.preset", config.filter.preset)
    for name, belongs_to in OF_A_PRESET.items():
        if name in tried and preset != belongs_to:
            raise ConfigError(
                f"{name} belongs to preset {belongs_to}: --preset {belongs_to} has it"
            )


def _value(config: Config, name: str) -> Any:
    section, _, key = name.partition(".")
    return config.model_dump(mode="json")[section][key]
