"""The engine's state as the console knows it, alerts for changes, and the predicted orbit."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rsoconsole.config import Alert, Config
from rsoconsole.control import Status, read_status
from rsoconsole.night import NightView
from rsoconsole.records import FOLLOWING, OrbitEstimate
from rsoconsole.words import IN_FAULT

Reach = Literal["unknown", "attached", "silent", "gone", "recorded"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineView(Status):
    """The engine's status at one instant, with the state of the connection."""

    reach: Reach = "unknown"
    """State of the connection; silent: the engine does not answer; recorded: no engine is asked."""
    since_utc_ns: int | None = None
    """Last known time of the frame clock, UTC ns, where the engine is silent or gone; else None."""
    detail: str = ""
    """The connection's error in words; empty: none."""

    @property
    def is_attached(self) -> bool:
        """True while the engine answers."""
        return self.reach == "attached"

    @property
    def is_autonomy_waiting(self) -> bool:
        """True where autonomy waits to be resumed: it is on hold, or the operator has control."""
        return self.is_held or self.holder == "operator"


def read_engine_view(answer: Mapping[str, Any]) -> EngineView:
    """Parse the engine's answer to ``status``; missing or invalid fields count as not known."""
    status = read_status(answer)
    known = {each.name: getattr(status, each.name) for each in fields(Status)}
    return EngineView(reach="attached", **known)


LOOK_BACK_LINES = 6
OSC, ST = "\x1b]", "\x1b\\"


def alerts_between(
    before: tuple[NightView, EngineView], after: tuple[NightView, EngineView]
) -> list[tuple[Alert, str]]:
    """Return (alert, text) for each change between two states (night, engine).

    If the session is another one, or its past is still being read, the only alert is that the
    engine was lost.
    """
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
    """Return True if the operator caused the loss: by a new search, or by a rejection."""
    return any(line.is_wanted for line in night.log[-LOOK_BACK_LINES:])


def notification_sequence(words: str) -> str:
    """Return the terminal sequence that shows a notification (OSC 9: iTerm2, kitty and others)."""
    plain = "".join(c for c in words if c.isprintable())
    return f"{OSC}9;rsoconsole: {plain}{ST}"


if TYPE_CHECKING:
    from rsoconsole.pipeline import OrbitOutlook

AHEAD_S = (600, 3600, 86_400)


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitPrediction:
    """An orbit's prediction, seen from the site, with the orbit's elements and their sigmas."""

    folder: Path | None
    """Session that the orbit belongs to."""
    estimate: OrbitEstimate
    from_utc_ns: int
    outlook: "OrbitOutlook | None"
    """Predicted places and events; None where they cannot be computed."""
    elements: Mapping[str, float] = field(default_factory=dict)
    """Elements by name: ``e``, ``i_deg``, ``raan_deg``, ``argp_deg`` and others."""
    sigmas: Mapping[str, float | None] = field(default_factory=dict)
    """Sigma of each element by name; None where the orbit does not fix it at all."""


def predict_orbit(
    estimate: OrbitEstimate, config: Config, from_utc_ns: int, *, folder: Path | None = None
) -> OrbitPrediction:
    """Predict an orbit from ``from_utc_ns`` on, seen from the site; takes half a second."""
    # Late: the sky's computation loads slowly, and the first paint does not wait for it.
    from rsoconsole.orbits import orbit_from_record
    from rsoconsole.pipeline import element_sigmas, elements_by_name, orbit_outlook

    orbit = orbit_from_record(estimate)
    return OrbitPrediction(
        folder=folder,
        estimate=estimate,
        from_utc_ns=from_utc_ns,
        outlook=orbit_outlook(orbit, config.site.to_site(), config.limits, from_utc_ns, AHEAD_S),
        elements=elements_by_name(orbit.r_km, orbit.v_km_s),
        sigmas=element_sigmas(orbit),
    )
