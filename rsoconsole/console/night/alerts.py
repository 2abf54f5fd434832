"""What is worth a bell or a notification: a track begun or lost, an approach, a limit, a fault."""

from rsoconsole.config import Alert
from rsoconsole.console.night.engine_seen import EngineView
from rsoconsole.night import NightView
from rsoconsole.records import FOLLOWING
from rsoconsole.words import IN_FAULT

LOOK_BACK_LINES = 6
OSC, ST = "\x1b]", "\x1b\\"


def alerts_between(
    before: tuple[NightView, EngineView], after: tuple[NightView, EngineView]
) -> list[tuple[Alert, str]]:
    """What has come to pass between two looks at the same session, with words for it."""
    (night, engine), (night_now, engine_now) = before, after
    gone: list[tuple[Alert, str]] = []
    has_ended = engine_now.reach == "gone" and night_now.has_ended
    if engine_now.reach in {"gone", "silent"} and engine.reach == "attached" and not has_ended:
        gone = [("fault", f"the engine is {engine_now.reach}")]
    if night.folder != night_now.folder or not night.is_read:
        return gone  # another night, or its past still being read: it is history, not news
    found: list[tuple[Alert, str]] = []
    was, now = night.state, night_now.state
    if now == "TRACK" and was not in FOLLOWING:
        found.append(("acquisition", "a satellite is being followed"))
    elif (now == "LOST" and was != "LOST") or (
        was in FOLLOWING and now == "SEARCH" and not _is_sought(night_now)
    ):
        found.append(("loss", "the satellite is lost"))
    new_lines = [line for line in night_now.log if line.seq > night.seq]
    if any(line.topic == "limit" for line in new_lines if line.level == "alarm"):
        found.append(("limit", "the mount has met a limit"))
    rings: dict[tuple[str, str], Alert] = {
        ("alarm", "machine"): "fault",
        ("warning", "approach"): "approach",
    }
    found += [
        (rings[line.level, line.topic], line.words)
        for line in new_lines
        if (line.level, line.topic) in rings
    ]
    if now == "FAULT" and was != "FAULT":
        found.append(("fault", IN_FAULT))
    else:
        found += gone
    return found


def _is_sought(night: NightView) -> bool:
    """Whether it is the operator's own doing: they search for it again, or have rejected it."""
    return any(line.is_wanted for line in night.log[-LOOK_BACK_LINES:])


def notification(words: str) -> str:
    """What asks a terminal to show a notification (OSC 9, as iTerm2, kitty and others have it)."""
    plain = "".join(c for c in words if c.isprintable())
    return f"{OSC}9;rsoconsole: {plain}{ST}"
