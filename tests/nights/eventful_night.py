"""A made-up night in which much comes to pass: to show what has been recorded."""

from collections.abc import Iterable
from pathlib import Path

from rsoconsole.records import (
    DONE,
    Cause,
    CommandResult,
    Event,
    FollowedAgain,
    Miss,
    Missed,
    NotFollowed,
    NotTaken,
    OperatorAction,
    ParameterChange,
    Ruling,
    StateChange,
    TrackLost,
    done_result,
)
from rsoconsole.session import SessionWriter
from tests.makers import geo_measurement
from tests.nights import made_up_night as night

MISSES, REFUSALS, NOTES, CHANGES, RULINGS, LOSSES, ALARMS = 17, 51, 73, 90, 40, 205, 333
"""One of each, so many frames apart; a refusal is a miss too."""

WIDE = Cause(
    kind="missed",
    missed=Missed(kind="no detection", lost=TrackLost.by_uncertainty(40.0, fits_field=True)),
)


def missed_in(frames: Iterable[int]) -> list[int]:
    """Frames in which the satellite is not measured."""
    return [n for n in frames if n % MISSES == 0 and n > night.FIRST_MEASURED + 1]


def write(
    folder: Path, frames: int, *, pictures: range = range(0), first: int = 1
) -> SessionWriter:
    """A night of so many frames, still open."""
    writer = night.begin(folder)
    night.armed(writer)
    go_on(writer, range(first, first + frames))
    if pictures:
        night.add_previews(writer, pictures)
    assert writer.flush()
    return writer


def go_on(writer: SessionWriter, frames: range) -> None:
    """More frames of it."""
    missed = missed_in(frames)
    for n in frames:
        night.add_one(writer, n, missed)
        for kind in (_refusal, _note, _change, _decision, _loss, _alarm):
            kind(writer, n)
        if n % 250 == 0:
            assert writer.flush()
    assert writer.flush()


def _refusal(writer: SessionWriter, n: int) -> None:
    if n % REFUSALS == 0:
        seen = geo_measurement(n, cadence_s=night.CADENCE_S, confidence=0.62)
        refused = NotFollowed(
            frame_id=n,
            measurement=seen,
            reason=NotTaken.by_gate(31.0, 11.83),
            nis=31.0,
        )
        writer.append(refused, night.t_of(n))


def _note(writer: SessionWriter, n: int) -> None:
    if n % NOTES == 0:
        said = {"text": f"clouds in the west, frame {n}"}
        note = OperatorAction(
            verb="note", arguments=said, outcome=done_result("noted"), by="console a@b"
        )
        writer.append(note, night.t_of(n) + 5 * 10**9)


def _change(writer: SessionWriter, n: int) -> None:
    if n % CHANGES == 0:
        tau = 0.1 + 0.01 * (n // CHANGES % 5)
        wanted = {"name": "detector.tau", "value": tau}
        action = OperatorAction(verb="set", arguments=wanted, outcome=DONE, by="console a@b")
        change = ParameterChange(name="detector.tau", before=0.1, after=tau, by="console a@b")
        writer.append(change, night.t_of(n) + 6 * 10**9)
        writer.append(action, night.t_of(n) + 6 * 10**9)


def _decision(writer: SessionWriter, n: int) -> None:
    """The frame before the last was something else: it and the next ones are followed again."""
    if n % RULINGS or n < 10:
        return
    ns, ruled = night.t_of(n) + 7 * 10**9, n - 2
    seen = geo_measurement(ruled, cadence_s=night.CADENCE_S, confidence=0.9)
    action = OperatorAction(
        verb="reject",
        arguments={"frame": ruled},
        outcome=CommandResult(kind="ruled", ruled="rejected", frame_id=ruled),
        by="console a@b",
    )
    writer.append(Ruling(frame_id=ruled, refused=(seen,), by="console a@b"), ns)
    for again in (ruled, ruled + 1, n):
        ra, dec = seen.ra_icrs_deg, seen.dec_icrs_deg
        writer.append(FollowedAgain(frame_id=again), ns)
        writer.append(night.state_of(again, ra, dec, "predicted"), ns)
        if again == ruled:
            writer.append(Miss(frame_id=again, reason=Missed(kind="nothing fits")), ns)
        else:
            named = geo_measurement(again, cadence_s=night.CADENCE_S).measurement_id
            writer.append(night.state_of(again, ra, dec, "updated", named), ns)
    writer.append(action, ns)


def _loss(writer: SessionWriter, n: int) -> None:
    if n % LOSSES == 0:
        ns = night.t_of(n) + 8 * 10**9
        for before, after in (("TRACK", "LOST"), ("LOST", "SEARCH"), ("SEARCH", "TRACK")):
            change = StateChange(
                frame_id=n,
                before=before,
                after=after,
                reason=WIDE,
            )  # type: ignore[arg-type]
            writer.append(change, ns)
            ns += 60 * 10**9 // 10


def _alarm(writer: SessionWriter, n: int) -> None:
    if n % ALARMS == 0:
        writer.append(
            Event(level="alarm", text="limit: altitude", frame_id=n, topic="limit"), night.t_of(n)
        )
