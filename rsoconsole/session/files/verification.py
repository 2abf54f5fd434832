"""What a look at a session found: words that verify, repair and archive share."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from rsoconsole.session.log import is_written

Severity: TypeAlias = Literal["damage", "leftover", "remark"]
"""Something of the record is lost or changed · something waits to be repaired · good to know."""
State: TypeAlias = Literal["closed", "live", "cut off", "other version", "unreadable"]
Digest: TypeAlias = Literal["confirmed", "differs", "none"]

REPAIR = "'rsoconsole sessions repair' sets it right"
FROM_COPY = "take it from a copy of the session, if there is one; the rest is not affected"
NOTHING_TO_DO = "nothing to do"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is not as the session says."""

    severity: Severity
    place: str
    """A file by its path in the session's folder, or a part of the log."""
    what: str
    remedy: str


@dataclass(slots=True, kw_only=True)
class Verification:
    """What was looked at in one session, and what was found."""

    session: Path
    state: State = "unreadable"
    schema: int | None = None
    records: int = 0
    frames: int = 0
    files: int = 0
    """Files whose bytes were read."""
    bytes: int = 0
    digest: Digest = "none"
    """Of the log; none: it is not closed."""
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_sound(self) -> bool:
        """Whether nothing is damaged; a session that waits for its repair is sound."""
        return all(found.severity != "damage" for found in self.findings)

    def damage(self, place: str, what: str, remedy: str = FROM_COPY) -> None:
        """Something of the record is lost or changed."""
        self._add("damage", place, what, remedy)

    def leftover(self, place: str, what: str, remedy: str = REPAIR) -> None:
        """Something waits to be repaired; nothing is lost."""
        self._add("leftover", place, what, remedy)

    def remark(self, place: str, what: str, remedy: str = NOTHING_TO_DO) -> None:
        """Something is good to know."""
        self._add("remark", place, what, remedy)

    def _add(self, severity: Severity, place: str, what: str, remedy: str) -> None:
        self.findings.append(Finding(severity=severity, place=place, what=what, remedy=remedy))


def state_of(about: Mapping[str, Any]) -> State:
    """What the session's table ``meta`` says of its end."""
    if about.get("is_closed") is True:
        return "closed"
    return "live" if is_written(about) else "cut off"
