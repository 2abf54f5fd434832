"""What the operator says of a frame's streaks: chosen, accepted, rejected, marked by hand.

Each makes a ``Ruling`` on one of the last frames, by which it and those after it are followed
again; while nobody follows, two of them make a track that is kept. Nothing here moves the mount.
The loop's own thread executes them, the wire's only checks.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from rsoconsole.config import Config
from rsoconsole.control.commands import (
    Accept,
    Choose,
    Decision,
    Drop,
    Keep,
    MarkByHand,
    Reject,
    TakeBack,
)
from rsoconsole.engine.chronicle import Chronicle
from rsoconsole.engine.handlers import Accepted, Control, Handler, Handlers, RefusedError
from rsoconsole.engine.states import Followed, Marked
from rsoconsole.engine.track_rulings import frame_of, on_track, ruled_of, with_tracks_of
from rsoconsole.pipeline.cycle import Cycle
from rsoconsole.pipeline.fold import Shown
from rsoconsole.pipeline.measure import measure
from rsoconsole.pipeline.refine_mark import refined_mark
from rsoconsole.reason_text import text
from rsoconsole.reasons import BelowTau, Cause, CommandResult, RuledKind
from rsoconsole.records import (
    Detection,
    Measurement,
    NotFollowed,
    PixelArray,
    Record,
    Ruling,
    Solution,
    StateChange,
    TrackState,
    mark_id_of,
    measurement_id_of,
)
from rsoconsole.sky.angles import largest_sigma, separation_deg
from rsoconsole.tracking.following import Following

NEAR_PX = 25.0
"""A candidate so far from where the operator points is not meant."""
MARK_SIGMA_PX = 2.0
"""One sigma of a hand's mark, where it does not say how finely it was made."""
SHORTEST_MARK_PX = 3.0
WIDEST_MARK_PX = 10_000.0


BETTER = 1.5
"""From so many times its sigma on a mark that would take a measurement's place asks first."""
PixelsOf = Callable[[int], PixelArray | None]
"""The pixels of a frame by its number, (height, width) ADU; None where they were not kept."""


class Frames(Protocol):
    """The last frames on which something may be said; each raises ValueError where nothing can."""

    def shown(self, frame_id: int) -> Shown:
        """What a frame showed."""

    def newest(self) -> Shown:
        """The last one."""

    def taken(self, frame_id: int) -> Measurement | None:
        """What the track has of a frame."""

    def frame_ids(self) -> tuple[int, ...]:
        """The frames on which something can still be said, oldest first."""

    def said_last(self) -> int | None:
        """The newest frame that a word was said on."""


