"""Proposal of Q and R from the innovations of recorded sessions, with its evidence.

The likelihood of the innovations (``_propose_likelihood``) is maximised over Q and R, then over
single terms of them. A change of Q and R is proposed only where chance alone would reach its gain
in at most one night of 20; a separate value of a term, only where chance would in one of 100.
Through the gate, the accepted measurements depend on Q and R too. So the session is replayed with
the result and the search repeated, until the accepted measurements stay the same, in at most
``MAX_ROUNDS`` rounds.
"""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, SessionError
from rsoconsole.pipeline.frame.measurement import usual_timing_sigma_s
from rsoconsole.pipeline.replays.refold import replay
from rsoconsole.pipeline.tuning._propose_likelihood import ReplayedTrack, replayed_tracks
from rsoconsole.pipeline.tuning.propose_inquiry import LEAST, ModelComparison, Proposal
from rsoconsole.records import TrackState
from rsoconsole.session import SessionReader
from rsoconsole.tracking import timing_scatter_words

FIRST_GATE_NIS, GATE_NIS = 50.0, 25.0
"""NIS gates of the first and later rounds: wide, so that an R too small shows."""
MAX_ROUNDS = 3


class _Session:
    def __init__(self, folder: Path) -> None:
        reader = SessionReader(folder)
        self.folder, self.config = folder, reader.config()
        self.records = [record for _, _, record in reader.records()]


def propose(
    folders: Sequence[Path], *, on_evaluation: Callable[[], None] = lambda: None
) -> Proposal:
    """Propose the Q and R with which the innovations of one or several sessions are likeliest.

    The sessions are fitted together and must have one filter preset. ``on_evaluation`` is called
    each time the filter is run over all of them. Raises SessionError for a folder without a
    session, ConfigError where their presets differ.
    """
    if not folders:
        raise SessionError("name at least one session")
    sessions = [_Session(Path(folder)) for folder in folders]
    presets = sorted({session.config.filter.preset for session in sessions})
    if len(presets) > 1:
        what = " and ".join(presets)
        raise ConfigError(f"sessions of the presets {what} share no Q: propose them apart")
    arcs, changes, rounds = _arcs(sessions, None), {}, 0
    inquiry = ModelComparison(arcs, presets[0], on_evaluation)
    evaluations = 0
    while inquiry.count >= LEAST and rounds < MAX_ROUNDS:
        rounds += 1
        changes = inquiry.run()
        evaluations += inquiry.search.evaluations
        again = _arcs(sessions, changes)
        if rounds == MAX_ROUNDS or _taken(again) == _taken(arcs):
            break
        arcs = again
        inquiry = ModelComparison(arcs, presets[0], on_evaluation)
    folders = tuple(session.folder for session in sessions)
    if rounds == 0 or inquiry.count < LEAST:
        return _not_enough(folders, presets[0], inquiry.count, len(arcs))
    proposal = inquiry.proposal(folders, rounds, evaluations)
    return replace(proposal, warnings=(*proposal.warnings, *_learnt(sessions)))


def _learnt(sessions: Sequence[_Session]) -> Iterator[str]:
    """Yield what preset ``adaptive`` has learnt of each night's scatter, and what to do with it."""
    for session in sessions:
        states = (r for r in session.records if isinstance(r, TrackState) and r.mixture is not None)
        last = deque(states, maxlen=1)
        known_s = usual_timing_sigma_s(session.config.exposure)
        words = timing_scatter_words(last[0], known_s) if last else None
        if words is not None:
            yield (
                f"{session.folder.name} has learnt: {words}; put the scatter into"
                " exposure.timing_sigma_s if it is the shutter's"
            )


def _arcs(sessions: Sequence[_Session], changes: Mapping[str, float] | None) -> list[ReplayedTrack]:
    """Return the tracks replayed with the changes; None: with the recorded settings."""
    arcs: list[ReplayedTrack] = []
    wide = FIRST_GATE_NIS if changes is None else GATE_NIS
    for session in sessions:
        gate = max(session.config.filter.gate_nis, wide)
        held = {**(changes or {}), "filter.gate_nis": gate}
        arcs.extend(replayed_tracks(replay(session.records, session.config, changes=held)))
    return arcs


def _taken(arcs: Sequence[ReplayedTrack]) -> list[tuple[Any, ...]]:
    return [(arc.first, arc.second, *arc.measurements) for arc in arcs]


def _not_enough(folders: tuple[Path, ...], preset: str, count: int, tracks: int) -> Proposal:
    return Proposal(
        sessions=folders,
        preset=preset,
        verdict="not enough to say",
        words=f"not enough to say: {count} of the {LEAST} innovations that it takes",
        innovations=count,
        tracks=tracks,
    )
