"""What is worth a bell or a notification: a track begun or lost, a limit met, a fault."""

from rsoconsole.config import Alert
from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.night import NightView

FOLLOWING = {"TRACK", "COAST"}
OSC, ST = "\x1b]", "\x1b\\"


def alerts_between(
    before: tuple[NightView, EngineView], after: tuple[NightView, EngineView]
) -> list[tuple[Alert, str]]:
    """What has come to pass between two looks at the same session, with words for it."""
    (night, engine), (night_now, engine_now) = before, after
    if night.folder != night_now.folder or night.state is None:
        return []  # another night, or the beginning of this one: it is history, not news
    found: list[tuple[Alert, str]] = []
    was, now = night.state, night_now.state
    if now == "TRACK" and was not in FOLLOWING:
        found.append(("acquisition", "a satellite is being followed"))
    elif now == "LOST" or (was in FOLLOWING and now == "SEARCH"):
        found.append(("loss", "the satellite is lost"))
    new_lines = night_now.log[len(night.log) :] if len(night_now.log) > len(night.log) else ()
    if any("limit" in line.text for line in new_lines if line.level == "alarm"):
        found.append(("limit", "the mount has met a limit"))
    if now == "FAULT" and was != "FAULT":
        found.append(("fault", "the engine is in FAULT"))
    elif engine_now.reach in {"gone", "silent"} and engine.reach == "attached":
        found.append(("fault", f"the engine is {engine_now.reach}"))
    return found


def notification(words: str) -> str:
    """What asks a terminal to show a notification (OSC 9, as iTerm2, kitty and others have it)."""
    plain = "".join(c for c in words if c.isprintable())
    return f"{OSC}9;rsoconsole: {plain}{ST}"
