"""The operator's decisions on a frame's streaks: chosen, accepted, rejected, marked by hand.

Each makes a ``Ruling`` on one of the last frames; that frame and those after it are then followed
once more. Without autonomy, two decisions make a track that can be followed later. Nothing here
moves the mount. Decisions are executed on the loop's thread; the wire's threads only check them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from rsoconsole.config import Config
from rsoconsole.control import (
    Accept,
    BeginMark,
    ChooseStreak,
    Decision,
    DropTrack,
    KeepTrack,
    MarkByHand,
    Reject,
    WithdrawDecisions,
)
from rsoconsole.engine.aim.states import Followed, Marked
from rsoconsole.engine.operator._hand_marks import (
    better_measurement,
    decision_from_mark,
    decision_result,
    detected_measurement,
    detection_of,
    largest_sigma_arcsec,
    mark_from_detection,
    measure_accepted,
    unfollowed_frame_result,
    with_mark_figures,
)
from rsoconsole.engine.operator.handlers import (
    Accepted,
    Handler,
    Handlers,
    LoopControl,
    RefusedError,
)
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.pipeline import (
    Cycle,
    FollowedFrames,
    FrameObservations,
    UntrackedFrames,
    refined_mark,
)
from rsoconsole.records import (
    BelowTau,
    Cause,
    CommandResult,
    Detection,
    Measurement,
    PixelArray,
    RuledKind,
    Ruling,
    StateChange,
    measurement_id_of,
)
from rsoconsole.tracking import Following
from rsoconsole.words import error_figure, text


def track_decision(
    word: DropTrack | KeepTrack,
    shown: FrameObservations,
    following: Following,
    by: str,
    config: Config,
) -> Ruling:
    """Return the decision to drop or keep one track; earlier decisions on the frame stay.

    ``word``: the command; ``shown``: the frame and what was observed in it. Raises ValueError where
    there is no such track, or nothing changes.
    """
    frame_id = shown.taken.frame_id
    before = shown.decision or Ruling(frame_id=frame_id)
    number = word.track
    if isinstance(word, DropTrack) and word.off:
        left = tuple(each for each in before.dropped if each != number)
        return replace(before, dropped=left, by=by)
    known = {each.track.track_id: each for each in following.tracks}
    if number not in known:
        alive = " ".join(map(str, sorted(known)))
        which = f"those followed are {alive}" if alive else "nothing is followed"
        raise ValueError(f"no track {number} is followed: {which}")
    if config.search.follow != "nearest":
        raise ValueError(
            f"search.follow is {config.search.follow!r}: no track is its own there,"
            " choose a streak instead"
        )
    if isinstance(word, DropTrack):
        return replace(before, dropped=(*before.dropped, number), by=by)
    is_kept = known[number].is_kept
    if is_kept is not bool(word.off):
        raise ValueError(f"track {number} is {'kept already' if is_kept else 'not kept'}")
    kept = tuple(each for each in before.kept if each != number)
    released = tuple(each for each in before.released if each != number)
    if word.off:
        return replace(before, kept=kept, released=(*released, number), by=by)
    return replace(before, kept=(*kept, number), released=released, by=by)


def decided_frame_id(word: DropTrack | KeepTrack, decisions: Sequence[Ruling]) -> int | None:
    """Return the number of the frame that a command to drop or keep a track is about.

    For a drop that is taken back this is the frame of that drop; else the command's own frame.
    Raises ValueError where no such drop is found.
    """
    if not (isinstance(word, DropTrack) and word.off):
        return word.frame_id
    found = [each.frame_id for each in decisions if word.track in each.dropped]
    if not found:
        raise ValueError(
            f"track {word.track} has not been dropped in the last frames:"
            " follow its streak in the picture instead"
        )
    return found[-1]


def with_track_decisions(decision: Ruling, before: Ruling | None) -> Ruling:
    """Return a decision on streaks, completed by the frame's earlier decisions on tracks."""
    if before is None:
        return decision
    return replace(decision, dropped=before.dropped, kept=before.kept, released=before.released)


def track_result_kind(word: DropTrack | KeepTrack) -> RuledKind:
    """Return the kind of result that a command to drop or keep a track has."""
    if isinstance(word, DropTrack):
        return "taken up again" if word.off else "dropped"
    return "released" if word.off else "kept"


