"""Index files of the plate solver: listing them, choosing them for a field, installing them.

In the 4100 series (Tycho-2), number n has star quads of ``QUAD_ARCMIN[n]`` to ``QUAD_ARCMIN[n +
1]`` arcmin. The files come from Debian (``astrometry-data-tycho2-*``), from data.astrometry.net
through the ``astrometry`` package, and, for |dec| <= 12 deg, with rsoconsole.
"""

import functools
import math
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.base import SolverError, resource_path, system_errors_as
from rsoconsole.config import data_dir
from rsoconsole.instruments.solver._index_fits import dec_limits_deg, read_header

QUAD_ARCMIN = (
    *(2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0, 30.0, 42.0, 60.0, 85.0, 120.0, 170.0),
    *(240.0, 340.0, 480.0, 680.0, 1000.0, 1400.0, 2000.0),
)
SERIES_SCALES = range(7, 20)
"""Numbers n that the 4100 series has: for smaller quads Tycho-2 has too few stars."""
_LITTLE_ENDIAN = "04:03:02:01"
SYSTEM_DIR = Path("/usr/share/astrometry")


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexFile:
    """One index file found on disk, usable or not."""

    path: Path
    scale: int | None = None
    """Number n in the 4100 series; None for a file of another series."""
    quad_deg: tuple[float, float] = (0.0, 0.0)
    dec_deg: tuple[float, float] = (0.0, 0.0)
    size_bytes: int = 0
    fault: str = ""
    """What is wrong with the file; empty for a usable file."""

    @property
    def is_healthy(self) -> bool:
        """True where the file has no fault: the solver may be given it."""
        return not self.fault

    @property
    def dec_span_deg(self) -> float:
        """Greatest minus least declination of its stars, deg."""
        return self.dec_deg[1] - self.dec_deg[0]

    @property
    def is_whole_sky(self) -> bool:
        """True when its stars reach from pole to pole."""
        return self.dec_span_deg > 150.0

    def covers(self, dec_icrs_deg: float, radius_deg: float = 0.0) -> bool:
        """Return True where part of a field may hold stars of this file, by declination alone.

        The field reaches ``radius_deg`` from this declination.
        """
        margin = 0.2  # the limits are those of a sample of the stars
        return (
            self.dec_deg[0] - margin <= dec_icrs_deg + radius_deg
            and dec_icrs_deg - radius_deg <= self.dec_deg[1] + margin
        )


def user_index_dir() -> Path:
    """Return the folder into which ``rsoconsole index install`` puts files."""
    return data_dir() / "index"


def shipped_index_dir() -> Path:
    """Return the folder of the index files shipped with the program, for |dec| <= 12 deg."""
    return resource_path("instruments", "data", "index")


def folders_to_search(configured: Sequence[Path] = ()) -> tuple[Path, ...]:
    """Return the folders to search: configured folders, the user's, the system's, the shipped.

    Of equal index files, the first one found in this order is used.
    """
    return (
        *(d.expanduser() for d in configured),
        user_index_dir(),
        SYSTEM_DIR,
        shipped_index_dir(),
    )


def list_index_files(dirs: Iterable[Path]) -> tuple[IndexFile, ...]:
    """List the index files in these folders in order, also unusable ones."""
    found: list[IndexFile] = []
    for folder in dirs:
        if folder.is_dir():
            found += [inspect_index_file(path) for path in sorted(folder.glob("index-*.fits"))]
    return tuple(found)


def needed_tycho_numbers(field_deg: tuple[float, float]) -> tuple[int, ...]:
    """Return the numbers n of the 4100 series that suit a field of (width, height) deg.

    They are the numbers whose quads measure from about a third of the field's shorter side to the
    whole of it. Raises SolverError for a field too small for Tycho-2.
    """
    short_arcmin = 60.0 * min(field_deg)
    scales = tuple(n for n in SERIES_SCALES if 0.35 * short_arcmin <= QUAD_ARCMIN[n] < short_arcmin)
    if scales:
        return scales
    if short_arcmin > QUAD_ARCMIN[-1]:
        return (SERIES_SCALES[-1],)
    if short_arcmin >= 15.0:
        return (SERIES_SCALES[0],)
    finer = ", ".join(series_name(n) for n in fitting_index_numbers(short_arcmin))
    raise SolverError(
        f"a field of {short_arcmin:.1f} arcmin holds too few Tycho-2 stars: "
        + (
            f"get index files {finer} of the 5200 series from data.astrometry.net and name their "
            "folder in solver.index_dirs"
            if finer
            else "no index files are that fine; take a shorter focal length or a larger sensor"
        )
    )


def fitting_index_numbers(short_arcmin: float) -> tuple[int, ...]:
    """Return the numbers n, of any series, that suit a field's shorter side.

    They are the numbers whose quads measure from about a third of the side to the whole of it.
    """
    every = range(len(QUAD_ARCMIN) - 1)
    return tuple(n for n in every if 0.35 * short_arcmin <= QUAD_ARCMIN[n] < short_arcmin)


def series_name(number: int) -> str:
    """Return the name of the index files of scale ``number``: 5204 for 4, 4107 for 7.

    The prefix is 41 (Tycho-2) for large quads, 52 (Gaia) for small ones, where Tycho-2 has too few
    stars. The files are those of data.astrometry.net.
    """
    return f"{41 if number in SERIES_SCALES else 52}{number:02d}"


