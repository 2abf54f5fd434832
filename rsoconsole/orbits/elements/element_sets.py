"""The one reader of element sets: from bytes as they came to objects for SGP4. Pure.

Whatever the form (two lines, or OMM as JSON, XML, CSV or KVN), the encoding and the packing, a set
that cannot be used is named with its reason, and the others are used.
"""

import gzip
import html
import io
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rsoconsole.base import (
    MAX_DATA_BYTES,
    TOO_DEEP,
    OrbitError,
    parse_json,
    plain_lines,
    text_in_any_encoding,
)
from rsoconsole.orbits.elements import omm_forms
from rsoconsole.orbits.elements.catalogue import CatalogueEntry, entry_of_lines, failure_words
from rsoconsole.orbits.elements.elements import ElementSet, UnusedSet, two_line_sets
from rsoconsole.orbits.elements.omm_reader import entry_of_message

MAX_SETS = 200_000
"""Largest number of element sets in one text: three times all ever catalogued."""
_NAMED, _LONGEST_REMARK = 3, 200


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementSets:
    """The element sets of a text, a file or several, and what of them cannot be used."""

    entries: tuple[CatalogueEntry, ...]
    not_used: tuple[UnusedSet, ...] = ()

    @property
    def not_used_words(self) -> str:
        """How many sets are not used, the first of them, and why; empty where all are."""
        return not_used_words(len(self.entries), [each.words for each in self.not_used])


def not_used_words(used: int, not_used: Sequence[str]) -> str:
    """Return how many of how many sets are not used, the first of them, and why; mostly empty.

    ``not_used``: words on each.
    """
    if not not_used:
        return ""
    count, verb = len(not_used), "is" if len(not_used) == 1 else "are"
    return f"{count:,} of {used + count:,} element sets {verb} not used: {first_few(not_used)}"


def first_few(words: Sequence[str]) -> str:
    """Return the first of many sentences in one, and how many more there are."""
    more = len(words) - _NAMED
    return "; ".join(words[:_NAMED]) + (f"; and {more:,} more" if more > 0 else "")


def parse_element_sets(content: bytes | str, source: str = "catalogue") -> ElementSets:
    """Parse all element sets of a text, or of a file's bytes.

    Raises OrbitError, naming ``source``, for one that is no text or has too many sets, and where
    no set can be used: with the reasons, or with what it says in their place.
    """
    try:
        text = element_text(content) if isinstance(content, bytes) else plain_lines(content)
        entries: list[CatalogueEntry] = []
        not_used: list[UnusedSet] = []
        for each in _sets(text):
            if isinstance(each, UnusedSet):
                not_used.append(replace(each, source=source))
            elif each.record.error:
                not_used.append(_refused(each, source))
            else:
                entries.append(each)
    except OrbitError as error:
        raise OrbitError(f"{source}: {error}") from error
    if entries:
        return ElementSets(entries=tuple(entries), not_used=tuple(not_used))
    if not_used:
        words = first_few([each.words for each in not_used])
        raise OrbitError(f"no element set can be used: {words}")
    remark = remark_of(text)
    raise OrbitError(
        f"{source} holds no element set, but: {remark}"
        if remark
        else f"{source} holds no element set: two lines (TLE) or OMM are needed"
    )


def _refused(entry: CatalogueEntry, source: str) -> UnusedSet:
    return UnusedSet(
        source=source,
        norad_id=entry.norad_id,
        name=entry.name,
        reason=failure_words(entry.record.error),
    )


_JSON_KEY = re.compile(
    r'"(?:NORAD_CAT_ID|MEAN_MOTION|EPOCH|(?:TLE_LINE|TLE|LINE)1)"\s*:', re.IGNORECASE
)
_OTHER_MESSAGE = re.compile(r"CCSDS_(OPM|OEM|OCM|TDM|CDM|AEM|APM)_VERS|<(opm|oem|ocm|tdm|cdm)[\s>]")
_XML_KEY = re.compile(r"<(?:[\w.-]+:)?(?:omm|NORAD_CAT_ID|MEAN_MOTION|EPOCH)\b[^>]*>")
_KVN_KEY = re.compile(
    r"^[ \t]*(?:CCSDS_OMM_VERS|NORAD_CAT_ID|MEAN_MOTION|EPOCH)[ \t]*=", re.MULTILINE | re.IGNORECASE
)
_LINE_2 = re.compile(r"^[ \t]*2 ", re.MULTILINE)


