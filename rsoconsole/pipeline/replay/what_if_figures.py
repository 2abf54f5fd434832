"""A night followed with other settings, in the figures of the night as it was."""

from collections.abc import Iterable, Mapping

from rsoconsole.config import Config
from rsoconsole.night import FigureSum, TrackFigures
from rsoconsole.pipeline.replay.refold import ReplayedFrame, replay
from rsoconsole.records import Record


def once_each(frames: Iterable[ReplayedFrame]) -> list[ReplayedFrame]:
    """In order of their numbers; of a frame that was followed again, what counts in the end."""
    by_number = {each.taken.frame_id: each for each in frames}
    return [by_number[number] for number in sorted(by_number)]


def add_replayed(found: FigureSum, frame: ReplayedFrame) -> None:
    """One frame more."""
    found.add(frame.taken, frame.records, frame.state, frame.solution)


def figures_of(
    frames: Iterable[ReplayedFrame], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """Figures of a night that was followed again, as ``as_recorded`` has it."""
    found = FigureSum(of_lead=of_lead)
    for each in frames:
        add_replayed(found, each)
    return found.figures(last)


def what_if(
    records: Iterable[Record],
    config: Config,
    changes: Mapping[str, float | str],
    last: int | None = None,
    *,
    of_lead: bool = False,
) -> TrackFigures:
    """A night with other settings, as ``as_recorded`` has it. Raises ConfigError for one that
    cannot be."""
    return figures_of(replay(records, config, changes=changes), last, of_lead=of_lead)
