"""What the console knows of the engine: its own words, or that it is silent or gone."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rsoconsole.control import printable

Reach = Literal["unknown", "attached", "silent", "gone", "recorded"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthView:
    """One part of machine or instruments and how it is."""

    name: str
    ok: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineView:
    """The engine at one instant, as far as it can be reached."""

    reach: Reach = "unknown"
    """silent: it runs and does not answer; recorded: none is asked, a session is looked at."""
    since_utc_ns: int | None = None
    """The frame clock's last word, where the engine is silent or gone."""
    detail: str = ""
    """What went wrong, in words."""
    state: str | None = None
    holder: str | None = None
    is_held: bool = False
    """Autonomy has the mount and gives it no slews."""
    frame: int | None = None
    ra_icrs_deg: float | None = None
    dec_icrs_deg: float | None = None
    alt_deg: float | None = None
    az_deg: float | None = None
    target: str | None = None
    now_utc_ns: int | None = None
    session: Path | None = None
    faults: tuple[str, ...] = ()
    lifted: tuple[str, ...] = ()
    """Limits and checks that the operator has overridden, by name."""
    next_limit: str | None = None
    mount_ra_icrs_deg: float | None = None
    mount_dec_icrs_deg: float | None = None
    is_slewing: bool = False
    is_tracking: bool = False
    seat: str | None = None
    """The console that may act; None while none has."""
    seat_asked_by: str | None = None
    waits_for_sky: bool = False
    """The hold ends by itself when the stars are back."""
    temporary: Mapping[str, int] = field(default_factory=dict)
    """Settings that hold for so many frames more."""
    pier_side: str | None = None
    exposing_until_utc_ns: int | None = None
    next_start_utc_ns: int | None = None
    health: tuple[HealthView, ...] = ()

    @property
    def is_attached(self) -> bool:
        """True while the engine answers."""
        return self.reach == "attached"

    @property
    def wants_resuming(self) -> bool:
        """True while autonomy waits for the operator's word to go on."""
        return self.is_held or self.holder == "operator"


def engine_view(data: Mapping[str, Any]) -> EngineView:
    """The engine's answer to ``status``; what is missing or odd in it counts as not said."""
    session = _text(data.get("session"))
    return EngineView(
        reach="attached",
        state=_text(data.get("state")),
        holder=_text(data.get("holder")),
        is_held=data.get("is_held") is True,
        frame=_whole(data.get("frame")),
        ra_icrs_deg=_number(data.get("ra")),
        dec_icrs_deg=_number(data.get("dec")),
        alt_deg=_number(data.get("alt")),
        az_deg=_number(data.get("az")),
        target=_text(data.get("target")),
        now_utc_ns=_whole(data.get("now_utc_ns")) or _whole(data.get("t_utc_ns")),
        session=Path(session) if session else None,
        faults=_texts(data.get("faults")),
        lifted=_texts(data.get("lifted")),
        next_limit=_text(data.get("next_limit")),
        mount_ra_icrs_deg=_number(data.get("mount_ra")),
        mount_dec_icrs_deg=_number(data.get("mount_dec")),
        is_slewing=data.get("is_slewing") is True,
        is_tracking=data.get("is_tracking") is True,
        seat=_text(data.get("seat")),
        seat_asked_by=_text(data.get("seat_asked_by")),
        waits_for_sky=data.get("resumes_when_clear") is True,
        temporary=_counts(data.get("temporary")),
        pier_side=_text(data.get("pier_side")),
        exposing_until_utc_ns=_whole(data.get("exposing_until_utc_ns")),
        next_start_utc_ns=_whole(data.get("next_start_utc_ns")),
        health=_health(data.get("health")),
    )


def _counts(value: Any) -> dict[str, int]:
    table = value if isinstance(value, Mapping) else {}
    return {str(name): count for name, count in table.items() if isinstance(count, int)}


def _health(value: Any) -> tuple[HealthView, ...]:
    rows = value if isinstance(value, list | tuple) else ()
    return tuple(
        HealthView(
            name=printable(str(row.get("name", ""))),
            ok=row.get("ok") is True,
            text=printable(str(row.get("text", ""))),
        )
        for row in rows
        if isinstance(row, Mapping)
    )


def _text(value: Any) -> str | None:
    return printable(value) if isinstance(value, str) and value else None


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _whole(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(printable(str(v)) for v in value) if isinstance(value, list | tuple) else ()
