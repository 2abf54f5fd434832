"""What the operator says of a frame's streaks: chosen, accepted, rejected, marked by hand.

Each makes a ``Ruling`` on one of the last frames, by which it and those after it are followed
again; nothing here moves the mount. The loop's own thread executes them, the wire's only checks.
"""

import math
from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.control.commands import Accept, Choose, Decision, MarkByHand, Reject
from rsoconsole.engine.chronicle import Chronicle
from rsoconsole.engine.handlers import Accepted, Control, Handler, Handlers
from rsoconsole.engine.states import Followed
from rsoconsole.pipeline.cycle import Cycle
from rsoconsole.pipeline.fold import Shown
from rsoconsole.pipeline.measure import measure
from rsoconsole.pipeline.rulings import Folds
from rsoconsole.reason_text import text
from rsoconsole.reasons import BelowTau, Cause, CommandResult
from rsoconsole.records import (
    Detection,
    Measurement,
    NotFollowed,
    Record,
    Ruling,
    Solution,
    StateChange,
    mark_id_of,
    measurement_id_of,
)
from rsoconsole.tracking.following import Following

NEAR_PX = 25.0
"""A candidate so far from where the operator points is not meant."""
MARK_SIGMA_PX = 2.0
"""One sigma of a hand's mark, where it does not say how finely it was made."""
SHORTEST_MARK_PX = 3.0
WIDEST_MARK_PX = 10_000.0


class Verdicts:
    """Takes the operator's word on a frame, and has what it changes followed again."""

    def __init__(self, control: Control, cycle: Cycle, chronicle: Chronicle) -> None:
        self._control = control
        self._cycle = cycle
        self._chronicle = chronicle

    @property
    def handlers(self) -> Handlers:
        """Its commands."""
        handler = Handler(check=self._check, execute=self._rule)
        return dict.fromkeys((Choose, Accept, Reject, MarkByHand), handler)

    def _check(self, decision: Decision, by: str) -> Accepted:
        """Refused at once where it can be seen that it must be."""
        ruling = self._ruling(decision, by)
        # The frame it was said of: another may be there before the loop comes to it.
        pinned = replace(decision, frame_id=ruling.frame_id)
        return Accepted(message="taken up with the next frame", command=pinned)

    def _rule(self, decision: Decision, by: str) -> CommandResult:
        """In force for the order after the next frame. Gives what came of it."""
        before = self._control.following
        ruling = self._ruling(decision, by)
        after, records = self._cycle.rule(ruling)
        result = result_of(ruling, records)
        self._chronicle.append(ruling)
        if after.state != before.state:
            # Before the first frame that is followed again: behind it stand the fold's own.
            change = StateChange(
                frame_id=ruling.frame_id,
                before=before.state,
                after=after.state,
                reason=Cause(kind="operator's word", detail=text(result)),
            )
            self._chronicle.append(change)
        for record in records[1:]:
            self._chronicle.append(record)
        self._control.happen(Followed(after=after))
        return result

    def _ruling(self, decision: Decision, by: str) -> Ruling:
        """What the word on a frame would be. Raises ValueError where it cannot be."""
        if not self._control.charge.is_autonomous:
            raise ValueError("autonomy does not have the mount: nothing is being followed")
        return ruling_of(
            decision,
            by=by,
            folds=self._cycle.folds,
            following=self._control.following,
            config=self._control.config,
        )


def ruling_of(
    decision: Decision, *, by: str, folds: Folds, following: Following, config: Config
) -> Ruling:
    """The operator's word as a ruling. Raises ValueError with the reason where it cannot be one."""
    match decision:
        case Choose():
            return _choose(_frame(decision, folds), decision, by, config)
        case Accept():
            return _accept(_frame(decision, folds), folds, by, config)
        case Reject():
            return _reject(decision, folds, following, by)
        case MarkByHand():
            return _mark(_frame(decision, folds), decision, by, config)
    raise TypeError(f"{decision.verb} is no word on a frame")


def _frame(decision: Decision, folds: Folds) -> Shown:
    return folds.newest() if decision.frame_id is None else folds.shown(decision.frame_id)


def _choose(shown: Shown, choice: Choose, by: str, config: Config) -> Ruling:
    """The streak nearest to a place is the one to follow."""
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


