"""Names of sources of elements: ``celestrak:geo``, ``url:https://...``, ``file:/...``."""

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
_WEB = ("http", "https")
_MAY_HOLD_SECRETS = re.compile(r"//|[@?]")
_WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}(=[A-Za-z0-9_. +-]{1,63})?")
_QUERY = re.compile(r"[A-Za-z0-9_./<>%,+:~-]{1,300}")


def split_source(text: str) -> tuple[SourceKind, str]:
    """Return a source's kind and the rest of its name; raises ValueError for anything else."""
    kind, colon, what = text.strip().partition(":")
    what = what.strip()
    for each in KINDS:
        if colon and kind == each and what:
            _expect_sound(each, what)
            return each, what
    raise ValueError(f"{without_secrets(text)!r} is no source of elements: {USAGE}")


def without_secrets(text: str) -> str:
    """Return a source's name or URL without user, password and query, which may be secret."""
    kind, _, what = text.strip().partition(":")
    url = what.strip() if kind == "url" else text.strip()
    is_path = kind == "file" and what.startswith("/") and not what.startswith("//")
    if is_path or (kind != "url" and not _MAY_HOLD_SECRETS.search(url)):
        return text
    before = "url:" if kind == "url" else ""
    scheme = url.partition(":")[0].lower()
    known = f"{scheme}://..." if scheme in _WEB else f"{scheme}:..." if scheme in KINDS else "..."
    if scheme not in _WEB or not is_web_address(url):
        return before + known
    parts = urlsplit(url)
    if "@" in parts.path:
        return before + known  # where a password holds a '/', the host is not where it seems
    port = f":{parts.port}" if parts.port else ""
    query = "?..." if parts.query else ""
    host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
    return f"{before}{scheme}://{host}{port}{parts.path}{query}"


def _expect_sound(kind: SourceKind, what: str) -> None:
    label = without_secrets(f"{kind}:{what}")
    if kind == "url":
        expect_web_address(what)
    elif kind in {"celestrak", "supgp"} and not _WORD.fullmatch(what):
        raise ValueError(
            f"{label!r} is no group: write a name such as {kind}:geo, or {kind}:CATNR=25544"
        )
    elif kind == "space-track" and not _QUERY.fullmatch(what):
        raise ValueError(
            f"{label!r} is no query: write space-track:all, space-track:geo, or what follows"
            " .../query/ in an address of Space-Track"
        )
    elif kind == "file" and not expand_home(what).is_absolute():
        raise ValueError(f"{label} is not from the root: write file:/... with the whole path")


def expand_home(path: str | Path) -> Path:
    """Return the path with '~' expanded; raises ValueError for an unknown user's home."""
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise ValueError(f"{path}: there is no such user: write the whole path") from error


def is_web_address(text: str) -> bool:
    """Return whether ``text`` is an address of a web server."""
    if any(ord(c) <= 0x20 or ord(c) == 0x7F for c in text):
        return False
    try:
        parts = urlsplit(text)
        _ = parts.port
    except ValueError:
        return False
    return parts.scheme in _WEB and bool(parts.hostname)


def expect_web_address(text: str) -> None:
    """Raise ValueError where ``text`` is no address of a web server."""
    if not is_web_address(text):
        raise ValueError(
            f"{without_secrets(text)!r} is no address: write http://... or https://..."
        )
