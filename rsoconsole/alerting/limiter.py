"""How often the operator is told: a kind rests after a message, an hour has a limit. Pure."""

from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field, replace

from rsoconsole.alerting.alert import Alert
from rsoconsole.config import AlertKind

HOUR_S = 3600.0


@dataclass(slots=True)
class Limiter:
    """Lets alerts through. Faults and limits rest by their words, and have an hour of their own."""

    events: Collection[AlertKind]
    quiet_s: float
    most_per_hour: int
    _last_s: dict[str, float] = field(default_factory=dict)
    _sent_s: dict[bool, deque[float]] = field(
        default_factory=lambda: {True: deque(), False: deque()}
    )
    _held: dict[str, int] = field(default_factory=dict)

    def passed(self, alert: Alert, now_s: float) -> Alert | None:
        """The alert, with how many like it were held back before; None where it is held itself.

        ``now_s``: of a clock that only goes on.
        """
        if alert.kind not in self.events:
            return None
        key = f"{alert.kind}: {alert.text}" if alert.is_urgent else alert.kind
        recent = self._sent_s[alert.is_urgent]
        while recent and now_s - recent[0] >= HOUR_S:
            recent.popleft()
        last_s = self._last_s.get(key)
        is_early = last_s is not None and now_s - last_s < self.quiet_s
        if is_early or len(recent) >= self.most_per_hour:
            self._held[alert.kind] = self._held.get(alert.kind, 0) + 1
            return None
        self._last_s[key] = now_s
        self._forget(now_s)
        recent.append(now_s)
        held = self._held.pop(alert.kind, 0)
        words = f"{alert.text} ({held} more of this kind before it)" if held else alert.text
        return replace(alert, text=words)

    def _forget(self, now_s: float) -> None:
        """What rests no more: words of faults may be many in a night."""
        rest_s = max(self.quiet_s, HOUR_S)
        self._last_s = {key: at for key, at in self._last_s.items() if now_s - at < rest_s}
