"""What the operator says of a frame's streaks: chosen, accepted, rejected, marked by hand.

Each makes a ``Ruling`` on one of the last frames, by which it and those after it are followed
again; nothing here moves the mount. The loop's own thread grants them, the wire's only checks.
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from rsoconsole.config import Config
from rsoconsole.engine.states import Followed
from rsoconsole.pipeline.fold import Shown
from rsoconsole.pipeline.measure import measure
from rsoconsole.pipeline.rulings import Folds
from rsoconsole.reasons import Cause
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
from rsoconsole.tracking.follow import Following

if TYPE_CHECKING:
    from rsoconsole.engine.loop import Engine

VERBS = ("choose", "accept", "reject", "mark")
NEAR_PX = 25.0
"""A candidate so far from where the operator points is not meant."""
MARK_SIGMA_PX = 2.0
"""One sigma of a hand's mark, where it does not say how finely it was made."""
SHORTEST_MARK_PX = 3.0
WIDEST_MARK_PX = 10_000.0


def ruling_of(
    verb: str,
    arguments: Mapping[str, Any],
    *,
    by: str,
    folds: Folds,
    following: Following,
    config: Config,
) -> Ruling:
    """The operator's word as a ruling. Raises ValueError with the reason where it cannot be one."""
    makers: dict[str, Callable[[], Ruling]] = {
        "choose": lambda: _choose(_frame(arguments, folds), arguments, by, config),
        "accept": lambda: _accept(_frame(arguments, folds), folds, by, config),
        "reject": lambda: _reject(arguments, folds, following, by),
        "mark": lambda: _mark(_frame(arguments, folds), arguments, by, config),
    }
    return makers[verb]()


def _frame(arguments: Mapping[str, Any], folds: Folds) -> Shown:
    frame_id = arguments.get("frame")
    if frame_id is None:
        return folds.newest()
    if not isinstance(frame_id, int) or isinstance(frame_id, bool):
        raise ValueError("frame must be a frame's number")
    return folds.shown(frame_id)


def _choose(shown: Shown, arguments: Mapping[str, Any], by: str, config: Config) -> Ruling:
    """The streak nearest to a place is the one to follow."""
    x_px, y_px = number(arguments, "x"), number(arguments, "y")
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
        each.detection
        for each in shown.detections.rejected
        if (each.detection.x_px, each.detection.y_px) not in out
    ]
    taken = None
    if measured:
        taken = max(measured, key=lambda m: m.confidence)
    elif rejected:
        likeliest = max(rejected, key=lambda d: d.confidence)
        taken = _measurement_of(likeliest, shown, config)
    if taken is not None:
        return Ruling(frame_id=shown.taken.frame_id, taken=taken, refused=refused, by=by)
    raise ValueError(
        f"frame {shown.taken.frame_id} has no candidate to accept: mark the streak by hand"
    )


def _reject(arguments: Mapping[str, Any], folds: Folds, following: Following, by: str) -> Ruling:
    """What a frame gave to the track was none of what is followed; without one, the last."""
    taken = following.taken
    if arguments.get("frame") is not None:
        shown = _frame(arguments, folds)
        taken = folds.taken(shown.taken.frame_id)
        if taken is None:
            number = shown.taken.frame_id
            raise ValueError(f"nothing was taken of frame {number} that could be rejected")
    if taken is None:
        raise ValueError("nothing has been taken that could be rejected")
    shown = folds.shown(taken.frame_id)
    before = shown.ruling.refused if shown.ruling is not None else ()
    return Ruling(frame_id=taken.frame_id, refused=(*before, taken), by=by)


def _mark(shown: Shown, arguments: Mapping[str, Any], by: str, config: Config) -> Ruling:
    """A streak between two ends that the operator has pointed at."""
    x_a, y_a, x_b, y_b = (number(arguments, name) for name in ("x_a", "y_a", "x_b", "y_b"))
    sigma_px = number(arguments, "sigma_px") if "sigma_px" in arguments else MARK_SIGMA_PX
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
    """What was measured of a detection; a candidate that was not is measured on his word."""
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


def verdict_words(ruling: Ruling, records: tuple[Record, ...]) -> str:
    """What a ruling came to, for the log."""
    what = "rejected" if ruling.taken is None else "taken"
    if ruling.taken is not None and ruling.taken.source == "operator":
        what = "taken by the operator's hand"
    refused = sum(isinstance(record, NotFollowed) for record in records)
    beside = f", {refused} left alone" if refused and ruling.taken is not None else ""
    return f"frame {ruling.frame_id}: {what}{beside}"


def number(arguments: Mapping[str, Any], name: str) -> float:
    """A finite number of that name. Raises ValueError otherwise."""
    value = arguments.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} must be a number")
    return float(value)


def check(engine: "Engine", verb: str, arguments: Mapping[str, Any], by: str) -> Ruling:
    """What the operator's word on a frame would be. Raises ValueError where it cannot be."""
    if not engine.charge.is_autonomous:
        raise ValueError("autonomy does not have the mount: nothing is being followed")
    return ruling_of(
        verb,
        arguments,
        by=by,
        folds=engine.cycle.folds,
        following=engine.following,
        config=engine.config,
    )


def rule(engine: "Engine", verb: str, arguments: Mapping[str, Any], by: str) -> str:
    """The operator's word on a frame's streaks; in force for the order after the next frame.

    Returns what came of it, in words. Raises ValueError where it cannot be.
    """
    before = engine.following
    ruling = check(engine, verb, arguments, by)
    after, records = engine.cycle.rule(ruling)
    words = verdict_words(ruling, records)
    engine.chronicle.append(ruling)
    if after.state != before.state:
        # Before the first frame that is followed again: behind it stand the fold's own.
        change = StateChange(
            frame_id=ruling.frame_id,
            before=before.state,
            after=after.state,
            reason=Cause(kind="operator's word", detail=words),
        )
        engine.chronicle.append(change)
    for record in records[1:]:
        engine.chronicle.append(record)
    engine.happen(Followed(after=after))
    return words
