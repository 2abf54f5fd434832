"""What is kept of a track that was ended, and how it is followed again: for the first line."""

from collections.abc import Mapping

from rsoconsole.console.commands import first_key
from rsoconsole.console.engine_view import EngineView

SEARCHING = frozenset(("SEARCH", "ACQUIRE", "LOST"))


def kept_words(engine: EngineView, keymap: Mapping[str, str]) -> tuple[str, ...]:
    """The same from the longest to the shortest; none where nothing can be said of it."""
    if not engine.is_attached:
        return ()
    resume, undo, arm = (
        first_key(name, keymap) for name in ("hold_or_resume", "undo", "arm_or_disarm")
    )
    if engine.kept is not None:
        kept = f"{engine.kept} kept"
        if engine.state in SEARCHING:
            return f"{kept}: {undo} follows it again", f"{kept}: {undo}", kept
        if engine.is_resumable:
            return f"{kept}: {resume} follows it again", f"{kept}: {resume}", kept
        return (
            f"{kept}: {arm} arms, then {undo} follows it again",
            f"{kept}: {arm}, then {undo}",
            kept,
        )
    if engine.state != "MANUAL" or engine.target or engine.ra_icrs_deg is not None:
        return ()
    after = f"{resume} searches again" if engine.is_resumable else f"{arm} hands it over"
    return f"nothing kept: {after}", "nothing kept"
