"""The element files of the configuration, whichever of the formats each is in.

A folder is what ``rsoconsole catalogue update`` keeps: its sources have an order of precedence.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from rsoconsole.element_sources import ElementStore, is_store
from rsoconsole.errors import OrbitError
from rsoconsole.foreign_text import MOST_DATA_BYTES, read_foreign
from rsoconsole.orbits.elements import CatalogueEntry, parse_catalogue
from rsoconsole.sky import NS_PER_DAY
from rsoconsole.words import NAME_ELEMENTS

YIELDS_AFTER_NS = 3 * NS_PER_DAY
"""A source has precedence for an object as long as no later one has elements so much newer."""


def read_catalogue(files: Sequence[Path]) -> tuple[CatalogueEntry, ...]:
    """Every element set of the files, of a folder those of the source with precedence.

    Raises OrbitError naming a file that cannot be read.
    """
    found: list[CatalogueEntry] = []
    for path in files:
        if path.is_dir():
            found.extend(_of_folder(path))
        else:
            found.extend(_of_file(path))
    return tuple(found)


def by_precedence(
    sources: Iterable[Iterable[CatalogueEntry]],
) -> tuple[CatalogueEntry, ...]:
    """Each object's sets of one source alone: the first that has it and is not outdated."""
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


def _of_folder(folder: Path) -> tuple[CatalogueEntry, ...]:
    if not is_store(folder):
        raise OrbitError(
            f"{folder} is a folder, and none that 'rsoconsole catalogue' keeps: name files of"
            " element sets"
        )
    files = ElementStore(folder).files()
    if not files:
        raise OrbitError(f"{folder} holds no elements yet: 'rsoconsole catalogue update' gets them")
    return by_precedence(_of_file(path) for path in files)


def _of_file(path: Path) -> tuple[CatalogueEntry, ...]:
    try:
        text = read_foreign(path, most_bytes=MOST_DATA_BYTES)
    except FileNotFoundError as error:
        raise OrbitError(f"{path} does not exist: {NAME_ELEMENTS}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise OrbitError(f"{path} cannot be read: {error}") from error
    return parse_catalogue(text, str(path))
