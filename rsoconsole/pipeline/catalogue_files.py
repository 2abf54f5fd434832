"""The element files of the configuration, whichever of the formats each is in."""

from collections.abc import Sequence
from pathlib import Path

from rsoconsole.errors import OrbitError
from rsoconsole.foreign_text import MOST_DATA_BYTES, read_foreign
from rsoconsole.orbit.catalogue import CatalogueEntry, parse_catalogue


def read_catalogue(files: Sequence[Path]) -> tuple[CatalogueEntry, ...]:
    """Every element set of the files. Raises OrbitError naming a file that cannot be read."""
    found: list[CatalogueEntry] = []
    for path in files:
        try:
            text = read_foreign(path, most_bytes=MOST_DATA_BYTES)
        except FileNotFoundError as error:
            raise OrbitError(f"{path} does not exist: name a file of element sets") from error
        except (OSError, UnicodeDecodeError) as error:
            raise OrbitError(f"{path} cannot be read: {error}") from error
        found.extend(parse_catalogue(text, str(path)))
    return tuple(found)
