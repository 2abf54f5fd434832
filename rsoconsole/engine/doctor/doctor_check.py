"""What one of the doctor's checks found."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """What one check found."""

    check: str = ""
    """Its name, which who runs it gives."""
    ok: bool | None
    """None when it cannot be told."""
    detail: str
    remedy: str = ""
    """What to do; empty when all is well."""


def well(detail: str, remedy: str = "") -> Check:
    """All is well; the remedy is for what could be better."""
    return Check(ok=True, detail=detail, remedy=remedy)


def bad(detail: str, remedy: str = "") -> Check:
    """Something is not."""
    return Check(ok=False, detail=detail, remedy=remedy)


def unsure(detail: str, remedy: str = "") -> Check:
    """It cannot be told, or one may live with it."""
    return Check(ok=None, detail=detail, remedy=remedy)
