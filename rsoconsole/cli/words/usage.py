"""Errors of usage in one line (verb, fault, remedy), and the layout of help texts."""

import contextlib
import inspect
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from rsoconsole.base import nearest_name, plain_fault
from rsoconsole.cli.words import output
from rsoconsole.config import APP, default_config_path, overriding_variables

USAGE_EXIT = 2
# Some versions of typer carry a click of their own: its classes are found through typer's.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]
OWN_LINE = re.compile(r"Example: |--|[a-z]+(?:, [a-z]+)*: ")
"""Beginnings of lines of a help text that are not joined to the line before."""


def unwrap_help_texts(app: typer.Typer) -> None:
    """Join the lines of every verb's help text, so that the terminal's width breaks them."""
    for command in app.registered_commands:
        command.help = unwrapped_paragraphs(command.help or inspect.getdoc(command.callback) or "")
    callback = app.registered_callback
    if callback is not None and callback.callback is not None:
        callback.help = (
            unwrapped_paragraphs(callback.help or inspect.getdoc(callback.callback) or "") or None
        )
    for group in app.registered_groups:
        if group.typer_instance is not None:
            unwrap_help_texts(group.typer_instance)


def unwrapped_paragraphs(text: str) -> str:
    """Return the text with each paragraph in one line, but breaks before ``OWN_LINE`` kept.

    Square brackets, which are markup to typer, are escaped.
    """
    paragraphs: list[str] = []
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        lines: list[str] = []
        for line in map(str.strip, paragraph.splitlines()):
            if lines and not OWN_LINE.match(line):
                lines[-1] += f" {line}"
            else:
                lines.append(line)
        paragraphs.append("\n".join(lines))
    return "\n\n".join(paragraphs).replace("[", r"\[")


def usage_line(error: Any) -> str:
    """A usage error as one line for people, ending with the remedy."""
    context = error.ctx
    path = context.command_path if context is not None else APP
    words = plain_fault(error.format_message().replace("\n", " "))
    words = _near_option(words, error)
    remedy = "" if "?" in words else f": '{path} --help' shows an example"
    return f"{path}: {words[:1].lower()}{words[1:]}{remedy}"


@contextlib.contextmanager
def as_usage_error(hint: str = "", caught: type[Exception] = ValueError) -> Iterator[None]:
    """Raise errors of the type ``caught`` as typer's BadParameter of the option ``hint``."""
    try:
        yield
    except caught as error:
        raise typer.BadParameter(str(error), param_hint=hint or None) from error


def write_to_config(
    config: Path | None, settings: Mapping[str, Any], *, is_secret: bool = False
) -> Path:
    """Write settings into the configuration file; return its path. Raises ConfigError.

    ``settings``: values by dotted name. ``is_secret``: make the file readable by the user alone.
    Environment variables that override these settings are named on stderr.
    """
    from rsoconsole.config import write_settings

    path = config or default_config_path()
    write_settings(path, settings, is_secret=is_secret)
    for each in overriding_variables(settings, os.environ):
        output.print_to_stderr(f"{APP}: {each} is set and counts more than the file: unset it")
    return path


def no_arguments_help(error: Any) -> str | None:
    """Return the help to print for a verb called without arguments; None for other errors.

    Empty where typer has printed the help itself.
    """
    return error.ctx.get_help() or "" if type(error).__name__ == "NoArgsIsHelpError" else None


def _near_option(words: str, error: Any) -> str:
    """A wrong option with the option that was probably meant, where there is one."""
    if type(error).__name__ != "NoSuchOption" or error.ctx is None:
        return words
    options = [each for one in error.ctx.command.params for each in one.opts if each[:2] == "--"]
    near = nearest_name(error.option_name, options)
    plain = f"no such option: {error.option_name}"
    return f"{plain}: did you mean {near}?" if near else plain
