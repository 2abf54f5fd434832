"""CCSDS Tracking Data Messages as XML (503.0-B-2, 505.0-B-3), from keyword = value and back.

Both forms say the same: the XML is made of the lines of ``tdm``, and read as such lines, so that
every rule of ``tdm_reader`` holds for both.
"""

from collections.abc import Iterator
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from rsoconsole.errors import ExportError

_NAMESPACES = (
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xsi:noNamespaceSchemaLocation="https://sanaregistry.org/files/ndmxml_unqualified/'
    'ndmxml-3.0.0-master-3.0.xsd"'
)
_DEG = {"ANGLE_1", "ANGLE_2"}


def xml_of(text: str) -> str:
    """The message of ``to_tdm`` as XML."""
    out: list[str] = ['<?xml version="1.0" encoding="UTF-8"?>']
    section = "header"
    header: list[str] = []
    for line in text.splitlines():
        keyword, _, value = (part.strip() for part in line.partition("="))
        if keyword == "CCSDS_TDM_VERS":
            out.append(f'<tdm {_NAMESPACES} id="CCSDS_TDM_VERS" version="{value}">')
        elif line == "META_START":
            if section == "header":
                out += ["<header>", *header, "</header>", "<body>"]
            out += ["<segment>", "<metadata>"]
            section = "metadata"
        elif line in _MARKS:
            out += _MARKS[line]
            section = "data" if line == "DATA_START" else section
        elif line.startswith("COMMENT"):
            comment = f"<COMMENT>{escape(line.removeprefix('COMMENT').strip())}</COMMENT>"
            (header if section == "header" else out).append(comment)
        elif section == "data":
            epoch, number = value.split()
            unit = ' units="deg"' if keyword in _DEG else ""
            datum = f"<{keyword}{unit}>{number}</{keyword}>"
            out.append(f"<observation><EPOCH>{epoch}</EPOCH>{datum}</observation>")
        else:
            element = f"<{keyword}>{escape(value)}</{keyword}>"
            (header if section == "header" else out).append(element)
    return "\n".join([*out, "</body>", "</tdm>", ""])


_MARKS = {
    "META_STOP": ["</metadata>"],
    "DATA_START": ["<data>"],
    "DATA_STOP": ["</data>", "</segment>"],
}


def lines_of_xml(text: str, name: str) -> list[str]:
    """The message in a text of XML as lines of keyword = value. Raises ExportError."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ExportError(f"{name}: a document type has no place in a Tracking Data Message")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise ExportError(f"{name} is no XML: {error}") from error
    found = root if _tag(root) == "tdm" else next((e for e in root if _tag(e) == "tdm"), None)
    if found is None:
        raise ExportError(f"{name} holds no Tracking Data Message: its root is <{_tag(root)}>")
    return list(_lines(found))


def _lines(tdm: ElementTree.Element) -> Iterator[str]:
    yield f"CCSDS_TDM_VERS = {tdm.get('version') or 'none'}"
    for part in tdm:
        if _tag(part) == "header":
            yield from map(_line, part)
        elif _tag(part) == "body":
            for segment in part:
                yield from _of_segment(segment)


def _of_segment(segment: ElementTree.Element) -> Iterator[str]:
    for part in segment:
        kind = "META" if _tag(part) == "metadata" else "DATA"
        yield f"{kind}_START"
        for each in part:
            if _tag(each) != "observation":
                yield _line(each)
                continue
            epoch = next((_text(e) for e in each if _tag(e) == "EPOCH"), "none")
            yield from (f"{_tag(e)} = {epoch} {_text(e)}" for e in each if _tag(e) != "EPOCH")
        yield f"{kind}_STOP"


def _line(element: ElementTree.Element) -> str:
    if _tag(element) == "COMMENT":
        return f"COMMENT {_text(element)}".strip()
    return f"{_tag(element)} = {_text(element)}"


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _text(element: ElementTree.Element) -> str:
    return " ".join((element.text or "").split())
