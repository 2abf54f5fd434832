"""Reasons as sentences: the only module that words them. No decision depends on the words."""

from typing import assert_never

from rsoconsole.records import (
    BelowTau,
    Cause,
    CommandResult,
    DroppedBy,
    HiddenBy,
    Missed,
    MissKind,
    MotionMismatch,
    NotAStreak,
    NotAStreakKind,
    NotTaken,
    Reason,
    RuledKind,
    SlewRefusal,
    SlewRefusalKind,
    StopOutcome,
    TrackLost,
)
from rsoconsole.words.angles import error_figure, short_figure

_NOT_A_STREAK: dict[NotAStreakKind, str] = {
    "fit broke": "the line fit broke on it: see the log",
    "same streak": "same streak as a more confident candidate",
    "not measured": "not measured: {limit:.0f} more confident candidates in the frame",
    "unlike a streak": "unlike a streak, by the verifier",
    "stars' trails": ("{value:.0f} px along the stars' own trails, of {limit:.0f} px each"),
    "row or column": "along a row or column of the sensor, whose rows or columns differ",
    "trailed stars": (
        "one of {value:.0f} streaks of one length and direction: the stars are trailed"
    ),
    "longer trail": "light goes on beyond its ends: part of a longer trail",
    "patchy": "patchy or bent: a cosmic ray or stars in a row",
    "dark in between": "dark in between: stars in a row",
    "no line": "no line fits the light in the box",
    "outside the frame": "the box lies outside the frame",
    "nothing stands out": "no ends found: nothing stands out of the sky along a line",
    "runs on far": "no ends found: the light runs on for a thousand pixels or more",
    "runs on": "no ends found: the light runs on",
    "darker than the sky": "darker than the sky",
    "too faint": "too faint: signal to noise {value:.1f}, {limit:.0f} needed",
    "too narrow": "narrower than a star ({value:.1f} of {limit:.1f} px): a cosmic ray",
    "too wide": "wider than a star ({value:.1f} of {limit:.1f} px): an aircraft or glare",
    "too short": "too short: {value:.1f} px, hardly longer than a star is wide",
    "no ends": "no ends found: they fade into the sky or lie behind a star",
    "unlit": "only {percent:.0f} % of its length is lit: not one streak",
    "uneven": "light uneven by {percent:.0f} %: stars in a row",
    "fixed in the sky": (
        "the frame before shows the same light at the same place of the sky: stars in a row"
    ),
    "fixed on the sensor": (
        "the frame before shows the same light at the same pixels, and the sky has moved:"
        " the sensor's own"
    ),
    "catalogue stars": "{value:.0f} catalogue stars in a row have its light",
}
KEPT = "kept: no miss ends it in the field"
_RULED: dict[RuledKind, str] = {
    "rejected": "rejected",
    "taken": "taken",
    "taken by hand": "taken by the operator's hand",
    "taken back": "as if nothing had been said of it",
    "first of a track": "the first of a track: mark it in a later frame, too",
    "second of a track": "a track begins with it, to be resumed",
    "leads": "its track leads now",
    "dropped": "dropped: its streak starts no track while it is in the field",
    "taken up again": "followed again, as if it had not been dropped",
    "kept": KEPT,
    "released": "kept no longer",
}
_DROPPED: dict[DroppedBy, str] = {
    "STOP": "dropped by STOP",
    "limit met": "dropped: a limit was met",
    "night ended": "dropped: the night ends",
    "engine ended": "dropped: the engine ends",
}

