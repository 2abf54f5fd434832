"""The manual page, made of what the verbs say of themselves: man(7) source.

``python -m rsoconsole.cli.manual_page`` writes it to where packages take it from.
"""

import re
import textwrap
from collections.abc import Iterator
from typing import Any

import typer

from rsoconsole import __version__
from rsoconsole.cli.words.usage import OWN_LINE
from rsoconsole.config import APP

_HEAD = """\
.\\" Made of the program's own helps: python -m rsoconsole.cli.manual_page
.TH RSOCONSOLE 1 "" "{version}" "User Commands"
.SH NAME
rsoconsole \\- find and follow satellites that nobody told you about
.SH SYNOPSIS
.B rsoconsole
.I command
.RI [ options ]
.RI [ arguments ]
.SH DESCRIPTION
A small telescope, a mono camera and a small computer find and follow
satellites.
The sky is exposed at the sidereal rate: stars stay points, a satellite
becomes a streak.
A neural network finds the streak, the stars around it tell where it is, a
Kalman filter predicts where it will be, and the mount goes there for the next
exposure.
.PP
.B rsoconsole demo
starts a simulated observatory and the operator's console on it.
.B rsoconsole engine
runs the telescope of the configuration, without a terminal;
.B rsoconsole console
shows what it does, and
.B rsoconsole stop
stops the telescope, engine or no engine.
.SH COMMANDS
Every command has
.B \\-\\-help
with an example.
"""
_TAIL = """\
.SH STANDARD INPUT
A frame, a file of observations or a file of elements that is called
.B \\-
is read from standard input.
.B \\-\\-files\\-from
.I FILE
reads the names of frames from a file, one a line, or each ended by a zero byte
as
.B find \\-print0
writes them;
.B \\-\\-files\\-from \\-
reads these names from standard input.
.SH STANDARD OUTPUT AND ERRORS
What was asked for goes to standard output, all else to standard error.
With
.B \\-\\-json
standard output is JSON alone, one object a line.
How far long work has come is shown on standard error where that is a terminal.
.SH EXIT STATUS
.TP
.B 0
It did its work.
Nothing detected, not solved, unknown are results.
.TP
.B 1
It could not; a line on standard error says why and what to do.
.TP
.B 2
Wrong usage.
.TP
.B 130
Interrupted.
.TP
.B 141
Nobody reads its output any more, as after
.BR "| head" .
.SH ENVIRONMENT
.TP
.BI RSOCONSOLE_ SECTION __ SETTING
A setting of the configuration,
.B RSOCONSOLE_SITE__LATITUDE_DEG=51.5
for
.BR site.latitude_deg .
Options count more than variables, variables more than the file, the file more
than defaults;
.B rsoconsole config show
says which of them each value is from.
A list is one value, or JSON; an empty variable is as if it were not set;
.B null
takes what the file says away.
.TP
.B RSOCONSOLE_CONFIG
The configuration file.
.TP
.B NO_COLOR
No colours.
.TP
.BR XDG_CONFIG_HOME ", " XDG_DATA_HOME ", " XDG_STATE_HOME ", " XDG_RUNTIME_DIR
Where the files below lie.
.SH FILES
.TP
.I ~/.config/rsoconsole/config.toml
The configuration;
.B rsoconsole config init
writes one with every setting and what it means.
.TP
.I ~/.local/share/rsoconsole/sessions
Recorded nights.
.TP
.I ~/.local/state/rsoconsole/log
Logs.
.TP
.I $XDG_RUNTIME_DIR/rsoconsole
The engine's socket.
.SH EXAMPLES
.EX
rsoconsole demo
rsoconsole detect night/*.fits \\-\\-json | jq .detections
find night \\-name '*.fits' \\-print0 | rsoconsole process \\-\\-files\\-from \\-
rsoconsole export SESSION \\-\\-format tdm \\-\\-out \\- | less
RSOCONSOLE_DETECTOR__TAU=0.2 rsoconsole detect frame.fits
rsoconsole \\-\\-install\\-completion
.EE
"""
WIDTH = 70
_KINDS = re.compile(r"<(?:list\[)?(\w+)(?:\]| range)?>")


def manual_page(program: Any) -> str:
    """The page of a typer program."""
    lines = [_HEAD.format(version=f"{APP} {__version__}").rstrip("\n")]
    context = typer.Context(program, info_name=APP)
    for command, inner in _commands(program, context):
        lines += _command_lines(command, inner)
    return "\n".join([*lines, _TAIL])


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
    """What an option takes, for people who write no Python."""
    return f"<{found[1].lower()}>"


def _lines(text: str) -> Iterator[str]:
    """The same text in lines that an editor shows whole."""
    yield from map(_line, textwrap.wrap(text, WIDTH, break_on_hyphens=False))


def _line(text: str) -> str:
    """Text that holds nothing of roff's own."""
    text = text.strip().replace("\\[", "[").replace("\\", "\\e").replace("-", "\\-")
    text = "".join(c if c.isascii() else f"\\[u{ord(c):04X}]" for c in text)
    return f"\\&{text}" if text.startswith((".", "'")) else text


def _quoted(text: str) -> str:
    """One argument of a macro."""
    return '"' + _line(text).replace('"', "\\(dq") + '"'
