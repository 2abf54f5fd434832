"""The manual page, made from the verbs' help texts: man(7) source.

``python -m rsoconsole.cli.manual_page`` writes the file that packages install.
"""

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer
from typer.main import get_command

from rsoconsole import __version__
from rsoconsole.base import resource_path
from rsoconsole.cli.app import app
from rsoconsole.cli.words.usage import OWN_LINE
from rsoconsole.config import APP

PAGE = Path(__file__).resolve().parent / "guide" / "rsoconsole.1"
WIDTH = 70
_KINDS = re.compile(r"<(?:list\[)?(\w+)(?:\]| range)?>")


def manual_page_source() -> str:
    """Source of this program's manual page."""
    program: Any = get_command(app)
    context = typer.Context(program, info_name=APP)
    commands = [
        line
        for command, inner in _commands(program, context)
        for line in _command_lines(command, inner)
    ]
    page = resource_path("cli", "guide", "rsoconsole.in.1").read_text(encoding="utf-8")
    return page.replace("@VERSION@", f"{APP} {__version__}").replace(
        "@COMMANDS@", "\n".join(commands)
    )


def _commands(command: Any, context: Any) -> Iterator[tuple[Any, Any]]:
    for name, each in getattr(command, "commands", {}).items():
        inner = type(context)(each, info_name=name, parent=context)
        if each.hidden:
            continue
        if not hasattr(each, "commands") or each.invoke_without_command:
            yield each, inner
        yield from _commands(each, inner)


def _command_lines(command: Any, context: Any) -> Iterator[str]:
    pieces = [piece for piece in command.collect_usage_pieces(context) if piece != "[OPTIONS]"]
    yield f".SS {_quoted(' '.join([context.command_path, *pieces]))}"
    yield from _text_lines(command.help or "")
    for record in (each.get_help_record(context) for each in command.params):
        if record is not None and not record[0].startswith("--help"):
            yield ".TP"
            yield f".B {_quoted(_KINDS.sub(_kind, record[0]))}"
            yield from _lines(record[1])


def _text_lines(text: str) -> Iterator[str]:
    """Paragraphs as folded (see usage.py): examples as they are typed."""
    for number, paragraph in enumerate(text.split("\n\n")):
        if number:
            yield ".PP"
        for place, line in enumerate(paragraph.splitlines()):
            words, example, command = line.partition("Example: ")
            if example:
                yield from _lines(words)
                yield from (".PP",) if place or words.strip() else ()
                yield from ("Example:", ".PP", ".EX", f"    {_line(command)}", ".EE")
            else:
                yield from (".br",) if place and OWN_LINE.match(line) else ()
                yield from _lines(line)


def _kind(found: re.Match[str]) -> str:
    """Type of an option's value, for people who write no Python."""
    return f"<{found[1].lower()}>"


def _lines(text: str) -> Iterator[str]:
    """Text in lines that an editor shows whole."""
    yield from map(_line, textwrap.wrap(text, WIDTH, break_on_hyphens=False))


def _line(text: str) -> str:
    """Text with the characters of roff's own escaped."""
    text = text.strip().replace("\\[", "[").replace("\\", "\\e").replace("-", "\\-")
    text = "".join(c if c.isascii() else f"\\[u{ord(c):04X}]" for c in text)
    return f"\\&{text}" if text.startswith((".", "'")) else text


def _quoted(text: str) -> str:
    """One argument of a macro."""
    return '"' + _line(text).replace('"', "\\(dq") + '"'


if __name__ == "__main__":
    PAGE.write_text(manual_page_source(), encoding="utf-8")