STOP_PATHS = {"mount": "the mount's own process", "indi": "a second INDI connection"}
CUT_POWER = "cut the mount's power"
_SLEW_REFUSED: dict[SlewRefusalKind, str] = {
    "altitude": "altitude {value:.1f} deg is {by} below the limit of {bound:.1f}{later}",
    "horizon": (
        "altitude {value:.1f} deg is {by} below the horizon of {bound:.1f}"
        " at azimuth {azimuth:.0f}{later}"
    ),
    "hour angle": "hour angle {value:.1f} deg is {by} beyond the limit of {bound:.1f}{later}",
    "pier": (
        "hour angle {value:.1f} deg {side} of the pier is {by} past the meridian's limit"
        " of {bound:.1f}{later}"
    ),
    "polar axis": (
        "the polar axis stands {value:.1f} deg past the meridian, {by} beyond the limit"
        " of {bound:.1f}"
    ),
    "Sun": "{value:.1f} deg from the Sun is {by} inside its cone of {bound:.1f}{later}",
    "past the Sun": (
        "the way there passes {value:.1f} deg from the Sun, {by} inside its cone of {bound:.1f}"
    ),
    "nearer to the Sun": (
        "the way there comes to {value:.1f} deg from the Sun, {by} nearer than {bound:.1f} before"
    ),
    "twilight": "the Sun at altitude {value:.1f} deg is {by} above the limit of {bound:.1f}{later}",
    "meridian policy": (
        "hour angle {value:+.1f} deg: the mount would change to the {side} side of its pier,"
        " and mount.meridian is hold"
    ),
    "direction": "{detail} is no direction",
    "clock": "the clock says {detail}: set it",
    "aimed before": "aimed for {ago:.0f} min ago, at most 5 are taken",
    "aimed ahead": "aimed {ahead:.1f} h ahead, at most 2 are taken",
    "ends before": "the exposure would end before it is aimed for or before now",
    "ends ahead": "ends {ahead:.1f} h ahead, at most 4 are taken",
}

_MISSED: dict[MissKind, str] = {
    "no detection": "no detection",
    "nothing fits": "nothing fits the prediction",
    "cannot be told apart": "cannot be told apart from its neighbour",
    "not solved": "detected, but not solved: {detail}",
    "no time": "the frame has no time",
    "crossing": "what was detected crosses the whole frame: nothing to measure in time",
    "not measured": "not measured",
    "instrument": "{detail}",
}


def text(reason: Reason) -> str:  # noqa: PLR0911 -- one case a kind
    """Return a reason as a sentence."""
    match reason:
        case BelowTau():
            return f"confidence {reason.confidence:.2f} below tau {reason.tau:.2f}"
        case NotAStreak():
            value, limit = reason.value or 0.0, reason.limit or 0.0
            said = _NOT_A_STREAK[reason.kind]
            return said.format(value=value, limit=limit, percent=100.0 * value)
        case NotTaken():
            return _not_taken(reason)
        case CommandResult():
            return _result(reason)
        case Missed():
            said = _MISSED[reason.kind].replace("{detail}", reason.detail)
            lost = () if reason.lost is None else (text(reason.lost),)
            return "; ".join(part for part in (*map(text, reason.hidden_by), said, *lost) if part)
        case HiddenBy():
            return _hidden_by(reason)
        case SlewRefusal():
            return _slew_refused(reason)
        case TrackLost():
            return _track_lost(reason)
        case Cause():
            return _cause(reason)
        case _:
            assert_never(reason)


def _result(result: CommandResult) -> str:  # noqa: PLR0911 -- one case a kind
    match result.kind:
        case "accepted":
            return "accepted"
        case "done":
            return result.detail or "done"
        case "ruled":
            return f"frame {result.frame_id}: {decision_text(result)}"
        case "answered":
            return stop_answer_text(result.stop_ms or 0.0, result.stop_path, result.stop_ordered_ms)
        case "measured":
            seconds = (result.stop_ms or 0.0) / 1e3
            return measured_text(result.stop_outcome, result.rate_deg_s, seconds, why=result.detail)
        case "refused":
            return f"refused: {result.detail}"
        case "dropped":
            return _DROPPED[result.dropped_by or "STOP"]
        case "failed":
            return f"NOT answered: {result.detail}{stop_order_text(result.stop_ordered_ms)}"
        case _:
            assert_never(result.kind)


def stop_answer_text(ms: float, path: str, ordered_ms: float | None) -> str:
    """Say after how long and by which path the mount's driver answered a STOP.

    ``ms``: time until the answer; ``path``: key of ``STOP_PATHS``; ``ordered_ms``: time until the
    STOP was ordered, None: not known.
    """
    way = STOP_PATHS.get(path, path)
    return f"ABORT answered in {ms:.0f} ms by {way}{stop_order_text(ordered_ms)}"


