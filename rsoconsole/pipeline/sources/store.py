"""Cache of elements: one file for each source as it came, and an index of times and counts.

The index is written whole or not at all, and may be lost: the files are then read in the order of
their names, and every source may be asked again two hours later.
"""

import contextlib
import hashlib
import json
import os
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

from pydantic import TypeAdapter

from rsoconsole.base import (
    PART,
    OrbitError,
    lock_file,
    parse_json,
    read_foreign_text,
    system_errors_as,
    write_durably,
)
from rsoconsole.config import SourceKind, data_dir, expand_home, split_source, without_secrets
from rsoconsole.orbits import ElementSets, UnusedSet, parse_element_sets
from rsoconsole.words import NS_PER_S

_SPACE_TRACK = {
    "all": "class/gp/decay_date/null-val/epoch/>now-30/orderby/norad_cat_id/format/json",
    "geo": "class/gp/decay_date/null-val/epoch/>now-30/mean_motion/0.95--1.05/eccentricity/<0.05"
    "/orderby/norad_cat_id/format/json",
}
"""Named queries; the newest set of each object (class ``gp``)."""


@dataclass(frozen=True, slots=True)
class ElementSource:
    """Source of elements, as the configuration names it."""

    text: str
    kind: SourceKind
    what: str

    @property
    def slug(self) -> str:
        """Name of the source's file in the cache; different sources have different names."""
        plain = re.sub(r"[^a-z0-9]+", "-", without_secrets(self.text).lower()).strip("-")[:60]
        return f"{plain}-{hashlib.sha256(self.text.encode()).hexdigest()[:8]}"

    @property
    def words(self) -> str:
        """Name of the source for messages, without any secret."""
        return without_secrets(self.text)

    @property
    def file(self) -> Path | None:
        """Path of a local source; None for a source on the web."""
        return expand_home(self.what) if self.kind == "file" else None

    def url(self, *, celestrak_url: str, space_track_url: str) -> str:
        """Return the address of the source; empty for a local one."""
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
        """Return the host of the source; empty for a local one."""
        url = self.url(celestrak_url=celestrak_url, space_track_url=space_track_url)
        return urlsplit(url).netloc.rpartition("@")[2].lower()

    def _query(self, key: str) -> str:
        name, equals, value = self.what.partition("=")
        pair = {name.upper(): value} if equals else {key: self.what}
        return urlencode({**pair, "FORMAT": "json"})


def parse_source(text: str) -> ElementSource:
    """Parse a source's name. Raises ValueError with what to write instead."""
    kind, what = split_source(text)
    return ElementSource(f"{kind}:{what}", kind, what)


MIN_NS = 2 * 3600 * NS_PER_S
"""Shortest time between two requests to a source, successful or not, ns."""
INDEX = "sources.json"
LOCK = ".lock"
FORMAT = 1
_WAIT_S = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceStatus:
    """State of one source in the cache; None for what is not known."""

    source: str
    file: str | None = None
    asked_utc_ns: int | None = None
    """Time of the last request, successful or not."""
    fetched_utc_ns: int | None = None
    refused_utc_ns: int | None = None
    """Time at which the source refused a request: it is not asked until it is added again."""
    fault: str | None = None
    """Fault of the last request, which left older elements in the cache; None without one."""
    objects: int = 0
    sets: int = 0
    newest_epoch_utc_ns: int | None = None
    middle_epoch_utc_ns: int | None = None
    """Median epoch: half of the objects have newer elements."""
    not_used: tuple[UnusedSet, ...] = ()
    """Sets of the source that cannot be used, each with its reason."""

    def due_utc_ns(self, now_utc_ns: int) -> int:
        """Return the time, UTC ns, from which the source may be asked again.

        A last request in the future, from a clock that was wrong, counts as made now.
        """
        if self.asked_utc_ns is None:
            return now_utc_ns
        return min(self.asked_utc_ns, now_utc_ns) + MIN_NS


def default_folder() -> Path:
    """Return the default folder of the cache, in the user's data folder."""
    return data_dir() / "catalogue"


def is_store(folder: Path) -> bool:
    """True where a folder is a cache of elements."""
    return (folder / INDEX).is_file()


