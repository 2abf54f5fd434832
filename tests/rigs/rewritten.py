"""A log rewritten as a whole, where the program rewrites it record by record."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.pipeline import ReplayedFrame
from rsoconsole.pipeline.replays._rewrite_log import LogRewriter
from rsoconsole.pipeline.replays.refold import ReduceAgain, ReplayState
from rsoconsole.records import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class RewrittenLog:
    """A log, and the replayed frames in it."""

    log: tuple[tuple[int, Record], ...]
    """(t_utc_ns, record), in order."""
    frames: tuple[ReplayedFrame, ...]
    config: Config
    """With the changes: the log begins with it."""


def rewrite_log(
    log: Iterable[tuple[int, Record]],
    config: Config,
    *,
    changes: Mapping[str, float | str] | None = None,
    reduce_again: ReduceAgain | None = None,
) -> RewrittenLog:
    """Retell a log of (t_utc_ns, record); arguments and errors beside it as ``replay``'s."""
    rewritten: list[tuple[int, Record]] = []
    frames: list[ReplayedFrame] = []
    rewriter = LogRewriter(
        ReplayState.begin(config, changes, reduce_again),
        on_record=lambda t_utc_ns, record: rewritten.append((t_utc_ns, record)),
        on_frame=frames.append,
    )
    for t_utc_ns, record in log:
        rewriter.receive(t_utc_ns, record)
    rewriter.close()
    return RewrittenLog(log=tuple(rewritten), frames=tuple(frames), config=rewriter.config)
