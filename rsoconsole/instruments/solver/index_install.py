"""``rsoconsole index install``: index files from a folder, or from data.astrometry.net.

Every file is checked for completeness in a temporary place beside its home and only then renamed
into it, so that a broken download or a full disk never leaves a file the solver would trust.
"""

import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from rsoconsole.errors import SolverError, said_as
from rsoconsole.instruments.solver.index_files import (
    SERIES_SCALES,
    IndexFile,
    examine,
    list_index_files,
    user_index_dir,
)

Progress = Callable[[str, int, int], None]
"""Called with a file's name, bytes done and bytes in all."""

_COPY_CHUNK = 4 << 20
_POLL_S = 0.5


def install(
    scales: Sequence[int],
    *,
    from_dir: Path | None = None,
    into: Path | None = None,
    progress: Progress = lambda _name, _done, _total: None,
) -> tuple[IndexFile, ...]:
    """Install the index files of these numbers; gives back what now lies in ``into``.

    ``from_dir`` is searched recursively, so that a folder of Debian packages unpacked with
    ``dpkg -x`` will do; without it the files are downloaded. A complete file that is already
    there is kept. Raises SolverError when any of them could not be had.
    """
    target = into or user_index_dir()
    with said_as(SolverError, f"{target} cannot be made: "):
        target.mkdir(parents=True, exist_ok=True)
    wanted = sorted(set(scales))
    if unknown := [n for n in wanted if n not in SERIES_SCALES]:
        raise SolverError(f"the series has no index {unknown}: numbers run from 7 to 19")
    present = {f.scale for f in list_index_files([target]) if f.is_healthy and f.is_whole_sky}
    missing = [n for n in wanted if n not in present]
    if missing and from_dir is not None:
        _copy(missing, from_dir, target, progress)
    elif missing:
        _download(missing, target, progress)
    return tuple(f for f in list_index_files([target]) if f.scale in wanted)


def _copy(scales: list[int], source: Path, target: Path, report: Progress) -> None:
    if not source.is_dir():
        raise SolverError(f"{source} is not a folder: name one that holds index-*.fits")
    folders = sorted({path.parent for path in source.rglob("index-*.fits")})
    offered = list_index_files(folders)
    by_scale: dict[int, IndexFile] = {}
    for file in offered:
        if file.is_healthy and file.scale is not None:
            rival = by_scale.get(file.scale)
            if rival is None or (file.is_whole_sky and not rival.is_whole_sky):
                by_scale[file.scale] = file
    if absent := [n for n in scales if n not in by_scale]:
        broken = "; ".join(f"{f.path.name} {f.fault}" for f in offered if not f.is_healthy)
        raise SolverError(
            f"{source} holds no complete index file number {', '.join(map(str, absent))}"
            + (f" ({broken})" if broken else "")
            + ": get Debian's astrometry-data-tycho2-{07,08,09,10-19}-littleendian"
        )
    for scale in scales:
        file = by_scale[scale]
        _place(file.path, target / file.path.name, report)


def _place(source: Path, home: Path, report: Progress) -> None:
    """Copy, check and rename; nothing appears under the final name before it is whole."""
    total = source.stat().st_size
    handle, name = tempfile.mkstemp(prefix=".install-", dir=home.parent)
    try:
        with said_as(SolverError, f"{home} cannot be written: "):
            with os.fdopen(handle, "wb") as out, source.open("rb") as stream:
                done = 0
                while chunk := stream.read(_COPY_CHUNK):
                    out.write(chunk)
                    done += len(chunk)
                    report(home.name, done, total)
                out.flush()
                os.fsync(out.fileno())
            Path(name).chmod(0o644)
            Path(name).replace(home)
    finally:
        Path(name).unlink(missing_ok=True)


def _download(scales: list[int], target: Path, report: Progress) -> None:
    import astrometry

    cache = target / ".download"
    for scale in scales:
        total = astrometry.series_4100.size({scale})
        fetched = _fetch(scale, cache, total, report)
        found = examine(fetched)
        if not found.is_healthy or fetched.stat().st_size != total:
            fetched.unlink(missing_ok=True)
            raise SolverError(
                f"the download of {fetched.name} is broken ({found.fault or 'wrong size'}): "
                "run 'rsoconsole index install' again"
            )
        fetched.replace(target / fetched.name)
    shutil.rmtree(cache, ignore_errors=True)


def _fetch(scale: int, cache: Path, total: int, report: Progress) -> Path:
    """One file of the series into the cache; a broken download is taken up where it ended."""
    import astrometry
    import requests

    name = f"index-41{scale:02d}.fits"
    partial = cache / astrometry.series_4100.name / f"{name}{astrometry.DOWNLOAD_SUFFIX}"
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(_POLL_S):
            if partial.exists():
                report(name, partial.stat().st_size, total)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        (path,) = astrometry.series_4100.index_files(cache_directory=cache, scales={scale})
    except (requests.RequestException, OSError) as error:
        raise SolverError(
            f"{name} cannot be downloaded ({type(error).__name__}): check the network, or fetch "
            "Debian's astrometry-data-tycho2-*-littleendian packages, unpack them and use "
            "'rsoconsole index install --from DIR'"
        ) from error
    finally:
        ended.set()
        watcher.join()
    report(name, total, total)
    return Path(path)