def _accept(shown: Shown, folds: Folds, by: str, config: Config) -> Ruling:
    """The likeliest streak that was not taken is taken."""
    refused = shown.ruling.refused if shown.ruling is not None else ()
    already = folds.taken(shown.taken.frame_id)
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


def _reject(rejection: Reject, folds: Folds, following: Following, by: str) -> Ruling:
    """What a frame gave to the track was none of what is followed; without one, the last."""
    taken = following.taken
    if rejection.frame_id is not None:
        shown = _frame(rejection, folds)
        taken = folds.taken(shown.taken.frame_id)
        if taken is None:
            number = shown.taken.frame_id
            raise ValueError(f"nothing was taken of frame {number} that could be rejected")
    if taken is None:
        raise ValueError("nothing has been taken that could be rejected")
    shown = folds.shown(taken.frame_id)
    before = shown.ruling.refused if shown.ruling is not None else ()
    return Ruling(frame_id=taken.frame_id, refused=(*before, taken), by=by)


def _mark(shown: Shown, mark: MarkByHand, by: str, config: Config) -> Ruling:
    """A streak between two ends that the operator has pointed at."""
    x_a, y_a, x_b, y_b = mark.x_a_px, mark.y_a_px, mark.x_b_px, mark.y_b_px
    sigma_px = MARK_SIGMA_PX if mark.sigma_px is None else mark.sigma_px
    taken = shown.taken
    if not all(0 <= x <= taken.width_px - 1 for x in (x_a, x_b)) or not all(
        0 <= y <= taken.height_px - 1 for y in (y_a, y_b)
    ):
        raise ValueError(f"the ends must lie in the frame, {taken.width_px} x {taken.height_px} px")
    length_px = math.hypot(x_b - x_a, y_b - y_a)
    if length_px < SHORTEST_MARK_PX:
        raise ValueError("the two ends are the same place: mark one end, then the other")
    if not 0.0 < sigma_px <= WIDEST_MARK_PX:
        raise ValueError(f"sigma_px must be above 0, and {WIDEST_MARK_PX:g} at most")
    detection = Detection(
        frame_id=taken.frame_id,
        confidence=1.0,
        x_px=(x_a + x_b) / 2.0,
        y_px=(y_a + y_b) / 2.0,
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        box_px=(min(x_a, x_b), min(y_a, y_b), max(x_a, x_b), max(y_a, y_b)),
        length_px=length_px,
        width_px=0.0,
        snr=0.0,
        sigma_along_px=sigma_px,
        sigma_across_px=sigma_px,
        is_clipped=False,
        method="operator",
    )
    made = _measured(detection, mark_id_of(taken.frame_id, shown.rulings), shown, config)
    return Ruling(frame_id=taken.frame_id, taken=made, by=by)


def _measurement_of(detection: Detection, shown: Shown, config: Config) -> Measurement:
    """What was measured of a detection; a candidate that was not is measured on their word."""
    for each in shown.measurements:
        if (each.x_px, each.y_px) == (detection.x_px, detection.y_px):
            return each
    found = shown.detections
    candidates = [*found.detections, *(each.detection for each in found.rejected)]
    named = measurement_id_of(shown.taken.frame_id, candidates.index(detection))
    return _measured(detection, named, shown, config)


def _measured(
    detection: Detection, measurement_id: str, shown: Shown, config: Config
) -> Measurement:
    if not isinstance(shown.solution, Solution):
        raise ValueError(
            f"frame {shown.taken.frame_id} was not solved: without stars a streak has no place"
            " on the sky"
        )
    measured = measure(
        detection,
        shown.solution,
        shown.taken,
        config.exposure,
        measurement_id=measurement_id,
        source="operator",
    )
    if measured is None:
        raise ValueError(f"frame {shown.taken.frame_id} has no time: nothing can be measured on it")
    return measured


def result_of(ruling: Ruling, records: tuple[Record, ...]) -> CommandResult:
    """What a ruling came to."""
    if ruling.taken is None:
        return CommandResult(kind="ruled", ruled="rejected", frame_id=ruling.frame_id)
    return CommandResult(
        kind="ruled",
        ruled="taken by hand" if ruling.taken.source == "operator" else "taken",
        frame_id=ruling.frame_id,
        left_alone=sum(isinstance(record, NotFollowed) for record in records),
    )
