"""Choice and reading of the element files with which a session is identified."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from rsoconsole.base import OrbitError, SessionError, read_named_bytes
from rsoconsole.orbits import CatalogueEntry, ElementSets, parse_element_sets
from rsoconsole.pipeline.sources.store import ElementStore, is_store
from rsoconsole.session import SessionReader
from rsoconsole.words import NAME_ELEMENTS, NS_PER_DAY

NO_ELEMENTS = (
    "no catalogue: name element sets with {}, or in catalogue.tle_files of the configuration"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementFiles:
    """Element files for a session, and whether the session was recorded with them."""

    files: tuple[Path, ...]
    is_recorded: bool
    """True for the files recorded in the session, False for those of the configuration."""


def choose_element_files(path: Path, configured: Sequence[Path], option: str) -> ElementFiles:
    """Return the element files with which to identify a session.

    They are those of the configuration, else those recorded in the session; for a simulated night
    the recorded ones come first. Raises OrbitError where there are none; the message names
    ``option``, the caller's option for element files, and the setting.
    """
    own, is_simulated = _of_session(path)
    there = tuple(file for file in own if file.exists())
    if there and (is_simulated or not configured):
        return ElementFiles(files=there, is_recorded=True)
    if configured:
        return ElementFiles(files=tuple(configured), is_recorded=False)
    gone = f"; the session had {', '.join(map(str, own))}, which is no more there" if own else ""
    raise OrbitError(NO_ELEMENTS.format(option) + gone)


def _of_session(path: Path) -> tuple[tuple[Path, ...], bool]:
    """Return the element files that a session began with, and whether it was simulated."""
    if not path.is_dir():
        return (), False  # a file of observations
    try:
        reader = SessionReader(path)
        is_simulated = reader.read_meta().get("is_simulated") is True
        return reader.config().catalogue.tle_files, is_simulated
    except SessionError:
        return (), False  # reading its directions says what is wrong with it


YIELDS_AFTER_NS = 3 * NS_PER_DAY
"""Time, ns, by which a later source's elements of an object must be newer to be preferred."""


def read_catalogue(files: Sequence[Path]) -> ElementSets:
    """Read the element sets of all files; ``files`` may hold folders of the element cache.

    Of a folder, each object's sets are those of one source (``sets_by_precedence``).
    Raises OrbitError naming a file that cannot be read, and one without any set to use.
    """
    read = [_of_folder(path) if path.is_dir() else _of_file(path) for path in files]
    return ElementSets(
        entries=tuple(chain.from_iterable(each.entries for each in read)),
        not_used=tuple(chain.from_iterable(each.not_used for each in read)),
    )


def sets_by_precedence(sources: Iterable[Iterable[CatalogueEntry]]) -> tuple[CatalogueEntry, ...]:
    """Return the element sets of each object from one source only.

    ``sources``: in order of precedence. The first source that has the object is used, unless a
    later one has sets newer by more than ``YIELDS_AFTER_NS``.
    """
    chosen: dict[int, list[CatalogueEntry]] = {}
    for entries in sources:
        of_object: dict[int, list[CatalogueEntry]] = {}
        for each in entries:
            of_object.setdefault(each.norad_id, []).append(each)
        for number, sets in of_object.items():
            rival = chosen.get(number)
            if rival is None or _newest(sets) > _newest(rival) + YIELDS_AFTER_NS:
                chosen[number] = sets
    return tuple(each for sets in chosen.values() for each in sets)


def _newest(sets: Iterable[CatalogueEntry]) -> int:
    return max(each.epoch_utc_ns for each in sets)


def _of_folder(folder: Path) -> ElementSets:
    if not is_store(folder):
        raise OrbitError(
            f"{folder} is a folder, and none that 'rsoconsole catalogue' keeps: name files of"
            " element sets"
        )
    files = ElementStore(folder).files()
    if not files:
        raise OrbitError(f"{folder} holds no elements yet: 'rsoconsole catalogue update' gets them")
    read = [_of_file(path) for path in files]
    return ElementSets(
        entries=sets_by_precedence(each.entries for each in read),
        not_used=tuple(chain.from_iterable(each.not_used for each in read)),
    )


def _of_file(path: Path) -> ElementSets:
    content = read_named_bytes(path, OrbitError, NAME_ELEMENTS)
    return parse_element_sets(content, str(path))
