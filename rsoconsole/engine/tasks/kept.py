"""How long a track that was ended can be followed again, and what it is called. Pure."""

from collections.abc import Mapping

from rsoconsole.config import FilterConfig
from rsoconsole.engine.aim import Authority
from rsoconsole.pipeline.cycle import kept_until_utc_ns
from rsoconsole.tracking.association import Following


class KeptTrack:
    """Knows until when the kept track is worth anything."""

    def __init__(self) -> None:
        self._following: Following | None = None
        self.until_utc_ns: int | None = None
        """None while nothing is kept."""

    def see(self, authority: Authority, settings: FilterConfig, now_utc_ns: int) -> None:
        """The state has changed. In MANUAL a track is kept as long as it would be coasted."""
        kept = authority.kept
        if kept is None:
            self._following = self.until_utc_ns = None
            return
        if kept is self._following and authority.state != "MANUAL":
            return
        self._following = kept
        is_lent = authority.state == "MANUAL" and authority.is_resumable
        self.until_utc_ns = kept_until_utc_ns(kept, settings, now_utc_ns, is_lent=is_lent)

    def is_over(self, now_utc_ns: int) -> bool:
        """Whether what was kept is too old by now."""
        return self.until_utc_ns is not None and now_utc_ns >= self.until_utc_ns


def kept_name(following: Following | None, names: Mapping[int, str]) -> str | None:
    """What a track is called; None where nothing is followed. ``names``: by track id."""
    if following is None or following.track_id is None:
        return None
    return names.get(following.track_id, f"track {following.track_id}")
