"""What is kept of a track that was ended, for how long, and how it is followed again."""

from collections.abc import Mapping

from rsoconsole.console.commands import first_key
from rsoconsole.console.night import EngineView

NS_PER_S = 1_000_000_000


def kept_words(
    engine: EngineView,
    keymap: Mapping[str, str],
    now_utc_ns: int | None = None,
    *,
    is_asked_for: bool = False,
) -> tuple[str, ...]:
    """The same from the longest to the shortest; none where nothing can be said of it.

    ``now_utc_ns``: the frame clock, by which what is left of its time is counted;
    ``is_asked_for``: the key was pressed, and the engine has yet to take it up.
    """
    if not engine.is_attached:
        return ()
    undo = first_key("undo", keymap)
    if engine.kept is not None and is_asked_for:
        return f"{engine.kept} is being followed again", "being followed again"
    if engine.kept is not None:
        kept = f"{engine.kept} kept"
        left = left_words(engine.kept_until_utc_ns, now_utc_ns)
        timed = f"{kept} for {left} more" if left else kept
        return (
            f"{timed}: {undo} follows it again",
            f"{kept}{f' {left}' if left else ''}: {undo} follows it",
            f"{kept}{f' {left}' if left else ''}: {undo}",
            f"{kept}: {undo}",
            kept,
        )
    if engine.state != "MANUAL" or engine.target or engine.ra_icrs_deg is not None:
        return ()
    resume, arm = (first_key(name, keymap) for name in ("hold_or_resume", "arm_or_disarm"))
    after = f"{resume} searches again" if engine.is_resumable else f"{arm} hands it over"
    return f"nothing kept: {after}", "nothing kept"


def left_words(until_utc_ns: int | None, now_utc_ns: int | None) -> str:
    """What is left until an instant, in whole minutes; under two in seconds; empty: not known."""
    if until_utc_ns is None or now_utc_ns is None:
        return ""
    left_s = max((until_utc_ns - now_utc_ns) / NS_PER_S, 0.0)
    return f"{left_s / 60:.0f} min" if left_s >= 120.0 else f"{left_s:.0f} s"