class Verdicts:
    """Takes the operator's word on a frame, and has what it changes followed again."""

    def __init__(
        self,
        control: Control,
        cycle: Cycle,
        chronicle: Chronicle,
        pixels_of: PixelsOf = lambda _frame_id: None,
    ) -> None:
        self._control = control
        self._cycle = cycle
        self._chronicle = chronicle
        self._pixels_of = pixels_of

    @property
    def handlers(self) -> Handlers:
        """Its commands."""
        handler = Handler(check=self._check, execute=self._rule)
        mark = Handler(check=self._check_mark, execute=self._rule)
        verdicts = (Choose, Accept, Reject, TakeBack, Drop, Keep)
        return {MarkByHand: mark, **dict.fromkeys(verdicts, handler)}

    @property
    def frame_ids(self) -> tuple[int, ...]:
        """The frames on which something can still be said, oldest first."""
        return self._frames.frame_ids()

    @property
    def _frames(self) -> Frames:
        """Those that are followed, or while nobody follows those that are looked at."""
        is_autonomous = self._control.charge.is_autonomous
        return self._cycle.folds if is_autonomous else self._cycle.hand

    def _check(self, decision: Decision, by: str) -> Accepted:
        """Refused at once where it can be seen that it must be."""
        ruling = self._ruling(decision, by)
        # The frame it was said of: another may be there before the loop comes to it.
        pinned = replace(decision, frame_id=ruling.frame_id)
        return Accepted(message="taken up with the next frame", command=pinned)

    def _check_mark(self, mark: MarkByHand, by: str) -> Accepted:
        """The same, refined on the light beneath it, and held against what is known already.

        Raises RefusedError, which a console may answer with the same mark that ``replaces``.
        """
        ruling = self._ruling(mark, by)
        shown = self._frames.shown(ruling.frame_id)
        pinned, how = replace(mark, frame_id=ruling.frame_id), "no light stands out beneath it"
        pixels = self._pixels_of(ruling.frame_id)
        rough = _detection_of(pinned, ruling.frame_id)
        if pixels is None:
            how = "the frame's pixels are not kept: it stays as you made it"
        else:
            fwhm_px = shown.detections.star_fwhm_px
            found = refined_mark(pixels, rough, star_fwhm_px=fwhm_px)
            if found is not None:
                pinned, how = _refined(pinned, found), "refined on the light beneath it"
        ruling = self._ruling(pinned, by)
        assert ruling.taken is not None
        sigma = _sigma_arcsec(ruling.taken)
        better = _better_known(ruling.taken, shown, self._frames.taken(ruling.frame_id))
        if better is not None and not mark.replaces:
            raise RefusedError(
                f"yours is good to ±{_figure(sigma)}″ ({how}); frame {ruling.frame_id} has it to"
                f" ±{_figure(_sigma_arcsec(better))}″: mark it as replacing that",
                {
                    "asks": "replaces",
                    "sigma_arcsec": sigma,
                    "better_arcsec": _sigma_arcsec(better),
                    "how": how,
                },
            )
        message = f"taken up with the next frame: ±{_figure(sigma)}″, {how}"
        return Accepted(message=message, command=pinned)

    def _rule(self, decision: Decision, by: str) -> CommandResult:
        """In force for the order after the next frame. Gives what came of it."""
        before = self._control.following
        ruling = self._ruling(decision, by)
        if not self._control.charge.is_autonomous:
            return self._rule_by_hand(ruling)
        after, records = self._cycle.rule(ruling)
        result = result_of(ruling, records)
        if isinstance(decision, Drop | Keep):
            result = replace(result, ruled=ruled_of(decision), left_alone=0)
        others = {each.track.track_id for each in before.tracks[1:]}
        if ruling.taken is not None and after.track_id in others:
            result = CommandResult(kind="ruled", ruled="leads", frame_id=ruling.frame_id)
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

    def _rule_by_hand(self, ruling: Ruling) -> CommandResult:
        """Of a frame that nobody followed: what is kept is what the marks make of it."""
        charge = self._control.charge
        kept, records = self._cycle.rule_by_hand(
            ruling, charge.kept, charge.following.last_track_id
        )
        for record in records:
            self._chronicle.append(record)
        self._control.happen(Marked(kept=kept))
        return _by_hand_result(ruling, records)

    def _ruling(self, decision: Decision, by: str) -> Ruling:
        """What the word on a frame would be. Raises ValueError where it cannot be."""
        if isinstance(decision, Drop | Keep) and not self._control.charge.is_autonomous:
            raise ValueError("nothing is followed: autonomy does not have the mount")
        if isinstance(decision, Drop | Keep):
            of = frame_of(decision, self._cycle.folds.rulings())
            decision = replace(decision, frame_id=of)
        return ruling_of(
            decision,
            by=by,
            folds=self._frames,
            following=self._control.following,
            config=self._control.config,
        )


def ruling_of(
    decision: Decision, *, by: str, folds: Frames, following: Following, config: Config
) -> Ruling:
    """The operator's word as a ruling. Raises ValueError with the reason where it cannot be one."""
    match decision:
        case Drop() | Keep():
            return on_track(decision, _frame(decision, folds), following, by, config)
        case TakeBack():
            return _take_back(decision, folds, by)
    made = _on_streaks(decision, by, folds, following, config)
    return with_tracks_of(made, folds.shown(made.frame_id).ruling)


def _on_streaks(
    decision: Decision, by: str, folds: Frames, following: Following, config: Config
) -> Ruling:
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


def _take_back(decision: TakeBack, folds: Frames, by: str) -> Ruling:
    """What the detector saw alone counts for a frame again."""
    frame_id = folds.said_last() if decision.frame_id is None else decision.frame_id
    if frame_id is None:
        raise ValueError("nothing has been said of the last frames that could be taken back")
    if folds.shown(frame_id).ruling is None:
        raise ValueError(f"nothing was said of frame {frame_id} that could be taken back")
    return Ruling(frame_id=frame_id, by=by)


def _frame(decision: Decision, folds: Frames) -> Shown:
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


def _accept(shown: Shown, folds: Frames, by: str, config: Config) -> Ruling:
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


