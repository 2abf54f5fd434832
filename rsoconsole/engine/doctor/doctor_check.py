"""What one of the doctor's checks found."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """What one check found."""

    check: str
    ok: bool | None
    """None when it cannot be told."""
    detail: str
    remedy: str = ""
    """What to do; empty when all is well."""