def measured_text(
    motion: StopOutcome | None,
    rate_deg_s: float | None = None,
    seconds: float | None = None,
    *,
    why: str = "",
    remedy: str = f"{CUT_POWER} if it does",
) -> str:
    """Say how a STOP ended: the mount stands, tracks, still moves, or that this is not known.

    ``rate_deg_s``: rate at which the mount still moves; ``seconds``: time until it was at rest;
    ``why``, ``remedy``: cause and remedy where the end is not known.
    """
    if motion is None or motion == "unknown":
        return unmeasured_text(why, remedy)
    if motion == "moves":
        return f"the mount STILL MOVES at {rate_text(rate_deg_s or 0.0)}: {CUT_POWER}"
    return f"the mount {motion}, measured" + ("" if seconds is None else f" in {seconds:.1f} s")


def unmeasured_text(why: str, remedy: str) -> str:
    """Say that it is not known whether the mount is at rest after a STOP."""
    return f"NOT KNOWN whether the mount moves{f' ({why})' if why else ''}: {remedy}"


def rate_text(rate_deg_s: float) -> str:
    """Format an angular rate: in deg/s from 0.1 deg/s on, below that in arcsec/s."""
    if rate_deg_s >= 0.1:
        return f"{rate_deg_s:.1f} deg/s"
    return f"{rate_deg_s * 3600.0:.0f} arcsec/s"


def stop_order_text(ordered_ms: float | None, within: str = "; {}", unknown: str = "") -> str:
    """Say after what time a STOP was ordered: "; ordered in 12 ms".

    ``within``: template of the words; ``unknown``: text for a time of None.
    """
    return unknown if ordered_ms is None else within.format(f"ordered in {ordered_ms:.0f} ms")


def decision_text(result: CommandResult) -> str:
    """Say the outcome of a decision on a frame, without naming the frame."""
    if result.sigma_arcsec is not None:
        return _mark_text(result, result.sigma_arcsec)
    beside = f", {result.left_alone} left alone" if result.left_alone else ""
    return _RULED[result.ruled or "taken"] + beside


def _mark_text(result: CommandResult, sigma_arcsec: tuple[float, float]) -> str:
    """Return the errors of a mark by hand, the measurement it replaces, and the track it starts."""
    east, north = (error_figure(each) for each in sigma_arcsec)
    words = f"used: ±{east}″ RA ±{north}″ Dec"
    others = result.left_alone
    if result.off_arcsec is not None:
        off = error_figure(result.off_arcsec)
        words += f", {off}″ from the automatic measurement, which is set aside"
        others -= 1
    if result.ruled in {"first of a track", "second of a track", "leads"}:
        words += f"; {_RULED[result.ruled]}"
    return words + (f"; {others} more not taken" if others > 0 else "")


def _not_taken(reason: NotTaken) -> str:  # noqa: PLR0911, PLR0912 -- one case a kind
    match reason.kind:
        case "NIS":
            return f"NIS {reason.nis or 0.0:.1f} above the gate {reason.limit or 0.0:.1f}"
        case "cannot be told apart":
            return "cannot be told apart from its neighbour"
        case "refused":
            return "refused by the operator"
        case "dropped":
            return "of a track that the operator has dropped"
        case "not chosen":
            return "set aside: the operator's own choice is used"
        case "another taken":
            return "another one is taken"
        case "another leads":
            return "another one leads"
        case "clipped at start":
            return "clipped by the frame: starts no track"
        case "crossing":
            return "crosses the whole frame: without an end it has no place in time"
        case "class":
            return f"{reason.object_class}: starts no track"
        case "neighbour":
            return "stands where a neighbour of the one followed was"
        case "moves otherwise":
            return "" if reason.mismatch is None else _mismatch(reason.mismatch)
        case "clipped and far":
            away, allowed = reason.away_arcsec or 0.0, reason.allowed_arcsec or 0.0
            return f"clipped, and {away:.0f} arcsec from the prediction, {allowed:.0f} at most"
        case "no second frame":
            why = "" if reason.missed is None else text(reason.missed)
            return f"no second frame: {why or _mismatch(reason.mismatch)}"
        case _:
            assert_never(reason.kind)