def missing_index_numbers(
    files: Sequence[IndexFile],
    *,
    short_arcmin: float,
    dec_icrs_deg: float | None,
    radius_deg: float,
) -> tuple[int, ...]:
    """Return the numbers n that a field needs and that no file in ``files`` has, finest first.

    ``short_arcmin``: the field's shorter side. ``dec_icrs_deg``, ``radius_deg``: where the field
    may be; None: anywhere.
    """
    present = {
        file.scale
        for file in files
        if file.is_healthy and (dec_icrs_deg is None or file.covers(dec_icrs_deg, radius_deg))
    }
    return tuple(n for n in fitting_index_numbers(short_arcmin) if n not in present)


def missing_index_advice(numbers: Sequence[int]) -> str:
    """Return a sentence on how to get missing index files; empty where none is missing."""
    parts = []
    if finer := [series_name(n) for n in numbers if n not in SERIES_SCALES]:
        parts.append(
            f"{', '.join(finer)} (from data.astrometry.net; name their folder in solver.index_dirs)"
        )
    if tycho := [n for n in numbers if n in SERIES_SCALES]:
        named = " ".join(f"--scale {n}" for n in tycho)
        parts.append(
            f"{', '.join(map(series_name, tycho))} ('rsoconsole index install {named}' gets them)"
        )
    return " and ".join(parts)


def choose_index_files(
    files: Sequence[IndexFile],
    *,
    quad_deg: tuple[float, float],
    dec_icrs_deg: float | None,
    radius_deg: float,
) -> tuple[IndexFile, ...]:
    """Return the usable files that fit the field in quad size and declination, finest first.

    ``quad_deg``: least and greatest useful size of quads. ``dec_icrs_deg``, ``radius_deg``: where
    the field may be; None: anywhere. Of files with the same number, the file with the widest range
    of declination is chosen, of equals the first.
    """
    chosen: dict[object, IndexFile] = {}
    for file in files:
        fits_field = file.quad_deg[0] <= quad_deg[1] and quad_deg[0] <= file.quad_deg[1]
        on_sky = dec_icrs_deg is None or file.covers(dec_icrs_deg, radius_deg)
        if not (file.is_healthy and fits_field and on_sky):
            continue
        key: object = file.scale if file.scale is not None else file.path.name
        rival = chosen.get(key)
        if rival is None or file.dec_span_deg > rival.dec_span_deg + 0.5:
            chosen[key] = file
    return tuple(sorted(chosen.values(), key=lambda f: (f.quad_deg, f.path.name)))


def inspect_index_file(path: Path) -> IndexFile:
    """Return a description of one file, usable or not."""
    try:
        state = path.stat()
    except OSError as error:
        return IndexFile(path=path, fault=f"cannot be read: {error.strerror}")
    return _examine_once(path, state.st_size, state.st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _examine_once(path: Path, size: int, _mtime_ns: int) -> IndexFile:
    faulty = functools.partial(IndexFile, path=path, size_bytes=size)
    try:
        header = read_header(path)
        if size < header.expected_size:
            return faulty(fault=f"truncated: {size} of {header.expected_size} bytes")
        if header.cards.get("ENDIAN") != _LITTLE_ENDIAN:
            return faulty(fault="written for another byte order: get the littleendian one")
        dec_low, dec_high = dec_limits_deg(path, header)
        if dec_high - dec_low > 150.0:
            dec_low, dec_high = -90.0, 90.0  # few stars lie near the poles
        quad = tuple(math.degrees(float(header.cards[k])) for k in ("SCALE_L", "SCALE_U"))
        return IndexFile(
            path=path,
            scale=_scale_number(quad[0]),
            quad_deg=(quad[0], quad[1]),
            dec_deg=(dec_low, dec_high),
            size_bytes=size,
        )
    except (SolverError, ValueError, KeyError) as error:
        return faulty(fault=str(error))


def _scale_number(quad_low_deg: float) -> int | None:
    for number, arcmin in enumerate(QUAD_ARCMIN):
        if abs(60.0 * quad_low_deg / arcmin - 1.0) < 0.02:
            return number
    return None


Progress = Callable[[str, int, int], None]
"""Callback for progress: (name of the file, bytes done, bytes in all)."""

_COPY_CHUNK = 4 << 20
_POLL_S = 0.5


def install_index_files(
    scales: Sequence[int],
    *,
    from_dir: Path | None = None,
    into: Path | None = None,
    progress: Progress = lambda _name, _done, _total: None,
) -> tuple[IndexFile, ...]:
    """Install the index files of these numbers n; return those that are now in ``into``.

    ``from_dir``: folder to copy from, searched recursively (a Debian package unpacked with ``dpkg
    -x`` will do); None: download. ``into`` None: the user's folder. Complete files that are there
    already are not replaced. Raises SolverError when any file could not be installed.
    """
    target = into or user_index_dir()
    with system_errors_as(SolverError, f"{target} cannot be made: "):
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
    """Copy, check and rename a file; nothing appears under the final name before it is whole."""
    total = source.stat().st_size
    handle, name = tempfile.mkstemp(prefix=".install-", dir=home.parent)
    try:
        with system_errors_as(SolverError, f"{home} cannot be written: "):
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
        found = inspect_index_file(fetched)
        if not found.is_healthy or fetched.stat().st_size != total:
            fetched.unlink(missing_ok=True)
            raise SolverError(
                f"the download of {fetched.name} is broken ({found.fault or 'wrong size'}): "
                "run 'rsoconsole index install' again"
            )
        fetched.replace(target / fetched.name)
    shutil.rmtree(cache, ignore_errors=True)


def _fetch(scale: int, cache: Path, total: int, report: Progress) -> Path:
    """Download one file of the series into the cache.

    A download that was cut off is continued where it ended.
    """
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
