"""STOP on the wire's thread: answered once the mount's driver has, else an alarm.

Whether tracking goes on is settled on a separate thread; until then the queue counts the STOP as
under way, and the loop gives no order. The mount's motion afterwards is measured while the loop
goes on.
"""

import threading
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.control import LastStop
from rsoconsole.engine.aim.states import Stopped
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.instruments import MountPort, StopResult
from rsoconsole.records import CommandResult

ALARM_S = 0.8
"""A driver that has not answered a STOP for so long is an alarm; it is waited for beyond that."""
REMEDY = "cut the mount's power if it moves"


def stop_now(
    queue: CommandQueue,
    mount: MountPort,
    by: str,
    *,
    on_known: Callable[[StopResult], None],
    on_late: Callable[[StopResult], None],
    on_measured: Callable[[StopResult], None],
) -> StopResult:
    """Stop the mount; return at its answer, at a failure, or after ``ALARM_S``.

    ``on_known``: called once with the result of ABORT, before this returns if known by then;
    ``on_late``: called with the state after ``ALARM_S``; ``on_measured``: called after both, at
    each change of the mount's measured motion. Raises what the mount's port raises; it should raise
    nothing.
    """
    known = threading.Event()
    rewriter = threading.Lock()
    ordered_ms: list[float] = []
    found: list[StopResult] = []
    broken: list[Exception] = []

    def on_news(news: StopResult) -> None:
        if news.ordered_ms is not None and not ordered_ms:
            ordered_ms.append(news.ordered_ms)
        if news.motion is not None:
            settle(replace(news, motion=None, measured_ms=None))
            on_measured(news)
        elif news.is_answered:
            settle(news)

    def settle(result: StopResult) -> None:
        with rewriter:
            if not found:
                on_known(result)
                found.append(result)
        known.set()

    def act() -> None:
        try:
            settle(queue.stop(Stopped(by=by), lambda: mount.abort(on_news=on_news)))
        except Exception as error:  # told on the thread that waits
            broken.append(error)
            known.set()

    threading.Thread(target=act, name="stop under way", daemon=True).start()
    if known.wait(ALARM_S):
        if broken and not found:
            raise broken[0]
        return found[0]
    late = StopResult(
        is_answered=False,
        ms=ALARM_S * 1e3,
        ordered_ms=next(iter(ordered_ms), None),
        path="mount",
        detail=f"{ordered_words(next(iter(ordered_ms), None))}, not answered in {ALARM_S:g} s",
    )
    on_late(late)
    return late


def stop_status(given: LastStop, result: StopResult) -> LastStop:
    """Return the state of a STOP, for the status."""
    return replace(
        given,
        ordered_ms=result.ordered_ms,
        answered_ms=result.ms if result.is_answered else None,
        measured_ms=result.measured_ms,
        motion=None if result.motion is None else result.motion.kind,
        rate_deg_s=result.rate_deg_s,
        is_over=result.is_superseded,
        is_superseded=result.is_superseded,
        path=result.path,
        detail=result.detail,
    )


def stop_outcome(result: StopResult) -> CommandResult:
    """What came of a STOP so far, for the record."""
    if result.motion is not None:
        return CommandResult(
            kind="measured",
            stop_outcome=result.motion.kind,
            stop_ms=result.measured_ms,
            rate_deg_s=result.rate_deg_s,
            detail=result.detail,
        )
    if result.is_answered:
        return CommandResult(
            kind="answered",
            stop_ms=result.ms,
            stop_path=result.path,
            stop_ordered_ms=result.ordered_ms,
        )
    return CommandResult(kind="failed", detail=result.detail, stop_ordered_ms=result.ordered_ms)


def ordered_words(ordered_ms: float | None) -> str:
    """Return words on whether ABORT has been ordered, and in what time."""
    return "NOT ordered yet" if ordered_ms is None else f"ordered in {ordered_ms:.0f} ms"