NEAR_PX = 25.0
"""Greatest distance of a chosen streak from the pixel at which the operator points, px."""
MAX_MARKED = 2
"""Number of frames whose pixels are kept for marking; a large camera's frame takes 120 MB."""
PixelsOf = Callable[[int], PixelArray | None]
"""The pixels of a frame by its number, (height, width) ADU; None where they were not kept."""


Frames: TypeAlias = FollowedFrames | UntrackedFrames
"""The last frames that accept a decision; each method raises ValueError for other frames."""


class Decisions:
    """Executes the operator's decisions on frames, and has later frames followed again."""

    def __init__(
        self,
        control: LoopControl,
        cycle: Cycle,
        session_log: SessionLog,
        pixels_of: PixelsOf = lambda _frame_id: None,
    ) -> None:
        self._control = control
        self._cycle = cycle
        self._session_log = session_log
        self._pixels_of = pixels_of
        self._marked_pixels: Mapping[int, PixelArray] = {}
        """Pixels of the frames being marked, by frame number, where the session would drop them."""

    @property
    def handlers(self) -> Handlers:
        """Handlers of the commands on streaks and tracks, by class."""
        handler = Handler(check=self._check, execute=self._rule)
        mark = Handler(check=self._check_mark, execute=self._rule)
        commands = (ChooseStreak, Accept, Reject, WithdrawDecisions, DropTrack, KeepTrack)
        return {MarkByHand: mark, **dict.fromkeys(commands, handler)}

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames that still accept a decision, oldest first."""
        return self._frames.frame_ids()

    @property
    def _frames(self) -> Frames:
        """Return the frames of the fold under autonomy, else those taken by hand."""
        is_autonomous = self._control.authority.is_autonomous
        return self._cycle.folds if is_autonomous else self._cycle.hand

    def begin_mark(self, begun: BeginMark) -> int:
        """Keep the frame in which the operator begins a mark, or stop keeping it.

        Returns the frame's number; may be called from any thread. Raises ValueError where the frame
        accepts no mark any more.
        """
        frames = self._frames
        shown = (
            frames.newest_observations() if begun.frame_id is None else frames.shown(begun.frame_id)
        )
        frame_id = shown.taken.frame_id
        others = {n: pixels for n, pixels in self._marked_pixels.items() if n != frame_id}
        if not begun.is_on:
            frames.release_frame(frame_id)
            self._marked_pixels = others
            return frame_id
        frames.hold_frame(frame_id)
        try:
            frames.shown(frame_id)
        except ValueError:  # a newer one has taken its place at this very moment
            frames.release_frame(frame_id)
            raise
        if self._control.config.session.keep_frames == "last":
            pixels = self._pixels_of(frame_id)
            kept = list(others.items())[1 - MAX_MARKED :]
            self._marked_pixels = dict(kept) if pixels is None else {**dict(kept), frame_id: pixels}
        return frame_id

    def _check(self, command: Decision, by: str) -> Accepted:
        """Check a decision, and fix its frame, before it is queued."""
        decision = self._decision(command, by)
        # The frame it was said of: another may be there before the loop comes to it.
        pinned = replace(command, frame_id=decision.frame_id)
        return Accepted(message="taken up with the next frame", command=pinned)

    def _check_mark(self, mark: MarkByHand, by: str) -> Accepted:
        """Check a mark by hand: refine it on the image, and compare it with known measurements.

        Raises RefusedError, which a console may answer with the same mark and ``replaces``.
        """
        decision = self._decision(mark, by)
        shown = self._frames.shown(decision.frame_id)
        pinned, how = replace(mark, frame_id=decision.frame_id), "no light stands out beneath it"
        marked = self._marked_pixels.get(decision.frame_id)
        pixels = self._pixels_of(decision.frame_id) if marked is None else marked
        rough = detection_of(pinned, decision.frame_id)
        if pixels is None:
            how = "the frame's pixels are not kept: it stays as you made it"
        else:
            fwhm_px = shown.detections.star_fwhm_px
            found = refined_mark(pixels, rough, star_fwhm_px=fwhm_px)
            if found is not None:
                pinned, how = mark_from_detection(pinned, found), "refined on the light beneath it"
        decision = self._decision(pinned, by)
        assert decision.taken is not None
        sigma = largest_sigma_arcsec(decision.taken)
        better = better_measurement(
            decision.taken, shown, self._frames.accepted_measurement(decision.frame_id)
        )
        if better is not None and not mark.replaces:
            raise RefusedError(
                f"yours is ±{error_figure(sigma)}″, frame {decision.frame_id} has"
                f" ±{error_figure(largest_sigma_arcsec(better))}″: mark it as replacing that",
                {
                    "asks": "replaces",
                    "sigma_arcsec": sigma,
                    "better_arcsec": largest_sigma_arcsec(better),
                    "how": how,
                },
            )
        message = f"taken up with the next frame: ±{error_figure(sigma)}″, {how}"
        return Accepted(message=message, command=pinned)

    def _rule(self, command: Decision, by: str) -> CommandResult:
        """Apply a decision, in force for the order after the next frame; return its result."""
        decision = self._decision(command, by)
        if not isinstance(command, MarkByHand):
            return self._follow_again(command, decision)
        frame_id, mark = decision.frame_id, decision.taken
        self._marked_pixels = {n: p for n, p in self._marked_pixels.items() if n != frame_id}
        assert mark is not None
        shown, taken = self._frames.shown(frame_id), self._frames.accepted_measurement(frame_id)
        result = self._follow_again(command, decision)
        return with_mark_figures(result, mark, detected_measurement(mark, shown, taken))

    def _follow_again(self, command: Decision, decision: Ruling) -> CommandResult:
        """Follow the frames again by a decision, in whatever state the engine is."""
        before = self._control.following
        if not self._control.authority.is_autonomous:
            return self._rule_by_hand(decision)
        after, records = self._cycle.apply_decision(decision)
        result = decision_result(decision, records)
        if isinstance(command, DropTrack | KeepTrack):
            result = replace(result, ruled=track_result_kind(command), left_alone=0)
        others = {each.track.track_id for each in before.tracks[1:]}
        if decision.taken is not None and after.track_id in others:
            result = CommandResult(kind="ruled", ruled="leads", frame_id=decision.frame_id)
        self._session_log.append(decision)
        if after.state != before.state:
            # Before the first frame that is followed again: behind it stand the fold's own.
            change = StateChange(
                frame_id=decision.frame_id,
                before=before.state,
                after=after.state,
                reason=Cause(kind="operator's word", detail=text(result)),
            )
            self._session_log.append(change)
        for record in records[1:]:
            self._session_log.append(record)
        self._control.handle(Followed(after=after))
        return result

    def _rule_by_hand(self, decision: Ruling) -> CommandResult:
        """Apply a decision on a frame taken without autonomy; marks alone make the kept track."""
        authority = self._control.authority
        kept, records = self._cycle.apply_hand_decision(
            decision, authority.kept, authority.following.last_track_id
        )
        for record in records:
            self._session_log.append(record)
        self._control.handle(Marked(kept=kept))
        return unfollowed_frame_result(decision, records)

    def _decision(self, command: Decision, by: str) -> Ruling:
        """Return the decision that a command makes. Raises ValueError where it cannot be made."""
        if isinstance(command, DropTrack | KeepTrack) and not self._control.authority.is_autonomous:
            raise ValueError("nothing is followed: autonomy does not have the mount")
        if isinstance(command, DropTrack | KeepTrack):
            of = decided_frame_id(command, self._cycle.folds.decisions())
            command = replace(command, frame_id=of)
        folds, following = self._frames, self._control.following
        config = self._control.config
        match command:
            case DropTrack() | KeepTrack():
                return track_decision(command, _frame(command, folds), following, by, config)
            case WithdrawDecisions():
                return _take_back(command, folds, by)
            case ChooseStreak():
                made = _choose(_frame(command, folds), command, by, config)
            case Accept():
                made = _accept(_frame(command, folds), folds, by, config)
            case Reject():
                made = _reject(command, folds, following, by)
            case MarkByHand():
                made = decision_from_mark(_frame(command, folds), command, by, config)
            case _:
                raise TypeError(f"{command.verb} is no word on a frame")
        return with_track_decisions(made, folds.shown(made.frame_id).decision)


def _take_back(command: WithdrawDecisions, folds: Frames, by: str) -> Ruling:
    """Return a decision without content: the detector's result alone counts for the frame again."""
    frame_id = folds.last_decided_frame_id() if command.frame_id is None else command.frame_id
    if frame_id is None:
        raise ValueError("nothing has been said of the last frames that could be taken back")
    if folds.shown(frame_id).decision is None:
        raise ValueError(f"nothing was said of frame {frame_id} that could be taken back")
    return Ruling(frame_id=frame_id, by=by)


