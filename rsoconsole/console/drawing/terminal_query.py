"""Query of the terminal's abilities: one round trip, before the console draws.

The last question is one that every terminal answers. Once that answer has come, no other answer can
arrive later and be taken for a key.
"""

import contextlib
import os
import re
import select
import sys
import termios
import time
import tty
from collections.abc import Mapping
from dataclasses import dataclass

from rsoconsole.console.drawing import blocks
from rsoconsole.console.drawing.blocks import BlockSet

PATIENCE_S = 1.5
"""Most seconds for a round trip over a slow line; a terminal that never answers costs as much."""
_HAS_KITTY = "\x1b_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1b\\"
_NAME = "\x1b[>0q"
_ATTRIBUTES = "\x1b[c"
_NAME_ANSWER = re.compile(r"\x1bP>\|([^\x1b]*)\x1b\\")
_ATTRIBUTES_ANSWER = re.compile(r"\x1b\[\?([\d;]*)c")
_NAME_AND_VERSION = re.compile(r"([A-Za-z][A-Za-z-]*)[ (/v]*([\d.]*)")
_SILENT = ("linux", "dumb", "unknown", "")
"""Types of terminals (TERM) that draw no graphics and are not asked, as the Linux console."""

_SEXTANTS_FROM: Mapping[str, tuple[int, ...]] = {
    "kitty": (0,),
    "foot": (1, 8),
    "wezterm": (0,),
    "ghostty": (0,),
    "vte": (6600,),
    "contour": (0,),
}
"""First version of each terminal that draws sextants itself, whatever its font has."""
_OCTANTS_FROM: Mapping[str, tuple[int, ...]] = {
    "kitty": (0, 40),
    "foot": (1, 20),
    "ghostty": (1, 2),
    "vte": (8200,),
}
_BY_TYPE = {
    "xterm-kitty": "kitty",
    "foot": "foot",
    "foot-extra": "foot",
    "xterm-ghostty": "ghostty",
    "wezterm": "wezterm",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class TerminalAnswer:
    """What a terminal reports about itself; the defaults mean that it did not answer."""

    name: str = ""
    """The terminal's program in small letters; empty where the terminal does not say."""
    version: tuple[int, ...] = ()
    has_kitty: bool = False
    has_sixel: bool = False


def query_terminal(environment: Mapping[str, str] = os.environ) -> TerminalAnswer:
    """Ask the terminal what it can draw; without an answer return the defaults."""
    kind = environment.get("TERM", "")
    if kind in _SILENT or sys.__stdin__ is None or sys.__stderr__ is None:
        return TerminalAnswer()
    try:
        answer = _answer(sys.__stdin__.fileno(), sys.__stderr__.fileno())
    except (OSError, ValueError, termios.error):
        return TerminalAnswer()
    return parse_answer(answer, kind)


def parse_answer(answer: str, kind: str) -> TerminalAnswer:
    """Return what a terminal's answer says; ``kind``: the terminal's type (TERM)."""
    named = _NAME_ANSWER.search(answer)
    parts = _NAME_AND_VERSION.match(named.group(1)) if named is not None else None
    name = parts.group(1).lower() if parts is not None else _BY_TYPE.get(kind, "")
    version = tuple(int(n) for n in parts.group(2).split(".") if n) if parts is not None else ()
    attributes = _ATTRIBUTES_ANSWER.search(answer)
    numbers = attributes.group(1).split(";") if attributes is not None else []
    return TerminalAnswer(
        name=name,
        version=version,
        has_kitty="\x1b_Gi=31;OK" in answer,
        has_sixel="4" in numbers[1:],
    )


def finest_blocks(
    terminal: TerminalAnswer, environment: Mapping[str, str] = os.environ
) -> BlockSet:
    """Return the finest block characters that this terminal surely draws."""
    if environment.get("TERM", "") in _SILENT:
        return blocks.HALF_BLOCKS
    for known, found in ((_OCTANTS_FROM, blocks.OCTANTS), (_SEXTANTS_FROM, blocks.SEXTANTS)):
        first = known.get(terminal.name)
        if first is not None and (terminal.version >= first or not any(first)):
            return found
    return blocks.QUADRANTS


def _answer(stdin: int, out: int) -> str:
    """Return everything received up to the answer to the last question."""
    before = termios.tcgetattr(stdin)
    try:
        tty.setcbreak(stdin, termios.TCSANOW)
        os.write(out, (_HAS_KITTY + _NAME + _ATTRIBUTES).encode())
        return _read_until_attributes(stdin)
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(stdin, termios.TCSANOW, before)


def _read_until_attributes(stdin: int) -> str:
    ends_s, answer = time.monotonic() + PATIENCE_S, ""
    while _ATTRIBUTES_ANSWER.search(answer) is None:
        left_s = ends_s - time.monotonic()
        if left_s <= 0.0 or not select.select([stdin], [], [], left_s)[0]:
            break
        piece = os.read(stdin, 4096)
        if not piece:
            break
        answer += piece.decode(errors="replace")
    return answer
