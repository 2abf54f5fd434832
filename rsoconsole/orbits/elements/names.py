"""One object of a catalogue by its number or its name, as people write them. Pure."""

import difflib
import re
from collections.abc import Iterable, Sequence

from rsoconsole.errors import OrbitError
from rsoconsole.orbits.elements.catalogue import CatalogueEntry
from rsoconsole.words import called

LISTED = 8
"""How many candidates an error names."""


def find_object(entries: Sequence[CatalogueEntry], wanted: str) -> tuple[CatalogueEntry, ...]:
    """Every element set of the one object that is meant.

    A number is a catalogue number; a name may be a part of the catalogued one, upper case and
    punctuation aside, if it fits one object only. Raises OrbitError that lists the candidates of
    an ambiguous name, and the nearest names to an unknown one.
    """
    text = wanted.strip()
    if text.isdecimal():
        of_number = tuple(each for each in entries if each.norad_id == int(text))
        if of_number:
            return of_number
    plain = _plain(text)
    whole = [each for each in entries if plain and _plain(each.name) == plain]
    found = whole or [each for each in entries if plain and plain in _plain(each.name)]
    numbers = {each.norad_id for each in found}
    if len(numbers) == 1:
        return tuple(found)
    if numbers:
        raise OrbitError(
            f"{wanted!r} is {len(numbers)} objects: {_listed(found)}; name one by its number"
        )
    raise OrbitError(f"no object is called {wanted!r}{_near(entries, text)}")


def _plain(name: str) -> str:
    """Letters and digits alone, words apart: INTELSAT-14 and Intelsat 14 are one."""
    return re.sub(r"[^a-z0-9]+", " ", name.casefold()).strip()


def _listed(entries: Iterable[CatalogueEntry]) -> str:
    names = {each.norad_id: each.name for each in entries}
    words = [called(name, number) for number, name in sorted(names.items())]
    more = len(words) - LISTED
    return ", ".join(words[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _near(entries: Sequence[CatalogueEntry], text: str) -> str:
    if not entries:
        return ": there are no element sets; give some with --tle FILE"
    by_plain = {_plain(each.name): each for each in entries if each.name}
    near = difflib.get_close_matches(_plain(text), by_plain, n=3, cutoff=0.5)
    if not near:
        count = len({each.norad_id for each in entries})
        return f" among {count} objects: give another file with --tle FILE"
    return f"; near it: {_listed(by_plain[name] for name in near)}"
