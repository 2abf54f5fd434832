"""How a source of elements is written: ``celestrak:geo``, ``url:https://...``, ``file:/...``."""

import re
from pathlib import Path
from typing import Literal, TypeAlias, get_args
from urllib.parse import urlsplit

SourceKind: TypeAlias = Literal["celestrak", "supgp", "space-track", "url", "file"]
KINDS = get_args(SourceKind)
USAGE = (
    "write celestrak:GROUP, supgp:FILE, space-track:QUERY, url:https://... or file:/...,"
    " such as celestrak:geo"
)
_WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}(=[A-Za-z0-9_. +-]{1,63})?")
_QUERY = re.compile(r"[A-Za-z0-9_./<>%,+:~-]{1,300}")


def split_source(text: str) -> tuple[SourceKind, str]:
    """Its kind and what is wanted of it. Raises ValueError with what to write instead."""
    kind, colon, what = text.strip().partition(":")
    what = what.strip()
    for each in KINDS:
        if colon and kind == each and what:
            _expect_sound(each, what)
            return each, what
    raise ValueError(f"{shown(text)!r} is no source of elements: {USAGE}")


def shown(text: str) -> str:
    """A source or a URL for people: without user, password and query, which may be secret."""
    kind, _, what = text.partition(":")
    url = what if kind == "url" else text
    if "//" not in url:
        return text
    try:
        parts = urlsplit(url)
        port = f":{parts.port}" if parts.port else ""
    except ValueError:
        return f"{url.partition(':')[0]}://..."
    query = "?..." if parts.query else ""
    bare = f"{parts.scheme}://{parts.hostname or ''}{port}{parts.path}{query}"
    return f"url:{bare}" if kind == "url" else bare


def _expect_sound(kind: SourceKind, what: str) -> None:
    if kind == "url":
        expect_url(what)
    elif kind in {"celestrak", "supgp"} and not _WORD.fullmatch(what):
        raise ValueError(
            f"{what!r} is no group: write a name such as {kind}:geo, or {kind}:CATNR=25544"
        )
    elif kind == "space-track" and not _QUERY.fullmatch(what):
        raise ValueError(
            f"{what!r} is no query: write space-track:all, space-track:geo, or what follows"
            " .../query/ in an address of Space-Track"
        )
    elif kind == "file" and not Path(what).expanduser().is_absolute():
        raise ValueError(f"file:{what} is not from the root: write file:/... with the whole path")


def expect_url(text: str) -> None:
    """Raises ValueError where that is no address of a web server."""
    try:
        parts = urlsplit(text)
        is_sound = parts.scheme in {"http", "https"} and bool(parts.hostname)
        _ = parts.port
    except ValueError:
        is_sound = False
    if not is_sound or any(ord(c) <= 0x20 or ord(c) == 0x7F for c in text):
        raise ValueError(f"{shown(text)!r} is no address: write http://... or https://...")