class ElementStore:
    """Cache of elements. Every method raises OrbitError where its folder cannot be used."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder or default_folder()

    def statuses(self) -> dict[str, SourceStatus]:
        """Return the status of each source, in order of precedence; empty without a cache."""
        indexed = self._indexed()
        return self._of_files() if indexed is None else indexed

    def files(self) -> tuple[Path, ...]:
        """Return the files of elements in order of their sources' precedence."""
        named = [self.folder / each.file for each in self.statuses().values() if each.file]
        return tuple(path for path in named if path.is_file())

    def replace_elements(
        self, source: ElementSource, text: str, sets: ElementSets, now_utc_ns: int
    ) -> SourceStatus:
        """Replace a source's elements by new ones; the time of the last request stays."""
        name = f"{source.slug}.txt"
        with self._writing():
            self._write(name, text.encode())
            return self._changed(
                source,
                file=name,
                fetched_utc_ns=now_utc_ns,
                refused_utc_ns=None,
                fault=None,
                **element_figures(sets),
            )

    def update_status(self, source: ElementSource, **values: Any) -> SourceStatus:
        """Change fields of a source's status, named as in ``SourceStatus``; return the status."""
        with self._writing():
            return self._changed(source, **values)

    def current_status(self, source: ElementSource, now_utc_ns: int) -> SourceStatus:
        """Return the status of a source, after correcting a last request in the future to now.

        A clock that was wrong leaves such a time. The correction is written to the index.
        """
        kept = self.statuses().get(source.text, SourceStatus(source=source.text))
        if kept.asked_utc_ns is not None and kept.asked_utc_ns > now_utc_ns:
            return self.update_status(source, asked_utc_ns=now_utc_ns)
        return kept

    def claim_request(self, source: ElementSource, now_utc_ns: int) -> tuple[SourceStatus, bool]:
        """Return (source's status, True where it may be asked now); if True, record the request.

        The status is that before this request. Both are one step: of two simultaneous updates only
        one may ask.
        """
        with self._writing():
            kept = self.statuses().get(source.text, SourceStatus(source=source.text))
            if kept.refused_utc_ns is not None or kept.due_utc_ns(now_utc_ns) > now_utc_ns:
                return kept, False
            self._changed(source, asked_utc_ns=now_utc_ns)
            return kept, True

    def set_sources(self, order: Sequence[ElementSource]) -> None:
        """Set the cache's sources, in order of precedence; remove the files of all others.

        No file is removed where the index is damaged or lost.
        """
        with self._writing():
            indexed = self._indexed()
            is_damaged = indexed is None and (self.folder / INDEX).exists()
            kept = indexed or {}
            rows = [
                self._adopted(each, kept.get(each.text, SourceStatus(source=each.text)), is_damaged)
                for each in order
            ]
            self._write_index(rows)
            if indexed is None:
                return
            named = {each.file for each in rows}
            for path in self.folder.glob("*.txt"):
                if path.name not in named:
                    path.unlink(missing_ok=True)

    def _changed(self, source: ElementSource, **values: Any) -> SourceStatus:
        kept = self.statuses()
        changed = replace(kept.get(source.text, SourceStatus(source=source.text)), **values)
        kept[source.text] = changed
        rows = [each for each in kept.values() if each is changed or each.file != changed.file]
        self._write_index(rows if changed.file else list(kept.values()))
        return changed

    def _adopted(self, source: ElementSource, kept: SourceStatus, is_damaged: bool) -> SourceStatus:
        """Status with the file under the source's name; counted as asked now where unknown."""
        path = self.folder / f"{source.slug}.txt"
        if kept.file is None and path.is_file():
            now_ns = time.time_ns()
            kept = replace(kept, asked_utc_ns=kept.asked_utc_ns or now_ns, **_figures_of(path))
        elif is_damaged:
            kept = replace(kept, asked_utc_ns=time.time_ns())
        return kept

    def _indexed(self) -> dict[str, SourceStatus] | None:
        """Return the status by source from the index; None where it is damaged or lost."""
        try:
            rows = parse_json(read_foreign_text(self.folder / INDEX))["sources"]
            found = TypeAdapter(list[SourceStatus]).validate_python(rows)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        if any(each.file is not None and Path(each.file).name != each.file for each in found):
            return None  # it names what lies elsewhere
        return {each.source: each for each in found}

    def _of_files(self) -> dict[str, SourceStatus]:
        """Status of the files without an index; counted as asked now, as nothing else is known."""
        now_ns = time.time_ns()
        return {
            (key := f"file:{path}"): SourceStatus(source=key, file=path.name, asked_utc_ns=now_ns)
            for path in sorted(self.folder.glob("*.txt"))
        }

    def _write_index(self, rows: Sequence[SourceStatus]) -> None:
        content = {"format": FORMAT, "sources": [asdict(each) for each in rows]}
        self._write(INDEX, json.dumps(content, indent=1).encode())

    def _write(self, name: str, content: bytes) -> None:
        remedy = "): free space there, or set its permissions"
        with system_errors_as(OrbitError, f"{self.folder / name} cannot be written (", remedy):
            write_durably(self.folder / name, content, mode=0o600)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Lock the cache for one writer at a time: a timer's or the operator's."""
        with system_errors_as(
            OrbitError, f"{self.folder} cannot be made (", "): set its permissions"
        ):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            try:
                lock = lock_file(self.folder / LOCK, wait_s=_WAIT_S)
            except BlockingIOError as error:
                raise OrbitError(
                    f"another update writes to {self.folder} for {_WAIT_S:.0f} s: see whether it"
                    " hangs"
                ) from error
        try:
            for beside in self.folder.glob(f"*{PART}"):
                beside.unlink(missing_ok=True)
            yield
        finally:
            os.close(lock)


def element_figures(sets: ElementSets) -> dict[str, Any]:
    """Return what is known of element sets, named by fields of ``SourceStatus``."""
    newest: dict[int, int] = {}
    for each in sets.entries:
        newest[each.norad_id] = max(each.epoch_utc_ns, newest.get(each.norad_id, 0))
    epochs = sorted(newest.values())
    return {
        "objects": len(newest),
        "sets": len(sets.entries),
        "newest_epoch_utc_ns": epochs[-1],
        "middle_epoch_utc_ns": epochs[len(epochs) // 2],
        "not_used": sets.not_used,
    }


def _figures_of(path: Path) -> dict[str, Any]:
    """Figures of a cached file, as fields of ``SourceStatus``; empty where it has no elements."""
    try:
        sets = parse_element_sets(path.read_bytes(), path.name)
        fetched_ns = path.stat().st_mtime_ns
    except (OSError, OrbitError):
        return {}
    return {"file": path.name, "fetched_utc_ns": fetched_ns, **element_figures(sets)}