def _reject(rejection: Reject, folds: Frames, following: Following, by: str) -> Ruling:
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
    taken = shown.taken
    if not isinstance(shown.solution, Solution):
        raise ValueError(_not_solved(taken.frame_id))
    # What was refined where the frame cuts it ends at its rim.
    rim = 0.5 if mark.sigma_across_px is not None else 0.0
    if not all(-rim <= x <= taken.width_px - 1 + rim for x in (x_a, x_b)) or not all(
        -rim <= y <= taken.height_px - 1 + rim for y in (y_a, y_b)
    ):
        raise ValueError(f"the ends must lie in the frame, {taken.width_px} x {taken.height_px} px")
    detection = _detection_of(mark, taken.frame_id)
    if detection.length_px < SHORTEST_MARK_PX:
        raise ValueError("the two ends are the same place: mark one end, then the other")
    for sigma_px in (detection.sigma_along_px, detection.sigma_across_px):
        if not 0.0 < sigma_px <= WIDEST_MARK_PX:
            raise ValueError(f"sigma_px must be above 0, and {WIDEST_MARK_PX:g} at most")
    made = _measured(detection, mark_id_of(taken.frame_id, shown.rulings), shown, config)
    return Ruling(frame_id=taken.frame_id, taken=made, by=by)


def _detection_of(mark: MarkByHand, frame_id: int) -> Detection:
    x_a, y_a, x_b, y_b = mark.x_a_px, mark.y_a_px, mark.x_b_px, mark.y_b_px
    sigma_px = MARK_SIGMA_PX if mark.sigma_px is None else mark.sigma_px
    across_px = sigma_px if mark.sigma_across_px is None else mark.sigma_across_px
    return Detection(
        frame_id=frame_id,
        confidence=1.0,
        x_px=(x_a + x_b) / 2.0,
        y_px=(y_a + y_b) / 2.0,
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        box_px=(min(x_a, x_b), min(y_a, y_b), max(x_a, x_b), max(y_a, y_b)),
        length_px=math.hypot(x_b - x_a, y_b - y_a),
        width_px=0.0,
        snr=0.0,
        sigma_along_px=sigma_px,
        sigma_across_px=across_px,
        is_clipped=bool(mark.is_clipped),
        method="operator",
    )


def _refined(mark: MarkByHand, found: Detection) -> MarkByHand:
    """The same mark where the light is."""
    return replace(
        mark,
        x_a_px=found.x_a_px,
        y_a_px=found.y_a_px,
        x_b_px=found.x_b_px,
        y_b_px=found.y_b_px,
        sigma_px=found.sigma_along_px,
        sigma_across_px=found.sigma_across_px,
        is_clipped=found.is_clipped or None,
    )


def _sigma_arcsec(measurement: Measurement) -> float:
    """One sigma of a direction where it is known worst."""
    return largest_sigma(*measurement.cov_sky_arcsec2)


def _figure(value: float) -> str:
    """As exactly as an error is worth."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def _better_known(mark: Measurement, shown: Shown, taken: Measurement | None) -> Measurement | None:
    """What a mark would replace and is known much better; None where there is no such thing."""
    sigma = _sigma_arcsec(mark)
    near = [m for m in shown.measurements if _is_at(m, mark, 3.0 * sigma)]
    known = [m for m in (taken, *near) if m is not None and m != mark and not m.is_clipped]
    best = min(known, key=_sigma_arcsec, default=None)
    return best if best is not None and BETTER * _sigma_arcsec(best) < sigma else None


def _is_at(one: Measurement, other: Measurement, within_arcsec: float) -> bool:
    away_deg = separation_deg(
        one.ra_icrs_deg, one.dec_icrs_deg, other.ra_icrs_deg, other.dec_icrs_deg
    )
    return away_deg * 3600.0 <= within_arcsec


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
        raise ValueError(_not_solved(shown.taken.frame_id))
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


def _not_solved(frame_id: int) -> str:
    return f"frame {frame_id} was not solved: without stars a streak has no place on the sky"


def _by_hand_result(ruling: Ruling, records: tuple[Record, ...]) -> CommandResult:
    """What a word on a frame came to that nobody followed."""
    states = [r for r in records if isinstance(r, TrackState) and r.frame_id == ruling.frame_id]
    ruled: RuledKind = "first of a track"
    if ruling.taken is None:
        ruled = "rejected" if ruling.refused else "taken back"
    elif any(each.kind == "initial" for each in states):
        ruled = "second of a track"
    elif any(each.kind == "updated" for each in states):
        ruled = "taken by hand" if ruling.taken.source == "operator" else "taken"
    return CommandResult(kind="ruled", ruled=ruled, frame_id=ruling.frame_id)


def result_of(ruling: Ruling, records: tuple[Record, ...]) -> CommandResult:
    """What a ruling came to."""
    if ruling.taken is None:
        back: RuledKind = "rejected" if ruling.refused else "taken back"
        return CommandResult(kind="ruled", ruled=back, frame_id=ruling.frame_id)
    return CommandResult(
        kind="ruled",
        ruled="taken by hand" if ruling.taken.source == "operator" else "taken",
        frame_id=ruling.frame_id,
        left_alone=sum(isinstance(record, NotFollowed) for record in records),
    )
