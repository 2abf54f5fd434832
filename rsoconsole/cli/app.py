"""The program with its verbs: how it starts, reports failures and writes its log."""

import logging
import logging.handlers
import os
import signal
import sys
from collections.abc import Callable
from typing import NoReturn

import platformdirs
import typer

from rsoconsole import __version__
from rsoconsole.base import RsoconsoleError
from rsoconsole.cli.demo import demo
from rsoconsole.cli.recorded import (
    calibrate_elements,
    calibrate_time,
    catalogue,
    export,
    frames,
    identify,
    ledger,
    lightcurve,
    orbit,
    review,
    sessions,
    what_if,
)
from rsoconsole.cli.telescope import crossings, go_to, order, passes, service, setup, telescope
from rsoconsole.cli.words import output
from rsoconsole.cli.words.usage import (
    USAGE_EXIT,
    UsageError,
    no_arguments_help,
    unwrap_help_texts,
    usage_line,
)
from rsoconsole.config import APP, environment_warnings
from rsoconsole.control import one_line

log = logging.getLogger(APP)
COMPLETE = f"_{APP.upper()}_COMPLETE"
"""Environment variable that a shell sets when it requests completions."""

app = typer.Typer(
    name=APP,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Find and follow satellites that nobody told you about. Start with: rsoconsole demo",
)


def _add(*verbs: Callable[..., None]) -> None:
    for verb in verbs:
        app.command()(verb)


_add(demo.demo, telescope.console, review.review, telescope.engine, telescope.status)
order.add_command_verbs(app)
# A negative declination is an argument, no option.
app.command(context_settings={"ignore_unknown_options": True})(go_to.goto)
_add(telescope.stop, frames.process, frames.detect, frames.solve)
_add(orbit.orbit, identify.identify, passes.passes, crossings.crossings)
app.command("what-if", cls=what_if.SetOptionCommand)(what_if.what_if)
app.command("calibrate-time")(calibrate_time.calibrate_time)
app.command("calibrate-elements")(calibrate_elements.calibrate_elements)
_add(lightcurve.lightcurve, setup.doctor, export.figures, export.export)
for name, group in (
    ("ledger", ledger.ledger_app),
    ("config", setup.config_app),
    ("index", setup.index_app),
    ("catalogue", catalogue.catalogue_app),
    ("alerts", setup.alerts_app),
    ("sessions", sessions.sessions_app),
    ("service", service.service_app),
):
    app.add_typer(group, name=name)
unwrap_help_texts(app)


def _version(is_asked: bool) -> None:
    if is_asked:
        output.say(f"{APP} {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and exit."
    ),
) -> None:
    _ = version


def main() -> None:
    """Entry point: run a verb; tracebacks go to the log, and the operator sees one line."""
    log_path = _open_log()
    if COMPLETE not in os.environ:
        output.print_to_stderr(*(f"{APP}: {each}" for each in environment_warnings()))
    try:
        sys.exit(app(standalone_mode=False, prog_name=APP))
    except UsageError as error:
        if (words := no_arguments_help(error)) is None:
            output.print_to_stderr(usage_line(error))
        else:
            print(words, end="", file=sys.stderr)  # the program's own
        sys.exit(USAGE_EXIT)
    except typer.Abort:
        output.print_to_stderr(f"{APP}: interrupted")
        sys.exit(130)
    except RsoconsoleError as error:
        log.error("%s", error)
        output.print_to_stderr(f"{APP}: {error}")
        sys.exit(1)
    except KeyboardInterrupt:
        output.print_to_stderr(f"{APP}: interrupted")
        sys.exit(130)
    except BrokenPipeError:
        _leave_pipe()
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):
            _leave_pipe()
        raise
    except Exception as error:
        log.exception("unexpected")
        output.print_to_stderr(f"{APP}: something broke ({error}); the details are in {log_path}")
        sys.exit(1)


def _leave_pipe() -> NoReturn:
    """End as SIGPIPE ends a program: nobody reads any more (``| head -1``)."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())  # what is still to be flushed
    sys.exit(128 + signal.SIGPIPE)


class _CleanFormatter(logging.Formatter):
    """Formatter of plain text, one line a message, safe to read in a terminal."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        return one_line(super().formatMessage(record))


def _open_log() -> str:
    """Log to the user's log folder; to nowhere where that cannot be written."""
    root = logging.getLogger()
    root.setLevel(logging.INFO)
    folder = platformdirs.user_log_path(APP)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handler: logging.Handler = logging.handlers.RotatingFileHandler(
            folder / f"{APP}.log", maxBytes=2_000_000, backupCount=3, delay=True, encoding="utf-8"
        )
    except OSError:
        handler = logging.NullHandler()
    handler.setFormatter(
        _CleanFormatter("%(asctime)s %(levelname)s %(process)d %(name)s: %(message)s")
    )
    root.addHandler(handler)
    return str(folder / f"{APP}.log")
