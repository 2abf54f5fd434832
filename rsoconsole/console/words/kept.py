"""What is kept of a track that was ended, for how long, and how it is followed again."""

from collections.abc import Mapping

from rsoconsole.console.commands import first_key
from rsoconsole.console.night import EngineView
from rsoconsole.sky import NS_PER_S
from rsoconsole.words import left


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
        timed, brief = kept, kept
        if engine.kept_until_utc_ns is not None and now_utc_ns is not None:
            more = left((engine.kept_until_utc_ns - now_utc_ns) / NS_PER_S)
            timed, brief = f"{kept} for {more} more", f"{kept} {more}"
        return (
            f"{timed}: {undo} follows it again",
            f"{brief}: {undo} follows it",
            f"{brief}: {undo}",
            f"{kept}: {undo}",
            kept,
        )
    if engine.state != "MANUAL" or engine.target or engine.ra_icrs_deg is not None:
        return ()
    resume, arm = (first_key(name, keymap) for name in ("hold_or_resume", "arm_or_disarm"))
    after = f"{resume} searches again" if engine.is_resumable else f"{arm} hands it over"
    return f"nothing kept: {after}", "nothing kept"
