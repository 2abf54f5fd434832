"""The files of a session, whether it is a folder or an archive."""

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
"""Name of an archive's list of hashes, in the format of ``sha256sum``."""


@dataclass(frozen=True, slots=True)
class FolderFiles:
    """Files of a session that is a folder."""

    place: Path

    def sizes(self) -> Mapping[str, int]:
        """Return the size in bytes of every regular file, by its path in the session.

        Links are left out: those of a foreign session may point anywhere, and a repair or an
        archive would change or copy their targets. Files that vanish meanwhile are left out too.
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
        """Open a file for reading bytes. Raises OSError."""
        # A pipe would be waited for, and what a link names is not the session's.
        flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        return os.fdopen(os.open(self.place / path, flags), "rb")

    def folder(self) -> Path:
        """Return the folder that has the database: the session itself."""
        return self.place


class ArchiveFiles:
    """Files of a session that is a tar file with one folder in it; the tar is not compressed."""

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
        """Return the size in bytes of every file, by its path in the session."""
        return {path: member.size for path, member in self._members.items()}

    def open(self, path: str) -> IO[bytes]:
        """Open a file for reading bytes. Raises OSError."""
        stream = self._tar.extractfile(self._members[path])
        return io.BytesIO() if stream is None else stream

    def folder(self) -> Path:
        """Return the scratch folder into which the database, and nothing else, is unpacked."""
        return self._scratch


SessionFiles: TypeAlias = FolderFiles | ArchiveFiles
"""Files of a session; ``folder`` has its database as a file that SQLite can open."""


@contextmanager
def open_session_files(place: Path) -> Iterator[SessionFiles]:
    """Context with the files of the session at ``place``, a folder or an archive.

    Raises SessionError when ``place`` is neither.
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
    """Return the SHA-256 of one file, 64 hexadecimal digits.

    ``on_bytes`` is called with the number of bytes of each piece read. Raises OSError.
    """
    digest = hashlib.sha256()
    with session_files.open(path) as stream:
        while piece := stream.read(PIECE_BYTES):
            digest.update(piece)
            if on_bytes is not None:
                on_bytes(len(piece))
    return digest.hexdigest()


def parse_manifest(text: str) -> dict[str, str]:
    """Parse ``sha256sum`` lines into hash by path; lines of another form are skipped."""
    pairs = (line.partition("  ") for line in text.splitlines())
    return {path: digest for digest, _, path in pairs if path}


def _has_end(tar: tarfile.TarFile) -> bool:
    """True where two empty blocks stand behind the last file: one that breaks off has none."""
    assert tar.fileobj is not None
    tar.fileobj.seek(tar.offset)
    return tar.fileobj.read(2 * tarfile.BLOCKSIZE) == bytes(2 * tarfile.BLOCKSIZE)


def _raise(error: OSError) -> None:
    raise error


def paths_in(root: Path) -> list[Path]:
    """Return the paths directly in ``root``; [] where it does not exist. Raises SessionError."""
    refused = system_errors_as(SessionError, f"{root} cannot be looked into: ")
    with refused, contextlib.suppress(FileNotFoundError):
        return list(root.iterdir())
    return []


def last_write_utc_ns(folder: Path) -> int:
    """Return the time of the last write to a session's log, UTC ns; 0 where not known."""
    with contextlib.suppress(OSError):
        return (folder / DATABASE).stat().st_mtime_ns
    return 0


def replace_folder(beside: Path, folder: Path) -> None:
    """Rename ``beside`` to ``folder``, in place of an earlier folder of that name.

    The earlier folder is removed only after the rename. Raises OSError.
    """
    if not folder.exists():
        beside.rename(folder)
        return
    gone = folder.with_name(f".{folder.name}.gone")
    shutil.rmtree(gone, ignore_errors=True)
    folder.rename(gone)
    beside.rename(folder)
    shutil.rmtree(gone, ignore_errors=True)