def _mismatch(found: MotionMismatch | None) -> str:
    if found is None:
        return "one that agrees begins no track by itself"
    match found.kind:
        case "direction":
            return f"streak runs {found.value or 0.0:.0f} deg off the expected motion"
        case "length":
            long, expected = found.value or 0.0, found.expected or 0.0
            return f"streak is {long:.0f} arcsec long, {expected:.0f} expected"
        case "order of time":
            return "frames are not in order of time"
        case _:
            assert_never(found.kind)


def _hidden_by(hidden: HiddenBy) -> str:
    match hidden.kind:
        case "slew refused":
            return f"slew refused: {'' if hidden.refusal is None else text(hidden.refusal)}"
        case "fewer stars":
            return f"cloud: {hidden.stars} stars where {hidden.usual_stars} were"
        case "fainter stars":
            return f"cloud: the stars are {hidden.fainter_mag or 0.0:.1f} mag fainter"
        case "few stars":
            return f"only {hidden.stars} stars, cloud?"
        case "shadow":
            return "eclipse: in the Earth's shadow"
        case "penumbra":
            return f"eclipse: in the penumbra, {hidden.sun_percent or 0.0:.0f}% of the Sun left"
        case _:
            assert_never(hidden.kind)


def _slew_refused(refusal: SlewRefusal) -> str:
    by = 0.0 if refusal.by_deg is None else refusal.by_deg
    by_text = f"{by:.1f}" if by >= 0.1 else f"{by:.3f}"
    later = "" if refusal.later_s is None else f", {refusal.later_s:.0f} s from now"
    return _SLEW_REFUSED[refusal.kind].format(
        # An angle of -0.0 keeps its sign.
        value=0.0 if refusal.value_deg is None else refusal.value_deg,
        bound=0.0 if refusal.bound_deg is None else refusal.bound_deg,
        by="less than 0.001" if by < 0.001 else by_text,
        azimuth=0.0 if refusal.azimuth_deg is None else refusal.azimuth_deg,
        side=refusal.side,
        later=later,
        ago=refusal.ago_min or 0.0,
        ahead=refusal.ahead_h or 0.0,
        detail=refusal.detail,
    )


def _track_lost(lost: TrackLost) -> str:
    match lost.kind:
        case "too wide":
            return f"3 sigma of {lost.three_sigma_arcmin or 0.0:.0f} arcmin is too wide"
        case "wider than the field":
            wide = lost.three_sigma_arcmin or 0.0
            return f"3 sigma of {wide:.0f} arcmin no longer fits the field"
        case "coasted":
            return f"coasted for {lost.coasted_min or 0.0:.0f} min"
        case "not confirmed":
            return "no third frame shows it"
        case "seen too seldom":
            return f"{lost.unseen_frames or 0} frames that should show it do not"
        case "left the field":
            return "it has left the field"
        case _:
            assert_never(lost.kind)


def _cause(reason: Cause) -> str:  # noqa: PLR0911, PLR0912 -- one case a kind
    match reason.kind:
        case "armed" | "disarmed" | "STOP" | "resumed" | "looked for again":
            said = f": {reason.detail}" if reason.detail else ""
            return f"{reason.kind} by {reason.by}{said}"
        case "moved by hand":
            return f"{reason.by} moves the mount"
        case "limit met":
            return f"limit met: {reason.detail}"
        case "too many limits":
            return f"{reason.detail}; move away by hand or park, then arm again"
        case "clock set":
            return f"the clock was set by {reason.step_s or 0.0:+.1f} s"
        case "night ended":
            return f"the night ends: {reason.detail}"
        case "not pointing":
            return f"not armed: {reason.detail}"
        case "instrument" | "operator's word":
            return reason.detail
        case "engine ended":
            return "the engine ends"
        case "two frames agree":
            return "two frames agree on one motion"
        case "faint frames agree":
            probability = short_figure(reason.probability or 0.0)
            return f"faint: {reason.frames} frames together {probability}"
        case "measured again":
            return "measured again"
        case "re-acquired":
            return f"re-acquired {reason.detail}"
        case "waiting":
            plural = "" if reason.detections == 1 else "s"
            return f"{reason.detections} detection{plural}, waiting for a second frame"
        case "missed":
            return "" if reason.missed is None else text(reason.missed)
        case _:
            assert_never(reason.kind)
