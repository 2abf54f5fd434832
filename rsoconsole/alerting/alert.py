"""One message to the operator."""

from dataclasses import dataclass

from rsoconsole.config import AlertKind

URGENT: frozenset[AlertKind] = frozenset(("fault", "limit"))
"""What somebody may have to get up for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """What has come to pass, in a sentence."""

    kind: AlertKind
    text: str
    t_utc_ns: int

    @property
    def is_urgent(self) -> bool:
        """Whether it has a share of its own of what may be sent."""
        return self.kind in URGENT
