"""Update of the sources one after another: each at most once in two hours, none after a refusal."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.base import OrbitError, read_private_lines, system_errors_as, value_errors_as
from rsoconsole.orbits import ElementSets, element_text, not_used_words, parse_element_sets
from rsoconsole.pipeline.sources.fetch import (
    DEADLINE_S,
    MAX_BYTES,
    Fetcher,
    FetchError,
    without_secrets_of,
)
from rsoconsole.pipeline.sources.store import ElementSource, ElementStore, SourceStatus
from rsoconsole.words import NAME_ELEMENTS, utc_ns_to_iso

NEEDED = (
    "write your Space-Track user name and password as two lines of a file, 'chmod 600' it, and name"
    " it in catalogue.space_track_login"
)


def read_login(path: Path | None) -> tuple[str, str]:
    """Read user name and password from a file.

    Raises OrbitError with the remedy; the message holds neither of them.
    """
    if path is None:
        raise OrbitError(f"Space-Track wants an account: {NEEDED}")
    lines = read_private_lines(path, OrbitError, NEEDED)
    if len(lines) != 2:
        raise OrbitError(f"{path} has {len(lines)} lines: {NEEDED}")
    return lines[0], lines[1]


def fetch_with_login(url: str, base_url: str, login: tuple[str, str], deadline_s: float) -> bytes:
    """Log in and fetch one address. Raises FetchError, of kind "refused" for a failed login."""
    fetcher = Fetcher(deadline_s=deadline_s, is_bound=True)
    answer = fetcher.get(
        f"{base_url.rstrip('/')}/ajaxauth/login", form={"identity": login[0], "password": login[1]}
    )
    if b"failed" in answer[:200].lower():
        raise FetchError("Space-Track does not accept the account", "refused")
    return fetcher.get(url)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceUpdate:
    """Outcome of the update of one source."""

    source: ElementSource
    is_fetched: bool
    is_fault: bool
    words: str
    kept: SourceStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceUpdater:
    """Updates sources one after another.

    ``wait`` is called before each request and before its answer is parsed. It raises OrbitError
    where the update must not go on: before a request that ends the run; afterwards it is ignored,
    so that the answer is not lost.
    """

    store: ElementStore
    celestrak_url: str
    space_track_url: str
    space_track_login: Path | None = None
    deadline_s: float = DEADLINE_S
    wait: Callable[[], None] = lambda: None
    now_utc_ns: Callable[[], int] = time.time_ns

    def run(self, sources: Sequence[ElementSource]) -> Iterator[SourceUpdate]:
        """Update each source, in order. Raises OrbitError where the cache cannot be written."""
        refusing: dict[str, str] = {}
        for source in sources:
            updated = self._one(source, refusing)
            if updated.kept.refused_utc_ns is not None and updated.is_fault:
                refusing.setdefault(self._host(source), source.words)
            yield updated

    def import_file(self, source: ElementSource) -> SourceStatus:
        """Import a local file into the cache. Raises OrbitError where it cannot be read."""
        now_utc_ns = self.now_utc_ns()
        assert source.file is not None
        text, sets = self._read(source, _file_content(source.file))
        return self.store.replace_elements(source, text, sets, now_utc_ns)

    def _one(self, source: ElementSource, refusing: dict[str, str]) -> SourceUpdate:
        now_utc_ns = self.now_utc_ns()
        kept = self.store.current_status(source, now_utc_ns)
        reason = self._not_now(source, kept, refusing, now_utc_ns)
        if reason is None:
            self.wait()
            now_utc_ns = self.now_utc_ns()
            # Before it is asked: whatever ends this run, it is not asked again within two hours.
            if source.file is None:
                kept, is_ours = self.store.claim_request(source, now_utc_ns)
                if not is_ours:
                    reason = self._not_now(source, kept, refusing, now_utc_ns)
        if reason is not None:
            return SourceUpdate(
                source=source, is_fetched=False, is_fault=False, words=reason, kept=kept
            )
        try:
            content = self._content(source)
            with contextlib.suppress(OrbitError):  # a mount that slews on loses nothing fetched
                self.wait()
            text, sets = self._read(source, content)
        except OrbitError as error:
            return self._failed(source, kept, error, now_utc_ns)
        now = self.store.replace_elements(source, text, sets, now_utc_ns)
        return SourceUpdate(
            source=source, is_fetched=True, is_fault=False, words=_words(kept, now), kept=now
        )

    def _not_now(
        self, source: ElementSource, kept: SourceStatus, refusing: dict[str, str], now_utc_ns: int
    ) -> str | None:
        """Return the reason why a source is not asked now; None where it is."""
        if source.file is not None:
            return None
        again = f"'rsoconsole catalogue add {source.words}' asks it again"
        if kept.refused_utc_ns is not None:
            day = utc_ns_to_iso(kept.refused_utc_ns, 0)
            return f"not asked: it refused on {day}. Settle that with its owner, then {again}"
        if (by := refusing.get(self._host(source))) is not None:
            return f"not asked: its host has just refused {by}"
        due_utc_ns = kept.due_utc_ns(now_utc_ns)
        if due_utc_ns > now_utc_ns:
            return f"not asked: once in two hours at most, next at {utc_ns_to_iso(due_utc_ns, 0)}"
        return None

    def _failed(
        self, source: ElementSource, before: SourceStatus, error: OrbitError, now_utc_ns: int
    ) -> SourceUpdate:
        words, kind = str(error), error.kind if isinstance(error, FetchError) else "failed"
        if kind == "refused":
            kept = self.store.update_status(source, fault=words, refused_utc_ns=now_utc_ns)
            words += "; it is not asked again until it is added again"
        elif kind == "unreachable":
            kept = self.store.update_status(source, fault=words, asked_utc_ns=before.asked_utc_ns)
        else:
            kept = self.store.update_status(source, fault=words)
        if kept.fetched_utc_ns is not None:
            words += f"; what came on {utc_ns_to_iso(kept.fetched_utc_ns, 0)} is kept"
        return SourceUpdate(source=source, is_fetched=False, is_fault=True, words=words, kept=kept)

    def _content(self, source: ElementSource) -> bytes:
        if source.file is not None:
            return _file_content(source.file)
        url = self._url(source)
        if source.kind != "space-track":
            return Fetcher(deadline_s=self.deadline_s).get(url)
        login = read_login(self.space_track_login)
        return fetch_with_login(url, self.space_track_url, login, self.deadline_s)

    def _read(self, source: ElementSource, content: bytes) -> tuple[str, ElementSets]:
        """Decode and parse elements. Raises OrbitError, without any secret of the address."""
        try:
            with value_errors_as(OrbitError, f"{source.words}: ", OrbitError):
                text = element_text(content)
            return text, parse_element_sets(text, source.words)
        except OrbitError as error:
            raise OrbitError(without_secrets_of(self._url(source), str(error))) from None

    def _url(self, source: ElementSource) -> str:
        return source.url(celestrak_url=self.celestrak_url, space_track_url=self.space_track_url)

    def _host(self, source: ElementSource) -> str:
        return source.host(celestrak_url=self.celestrak_url, space_track_url=self.space_track_url)


def _file_content(path: Path) -> bytes:
    with system_errors_as(OrbitError, f"{path} cannot be read: "):
        if not path.is_file():
            raise OrbitError(f"{path} is no file: {NAME_ELEMENTS}")
        if path.stat().st_size > MAX_BYTES:
            raise OrbitError(f"{path} is larger than {MAX_BYTES >> 20} MB: name element sets")
        return path.read_bytes()


def _words(before: SourceStatus, now: SourceStatus) -> str:
    words = f"{now.objects:,} objects"
    if now.not_used:
        words += f", {not_used_words(now.sets, [each.words for each in now.not_used])}"
    if before.objects and now.objects < before.objects / 2:
        words += f", {before.objects:,} before: look whether the source has changed"
    return words
