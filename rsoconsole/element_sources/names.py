"""A source of elements: what it is called, where it is asked for, under which name it is kept."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, urlencode, urlsplit

from rsoconsole.config import SourceKind, home_path, shown, split_source

_SPACE_TRACK = {
    "all": "class/gp/decay_date/null-val/epoch/>now-30/orderby/norad_cat_id/format/json",
    "geo": "class/gp/decay_date/null-val/epoch/>now-30/mean_motion/0.95--1.05/eccentricity/<0.05"
    "/orderby/norad_cat_id/format/json",
}
"""Queries with a name of their own; the newest set of each object (class ``gp``)."""


@dataclass(frozen=True, slots=True)
class Source:
    """One source as the configuration names it."""

    text: str
    kind: SourceKind
    what: str

    @property
    def slug(self) -> str:
        """Name of its file in the cache; different for different sources."""
        plain = re.sub(r"[^a-z0-9]+", "-", shown(self.text).lower()).strip("-")[:60]
        return f"{plain}-{hashlib.sha256(self.text.encode()).hexdigest()[:8]}"

    @property
    def words(self) -> str:
        """For people: nothing secret in it."""
        return shown(self.text)

    @property
    def file(self) -> Path | None:
        """Of a local source."""
        return home_path(self.what) if self.kind == "file" else None

    def url(self, *, celestrak_url: str, space_track_url: str) -> str:
        """Where it is asked for; empty of a local one."""
        base = celestrak_url.rstrip("/")
        if self.kind == "celestrak":
            return f"{base}/NORAD/elements/gp.php?{self._query('GROUP')}"
        if self.kind == "supgp":
            return f"{base}/NORAD/elements/supplemental/sup-gp.php?{self._query('FILE')}"
        if self.kind == "space-track":
            query = quote(_SPACE_TRACK.get(self.what, self.what), safe="/%,:~-._")
            return f"{space_track_url.rstrip('/')}/basicspacedata/query/{query}"
        return self.what if self.kind == "url" else ""

    def host(self, *, celestrak_url: str, space_track_url: str) -> str:
        """Whom it asks; empty of a local one."""
        url = self.url(celestrak_url=celestrak_url, space_track_url=space_track_url)
        return urlsplit(url).netloc.rpartition("@")[2].lower()

    def _query(self, key: str) -> str:
        name, equals, value = self.what.partition("=")
        pair = {name.upper(): value} if equals else {key: self.what}
        return urlencode({**pair, "FORMAT": "json"})


def parse_source(text: str) -> Source:
    """Raises ValueError with what to write instead."""
    kind, what = split_source(text)
    return Source(f"{kind}:{what}", kind, what)