def _sets(text: str) -> Iterator[CatalogueEntry | UnusedSet]:
    """Yield the sets of a text in whatever form. Raises OrbitError where they are too many."""
    lines = (line for line in text.lstrip().split("\n") if line.strip())
    head = next((line for line in lines if not omm_forms.is_before_table(line)), "")
    keys = re.split("[,;\t]", head)
    if (other := _OTHER_MESSAGE.search(text)) and "MEAN_MOTION" not in text:
        raise OrbitError(f"it is an {(other[1] or other[2]).upper()}, not an OMM")
    if _JSON_KEY.search(text):
        _expect_fewer(sum(map(text.count, ('"NORAD_CAT_ID"', '"norad_cat_id"'))))
        messages = omm_forms.json_messages(text.replace("\f", " "))
    elif _XML_KEY.search(text):
        _expect_fewer(text.count("NORAD_CAT_ID>") // 2)
        messages = omm_forms.xml_messages(text)
    elif omm_forms.has_keys_of_omm(keys, 2) or omm_forms.has_two_lines(keys):
        _expect_fewer(text.strip().count("\n"))
        messages = omm_forms.csv_messages(text)
    elif _KVN_KEY.search(text):
        _expect_fewer(sum(1 for _ in _KVN_KEY.finditer(text)) // 4)
        messages = omm_forms.kvn_messages(text)
    else:
        _expect_fewer(sum(1 for _ in _LINE_2.finditer(text)))
        yield from map(_of_two_lines, two_line_sets(text))
        return
    for place, fields in messages:
        yield entry_of_message(place, fields)


def _of_two_lines(found: ElementSet | UnusedSet) -> CatalogueEntry | UnusedSet:
    return found if isinstance(found, UnusedSet) else entry_of_lines(found)


def _expect_fewer(sets: int) -> None:
    if sets > MAX_SETS:
        raise OrbitError(
            f"it holds {sets:,} element sets, {MAX_SETS:,} at most can be used: keep those of the"
            " last days, one for each object"
        )


# ---- from bytes to text --------------------------------------------------------------------

_GZIP, _ZIP = b"\x1f\x8b", b"PK\x03\x04"


def element_text(content: bytes) -> str:
    """Return the text of elements, in any encoding, from gzip or a zip of one file too.

    Line ends are newlines. Raises OrbitError for what cannot be unpacked, and for what unpacks to
    more than ``MAX_DATA_BYTES``.
    """
    if content.startswith(_GZIP):
        content = _gunzipped(content)
    elif content.startswith(_ZIP):
        content = _of_archive(content)
    if len(content) > MAX_DATA_BYTES:
        raise OrbitError(f"unpacked it is larger than {MAX_DATA_BYTES >> 20} MB")
    return text_in_any_encoding(content)


def gunzipped(content: bytes, max_bytes: int) -> bytes:
    """Return the unpacked content of a gzip file, cut off after ``max_bytes`` + 1 bytes.

    Raises EOFError where the file ends too early, OSError or zlib.error where it is not gzip.
    """
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
        return stream.read(max_bytes + 1)


def _gunzipped(content: bytes) -> bytes:
    try:
        return gunzipped(content, MAX_DATA_BYTES)
    except (OSError, zlib.error) as error:
        raise OrbitError(f"its gzip is broken ({error})") from error
    except EOFError as error:
        raise OrbitError("its gzip ends before it is whole") from error


def _of_archive(content: bytes) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            files = [each for each in archive.infolist() if not _is_by_the_way(each)]
            if len(files) != 1:
                raise OrbitError(f"its archive holds {len(files)} files, one is needed")
            with archive.open(files[0]) as stream:
                return stream.read(MAX_DATA_BYTES + 1)
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        RuntimeError,
        NotImplementedError,
    ) as error:
        raise OrbitError(f"its archive is broken ({error})") from error


def _is_by_the_way(file: zipfile.ZipInfo) -> bool:
    """True for a folder, and for what macOS puts into an archive beside its files."""
    return file.is_dir() or bool(re.search(r"(?:^|/)(?:__MACOSX/|\._|\.DS_Store$)", file.filename))


_PAGE_WORDS = re.compile(r"<(title|h1|h2|p|pre|body)\b[^>]*>(.*?)</\1", re.DOTALL | re.IGNORECASE)


def remark_of(text: str) -> str:
    """Return in one line what a text says that stands in the place of elements.

    That are the texts of JSON, a page's title or first words, the first words of plain text, up to
    200 characters that can be printed; empty for an empty list.
    """
    start = text.strip()
    if not start or "\x00" in start:
        return "it is no text" if start else "it is empty"
    if start.startswith("<") or "<html" in start[:400].lower():
        page = start[:100_000]
        words = next((each[2] for each in _PAGE_WORDS.finditer(page)), "")
        if not words and "<html" not in page.lower():  # an error in XML
            words = page
        plain = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", words)).split())
        return _printable(plain or "a web page")
    if start.startswith(("[", "{", '"')):
        try:
            return _printable(omm_forms.text_of_values(parse_json(start)))
        except (ValueError, RecursionError) as error:
            why = TOO_DEEP if isinstance(error, RecursionError) else error
            return _printable(f"no OMM in JSON: {why}: {start}")
    return _printable(start)


def _printable(text: str) -> str:
    words = " ".join("".join(c if c.isprintable() else " " for c in text[:4000]).split())
    return words if len(words) <= _LONGEST_REMARK else f"{words[: _LONGEST_REMARK - 1]}…"