def _frame(command: Decision, folds: Frames) -> FrameObservations:
    return (
        folds.newest_observations() if command.frame_id is None else folds.shown(command.frame_id)
    )


def _choose(shown: FrameObservations, choice: ChooseStreak, by: str, config: Config) -> Ruling:
    """Return the decision to follow the streak nearest to a place."""
    x_px, y_px = choice.x_px, choice.y_px
    found = shown.detections
    candidates = [*found.detections, *(each.detection for each in found.rejected)]
    near = min(candidates, key=lambda d: math.hypot(d.x_px - x_px, d.y_px - y_px), default=None)
    if near is None or math.hypot(near.x_px - x_px, near.y_px - y_px) > NEAR_PX:
        raise ValueError(
            f"frame {shown.taken.frame_id} has no streak at {x_px:.0f}, {y_px:.0f}:"
            " point at one, or mark it by hand"
        )
    return Ruling(frame_id=shown.taken.frame_id, taken=_measurement_of(near, shown, config), by=by)


def _accept(shown: FrameObservations, folds: Frames, by: str, config: Config) -> Ruling:
    """Return the decision to accept the likeliest streak that the track did not take."""
    refused = shown.decision.refused if shown.decision is not None else ()
    already = folds.accepted_measurement(shown.taken.frame_id)
    out = {(m.x_px, m.y_px) for m in (*refused, already) if m is not None}
    measured = [m for m in shown.measurements if (m.x_px, m.y_px) not in out]
    rejected = [
        each
        for each in shown.detections.rejected
        if (each.detection.x_px, each.detection.y_px) not in out
    ]
    taken = None
    if measured:
        taken = max(measured, key=lambda m: m.confidence)
    elif already is not None and already.source == "faint":
        # What is left beside it is less sure still, and nobody has pointed at it.
        raise ValueError(
            f"the track has taken the likeliest candidate of frame {shown.taken.frame_id} already:"
            " reject it first, or mark another streak by hand"
        )
    elif rejected:
        # A line of light that is only below tau before what was no line at all.
        likeliest = max(
            rejected, key=lambda r: (isinstance(r.reason, BelowTau), r.detection.confidence)
        )
        taken = _measurement_of(likeliest.detection, shown, config)
    if taken is not None:
        return Ruling(frame_id=shown.taken.frame_id, taken=taken, refused=refused, by=by)
    raise ValueError(
        f"frame {shown.taken.frame_id} has no candidate to accept: mark the streak by hand"
    )


def _reject(rejection: Reject, folds: Frames, following: Following, by: str) -> Ruling:
    """Return the decision to reject a frame's measurement of the track; no frame: the last."""
    taken = following.lead_measured
    if rejection.frame_id is not None:
        shown = _frame(rejection, folds)
        taken = folds.accepted_measurement(shown.taken.frame_id)
        if taken is None:
            number = shown.taken.frame_id
            raise ValueError(f"nothing was taken of frame {number} that could be rejected")
    if taken is None:
        raise ValueError("nothing has been taken that could be rejected")
    shown = folds.shown(taken.frame_id)
    before = shown.decision.refused if shown.decision is not None else ()
    return Ruling(frame_id=taken.frame_id, refused=(*before, taken), by=by)


def _measurement_of(detection: Detection, shown: FrameObservations, config: Config) -> Measurement:
    """Return a detection's measurement; one that was not measured is measured now."""
    for each in shown.measurements:
        if (each.x_px, each.y_px) == (detection.x_px, detection.y_px):
            return each
    found = shown.detections
    candidates = [*found.detections, *(each.detection for each in found.rejected)]
    named = measurement_id_of(shown.taken.frame_id, candidates.index(detection))
    return measure_accepted(detection, named, shown, config)
