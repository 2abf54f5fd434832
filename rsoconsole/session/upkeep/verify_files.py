"""Whether a session's files are those that were written, by their hashes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rsoconsole.durable_files import PART
from rsoconsole.session.files import (
    KEEP,
    MANIFEST,
    REPAIR,
    UPKEEP,
    FolderHoldings,
    Holdings,
    Verification,
    hash_of,
    parse_manifest,
    parse_notes,
    pruned_on,
)
from rsoconsole.session.log import BESIDE_DATABASE, BRANCHES, CONFIG, DATABASE, JOURNAL, WAL, WORLD

_KNOWN = {DATABASE, *BESIDE_DATABASE, CONFIG, WORLD, UPKEEP, KEEP, MANIFEST}


@dataclass(frozen=True, slots=True, kw_only=True)
class FileRow:
    """A row of the table ``files`` that names a file."""

    path: str
    bytes: int | None
    sha256: str | None


class FilesCheck:
    """One walk over a session's files."""

    def __init__(
        self,
        holdings: Holdings,
        found: Verification,
        rows: Iterable[FileRow],
        on_bytes: Callable[[int, int], None] | None,
    ) -> None:
        """Raises OSError when the files cannot be listed."""
        self._holdings = holdings
        self._found = found
        self._rows = tuple(rows)
        self._on_bytes = on_bytes
        self._sizes = holdings.sizes()
        self._total = sum(self._sizes.get(row.path, 0) for row in self._rows)

    def run(self) -> None:
        """Judge every file that the session names, and those it does not. Raises OSError."""
        pruned = pruned_on(parse_notes(self._read(UPKEEP)))
        gone: dict[str, int] = {}
        for row in self._rows:
            if row.path in self._sizes:
                self._judge(row)
            elif row.path in pruned:
                gone[pruned[row.path]] = gone.get(pruned[row.path], 0) + 1
            elif self._found.state != "live":
                self._found.damage(row.path, "the file is not there")
        for t_utc, number in gone.items():
            self._found.remark("files", f"{number} were pruned on {t_utc}")
        manifest = parse_manifest(self._read(MANIFEST).decode("utf-8", errors="replace"))
        judged = {row.path for row in self._rows} | set(pruned)
        self._judge_manifest(manifest, judged)
        if self._found.state != "live":
            for path in sorted(set(self._sizes) - judged - set(manifest)):
                self._judge_stray(path)

    def _judge(self, row: FileRow) -> None:
        size = self._sizes[row.path]
        self._found.files += 1
        try:
            if row.sha256 is None:
                self._found.damage(row.path, "no hash of it is on record")
            elif hash_of(self._holdings, row.path, self._count) != row.sha256:
                what = f"{size} bytes, not the {row.bytes} that were written"
                if row.bytes is None or row.bytes == size:
                    what = "its bytes are not those that were written"
                self._found.damage(row.path, what)
        except OSError as error:
            self._found.damage(row.path, f"cannot be read: {error.strerror or error}")

    def _judge_stray(self, path: str) -> None:
        is_closed = self._found.state == "closed"
        if path.startswith(f"{BRANCHES}/") or path in _KNOWN - set(BESIDE_DATABASE):
            return
        if path in BESIDE_DATABASE:
            if is_closed and self._sizes[path] and path in (WAL, JOURNAL):
                self._found.leftover(path, "the session is complete, but in two files")
        elif path.endswith(PART):
            self._found.leftover(path, "a file that was being written")
        else:
            self._found.leftover(
                path,
                "the session does not know this file",
                f"{REPAIR} where it is a frame or a picture",
            )

    def _judge_manifest(self, manifest: dict[str, str], judged: set[str]) -> None:
        """Hold an archive's own list against what is there; frames and pictures were judged.

        An unpacked session lives on: notes and branches may have changed since, its log not.
        """
        is_archive = not isinstance(self._holdings, FolderHoldings)
        for path in sorted(set(manifest) - judged):
            if not (is_archive or path == DATABASE):
                continue
            if path not in self._sizes:
                self._found.damage(path, "the archive's list names it; it is not there")
            elif hash_of(self._holdings, path) != manifest[path]:
                self._found.damage(path, "its bytes are not those that were archived")
        if is_archive and not manifest:
            self._found.remark(MANIFEST, "the archive has no list of hashes")

    def _read(self, path: str) -> bytes:
        if path not in self._sizes:
            return b""
        with self._holdings.open(path) as stream:
            return stream.read()

    def _count(self, size: int) -> None:
        self._found.bytes += size
        if self._on_bytes is not None:
            self._on_bytes(self._found.bytes, self._total)
