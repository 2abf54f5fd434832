"""Files of a session, in its folder or in an archive."""

import contextlib
import hashlib
import io
import os
import shutil
import stat
import tarfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import IO, TypeAlias

from rsoconsole.base import SessionError, system_errors_as
from rsoconsole.session.log.schema import DATABASE

PIECE_BYTES = 1 << 20
MANIFEST = "MANIFEST.sha256"
"""Name of the list of an archive's hashes, as ``sha256sum`` writes and checks them."""


@dataclass(frozen=True, slots=True)
class FolderFiles:
    """Session as a folder."""

    place: Path

    def sizes(self) -> Mapping[str, int]:
        """Sizes of all regular files, bytes by path in the session.

        Files that vanish meanwhile are left out, and so are links: one in a stranger's session may
        point anywhere, and repairing or packing it would reach there.
        """
        found: dict[str, int] = {}
        for top, _, names in os.walk(self.place, onerror=_raise):
            for name in names:
                path = Path(top) / name
                try:
                    status = path.lstat()
                except FileNotFoundError:
                    continue
                if stat.S_ISREG(status.st_mode):
                    found[path.relative_to(self.place).as_posix()] = status.st_size
        return found

    def open(self, path: str) -> IO[bytes]:
        """Open a file for its bytes. Raises OSError."""
        # A pipe would be waited for, and what a link names is not the session's.
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        return os.fdopen(os.open(self.place / path, flags), "rb")

    def folder(self) -> Path:
        """Folder of the session."""
        return self.place


class ArchiveFiles:
    """Session as a tar file with one folder in it, not compressed as a whole."""

    def __init__(self, place: Path, tar: tarfile.TarFile, scratch: Path) -> None:
        self._tar = tar
        self._members: dict[str, tarfile.TarInfo] = {}
        for member in tar:
            inside = PurePosixPath(member.name).parts[1:]
            if member.isfile() and inside:
                self._members["/".join(inside)] = member
        if not _has_end(tar):
            raise tarfile.ReadError("it breaks off")
        if DATABASE not in self._members:
            raise SessionError(f"{place} holds no session: it has no {DATABASE} in one folder")
        self._scratch = scratch
        with self.open(DATABASE) as packed, (scratch / DATABASE).open("wb") as stream:
            while piece := packed.read(PIECE_BYTES):
                stream.write(piece)

    def sizes(self) -> Mapping[str, int]:
        """Sizes of all files, bytes by path in the session."""
        return {path: member.size for path, member in self._members.items()}

    def open(self, path: str) -> IO[bytes]:
        """Open a file for its bytes. Raises OSError."""
        stream = self._tar.extractfile(self._members[path])
        return io.BytesIO() if stream is None else stream

    def folder(self) -> Path:
        """Scratch folder with the database alone."""
        return self._scratch


SessionFiles: TypeAlias = FolderFiles | ArchiveFiles
"""Files of a session, its database as one that SQLite can open."""


@contextmanager
def open_session_files(place: Path) -> Iterator[SessionFiles]:
    """Open the files of a session, in its folder or its archive.

    Raises SessionError when there is neither.
    """
    if not place.is_file():
        yield FolderFiles(place)
        return
    with TemporaryDirectory(prefix="rsoconsole-") as scratch:
        try:
            with tarfile.open(place, "r:") as tar:
                yield ArchiveFiles(place, tar, Path(scratch))
        except (tarfile.TarError, EOFError) as error:
            raise SessionError(
                f"{place} is no whole archive of a session ({error}): copy or make it again"
            ) from error


def hash_of(
    session_files: SessionFiles, path: str, on_bytes: Callable[[int], None] | None = None
) -> str:
    """SHA-256 of one file, 64 hexadecimal digits. Raises OSError."""
    digest = hashlib.sha256()
    with session_files.open(path) as stream:
        while piece := stream.read(PIECE_BYTES):
            digest.update(piece)
            if on_bytes is not None:
                on_bytes(len(piece))
    return digest.hexdigest()


def parse_manifest(text: str) -> dict[str, str]:
    """Parse hashes by path, from lines as ``sha256sum`` writes them; other lines are skipped."""
    pairs = (line.partition("  ") for line in text.splitlines())
    return {path: digest for digest, _, path in pairs if path}


def _has_end(tar: tarfile.TarFile) -> bool:
    """True where two empty blocks stand behind the last file: one that breaks off has none."""
    assert tar.fileobj is not None
    tar.fileobj.seek(tar.offset)
    return tar.fileobj.read(2 * tarfile.BLOCKSIZE) == bytes(2 * tarfile.BLOCKSIZE)


def _raise(error: OSError) -> None:
    raise error


def folders_in(root: Path) -> list[Path]:
    """Paths directly in a folder; empty where there is no folder. Raises SessionError."""
    refused = system_errors_as(SessionError, f"{root} cannot be looked into: ")
    with refused, contextlib.suppress(FileNotFoundError):
        return list(root.iterdir())
    return []


def last_write_utc_ns(folder: Path) -> int:
    """Time of the last write to a session's log, UTC ns; 0 where it is not known."""
    with contextlib.suppress(OSError):
        return (folder / DATABASE).stat().st_mtime_ns
    return 0


def replace_folder(beside: Path, folder: Path) -> None:
    """Rename ``beside`` to ``folder``; an earlier folder is removed only when the new one stands.

    Raises OSError.
    """
    if not folder.exists():
        beside.rename(folder)
        return
    gone = folder.with_name(f".{folder.name}.gone")
    shutil.rmtree(gone, ignore_errors=True)
    folder.rename(gone)
    beside.rename(folder)
    shutil.rmtree(gone, ignore_errors=True)
