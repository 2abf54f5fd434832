"""Archives a session as one file: a plain tar with the hash of everything in it.

Plain (not compressed), because the large files are compressed already: any tool unpacks the tar,
and one frame can be read without unpacking the others. The archived database is one file without
free pages. The original is not changed.
"""

import hashlib
import io
import os
import shutil
import sqlite3
import tarfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias

from rsoconsole.base import PART, SessionError, sync_folder
from rsoconsole.session.files.digest import Verification
from rsoconsole.session.files.session_files import MANIFEST, FolderFiles
from rsoconsole.session.files.upkeep_log import UPKEEP, add_note
from rsoconsole.session.log.schema import BESIDE_DATABASE, DATABASE
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.session.upkeep.store import remove_session
from rsoconsole.session.upkeep.verify import verify_session

OnBytes: TypeAlias = Callable[[str, int, int], None]
"""Callback for progress: (name of the present step, bytes so far, bytes in all)."""
ROOM = 1.02
"""Free disk that an archive needs, as a multiple of the size of the session's files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArchiveResult:
    """Result of archiving one session: the archive, written and read back."""

    session: Path
    path: Path
    files: int
    bytes: int
    verification: Verification
    is_removed: bool


def archive_session(
    folder: Path,
    out: Path,
    now_utc_ns: int,
    *,
    remove: bool = False,
    on_bytes: OnBytes | None = None,
) -> ArchiveResult:
    """Pack a closed, sound session into ``out/NAME.tar``, and verify the archive.

    ``remove``: then remove the original. ``on_bytes`` is called with (the present step, bytes so
    far, bytes in all). Raises SessionError when the session is not closed and sound, when there is
    an archive of this name, or when the disk refuses; no partial archive remains.
    """
    folder, out = Path(folder).resolve(), Path(out)
    target = out / f"{folder.name}.tar"
    report = on_bytes or (lambda _doing, _done, _total: None)
    _check_fit(folder, report)
    if target.exists():
        raise SessionError(f"{target} is there already: name another folder with --out")
    beside = target.with_name(target.name + PART)
    try:
        out.mkdir(parents=True, exist_ok=True)
        _check_room(folder, out)
        try:
            with _scratch_beside(beside) as scratch:
                sources = _stage(folder, scratch, now_utc_ns)
                _pack(folder.name, beside, sources, report)
            read_back = verify_session(
                beside, lambda done, total: report("reading back", done, total)
            )
            if not read_back.is_sound:
                fault = next(f for f in read_back.findings if f.severity == "damage")
                raise OSError(f"read back, {fault.place} is not what was packed: {fault.what}")
            beside.replace(target)
            sync_folder(out)
        finally:
            beside.unlink(missing_ok=True)
    except (OSError, sqlite3.Error, tarfile.TarError) as error:
        raise SessionError(
            f"{folder} cannot be archived to {out}: {error}; "
            "free some disk or name another folder with --out"
        ) from error
    read_back.session = target
    if remove:
        remove_session(folder)
    return ArchiveResult(
        session=folder,
        path=target,
        files=len(sources),
        bytes=target.stat().st_size,
        verification=read_back,
        is_removed=remove,
    )


def _check_fit(folder: Path, report: OnBytes) -> None:
    found = verify_session(folder, lambda done, total: report("verifying", done, total))
    damage = [each for each in found.findings if each.severity == "damage"]
    if damage:
        raise SessionError(
            f"{folder} is damaged ({damage[0].place}: {damage[0].what}), and an archive would be, "
            "too; 'rsoconsole sessions verify' says more, 'repair' what can be done"
        )
    if found.state != "closed":
        raise SessionError(
            f"{folder} is {found.state}: archive it when it is closed"
            + ("; 'rsoconsole sessions repair' closes it" if found.state == "cut off" else "")
        )


def _check_room(folder: Path, out: Path) -> None:
    needed = ROOM * sum(FolderFiles(folder).sizes().values())
    free = shutil.disk_usage(out).free
    if free < needed:
        raise OSError(f"{needed / 1e9:.1f} GB are needed, {free / 1e9:.1f} GB are free")


@contextmanager
def _scratch_beside(beside: Path) -> Iterator[Path]:
    """Create a folder on the archive's own disk; one that a cut has left is removed."""
    scratch = beside.with_name(beside.name + "-files")
    shutil.rmtree(scratch, ignore_errors=True)
    try:
        scratch.mkdir()
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _stage(folder: Path, scratch: Path, now_utc_ns: int) -> dict[str, Path]:
    """Collect the source of each file of the archive."""
    sources = {path: folder / path for path in FolderFiles(folder).sizes()}
    for name in (*BESIDE_DATABASE, MANIFEST):
        sources.pop(name, None)
    with closing(SessionReader(folder).connect()) as connection:
        connection.execute("VACUUM main INTO ?", (str(scratch / DATABASE),))
    if UPKEEP in sources:
        shutil.copyfile(sources[UPKEEP], scratch / UPKEEP)
    add_note(scratch, "archive", now_utc_ns, {})
    sources[DATABASE] = scratch / DATABASE
    sources[UPKEEP] = scratch / UPKEEP
    return sources


def _pack(name: str, beside: Path, sources: Mapping[str, Path], report: OnBytes) -> None:
    """Write the tar: the database first, the list of hashes last."""
    total, done = sum(path.stat().st_size for path in sources.values()), 0
    manifest: list[str] = []
    with beside.open("wb") as stream:
        with tarfile.open(fileobj=stream, mode="w", format=tarfile.PAX_FORMAT) as tar:
            for path in sorted(sources, key=lambda path: (path != DATABASE, path)):
                with sources[path].open("rb") as content:
                    digest = hashlib.file_digest(content, "sha256").hexdigest()
                    done += _add(tar, f"{name}/{path}", content, sources[path].stat().st_mtime)
                manifest.append(f"{digest}  {path}\n")
                report("packing", done, total)
            lines = io.BytesIO("".join(manifest).encode())
            _add(tar, f"{name}/{MANIFEST}", lines, sources[DATABASE].stat().st_mtime)
        stream.flush()
        os.fsync(stream.fileno())


def _add(tar: tarfile.TarFile, name: str, content: IO[bytes], mtime_s: float) -> int:
    """Add a file under ``name``, without an owner; return its bytes."""
    member = tarfile.TarInfo(name)
    member.size = content.seek(0, os.SEEK_END)
    content.seek(0)
    member.mtime = int(mtime_s)
    tar.addfile(member, content)
    return member.size
