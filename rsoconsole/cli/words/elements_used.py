"""Which elements names are sought in, where an option names them and where none does."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.cli.words import output
from rsoconsole.errors import OrbitError

if TYPE_CHECKING:
    from rsoconsole.orbits.elements import CatalogueEntry


_OPTION = "--tle FILE"


def catalogue_of(files: Sequence[Path]) -> "Sequence[CatalogueEntry]":
    """What is in these files. Raises OrbitError with the remedy where none is named."""
    from rsoconsole.pipeline.orbits import NO_ELEMENTS, read_catalogue

    if not files:
        raise OrbitError(NO_ELEMENTS.format(_OPTION))
    return read_catalogue(files)


def element_files(path: Path, configured: Sequence[Path]) -> list[Path]:
    """The configuration's; of a simulated night, or without any, those that the session began with.

    Raises OrbitError with the remedy where there are none.
    """
    from rsoconsole.pipeline.orbits import elements_used

    used = elements_used(path, configured, _OPTION)
    if used.is_recorded:
        named = ", ".join(map(str, used.files))
        output.complain(f"rsoconsole: by the elements that the session was recorded with: {named}")
    return list(used.files)
