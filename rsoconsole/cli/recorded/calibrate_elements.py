"""The verb calibrate-elements: errors of element sets, measured on the user's own nights."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rsoconsole.base import OrbitError, SessionError
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import progress
from rsoconsole.cli.words.options import ConfigOption, JsonOption, TleOption, WriteOption
from rsoconsole.cli.words.standard_input import InputFiles, open_input_files
from rsoconsole.cli.words.usage import write_to_config
from rsoconsole.config import Config, load_config

if TYPE_CHECKING:
    from rsoconsole.orbits import CatalogueEntry, FittedFactors
    from rsoconsole.pipeline import NightRows
    from rsoconsole.session import ElementLedger


def calibrate_elements(
    nights: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="NIGHT",
            help="Folders of recorded sessions, or files of lines by 'identify --field --json', -"
            " for such lines on standard input.",
            autocompletion=completion.sessions,
        ),
    ] = None,
    *,
    tle: TleOption = None,
    write: WriteOption = False,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="Simulated nights; they have a ledger of their own.")
    ] = False,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """How far are elements off? From tracks of your own nights that are surely named.

    Each track goes into a ledger: observed minus computed along its path
    (seconds, km) and across (arcsec, km), and how old its elements were. The
    same track again takes its own place. Without NIGHT the ledger is shown.

    What 'identify' and the engine assume of elements (from the literature) is
    multiplied by factors of each kind of orbit, fitted to the ledger: along
    the track at the epoch, along by age, and across; what a manoeuvre does
    stays as assumed. Few tracks change little; many of one object count as
    few.

    With --write the factors go into catalogue.error_factors of the
    configuration, for what is named from then on; sessions keep theirs. A
    clock that is off looks like elements that are: 'calibrate-time' first.

    Example: rsoconsole calibrate-elements night-1 night-2 --tle all.tle
    """
    from rsoconsole.cli.words.element_error_words import element_ledger_lines, regime_report
    from rsoconsole.orbits import fit_factors
    from rsoconsole.session import element_ledger_path

    if tle and not nights:
        raise typer.BadParameter("elements are for nights: name one", param_hint="--tle")
    if write and simulated:
        raise typer.BadParameter(
            "simulated nights tell nothing of real elements", param_hint="--write"
        )
    settings = load_config(config)
    path = element_ledger_path(is_simulated=simulated)
    with open_input_files([*(nights or []), *(tle or [])]) as files:
        found, failures = _read(files, len(nights or []), settings, simulated=simulated)
    ledger = _kept([each for _, each in found], path)
    fitted = fit_factors(ledger.rows)
    report: dict[str, Any] = {
        "ledger": path,
        "simulated": simulated,
        "nights": [{"night": night, **output.with_unit_keys(rows)} for night, rows in found],
        "tracks": len(ledger.rows),
        "regimes": [regime_report(each, ledger.rows, settings.catalogue) for each in fitted],
        "written": _write(fitted, config) if write else None,
    }
    if json_:
        output.emit_json(report)
    else:
        output.say(*element_ledger_lines(report))
        if not ledger.rows:
            output.print_to_stderr(
                f"no track is kept in {path}: name nights whose tracks are named"
            )
        elif report["written"]:
            output.say("", f"written to {report['written']}: what is named from now on uses it")
        elif not simulated:
            output.say("", "--write puts the factors into the configuration")
    output.exit_if(failures)


def _read(
    files: InputFiles, nights: int, settings: Config, *, simulated: bool
) -> "tuple[list[tuple[Path, NightRows]], int]":
    """Results of the nights, and the number of nights without: an unusable one ends no other."""
    from rsoconsole.cli.words.options import element_files
    from rsoconsole.pipeline import (
        is_session,
        read_catalogue,
        rows_of_lines,
        rows_of_session,
        wide_errors_of,
    )

    catalogue = settings.catalogue
    known: dict[tuple[Path, ...], Sequence[CatalogueEntry]] = {}
    found: list[tuple[Path, NightRows]] = []
    failures = 0

    def of_session(night: Path) -> "NightRows":
        folder = night if night.is_dir() else night.parent
        _expect_kind(folder, simulated=simulated)
        sets = tle or tuple(element_files(folder, catalogue.tle_files))
        if sets not in known:
            known[sets] = read_catalogue(sets)
        return rows_of_session(night, known[sets], wide_errors_of(catalogue))

    tle = tuple(files.paths[nights:])
    with progress("nights", nights) as bar:
        for night in files.paths[:nights]:
            try:
                rows = (
                    of_session(night)
                    if is_session(night)
                    else rows_of_lines(night, is_simulated=simulated)
                )
                found.append((Path(files.name(night)), rows))
            except (OrbitError, SessionError) as error:
                failures += 1
                with bar.aside():
                    output.print_to_stderr(f"rsoconsole: {files.words(str(error))}")
            bar()
    return found, failures


def _expect_kind(folder: Path, *, simulated: bool) -> None:
    """Raises SessionError for a simulated night among real ones, and the other way round."""
    from rsoconsole.session import SessionReader

    is_simulated = SessionReader(folder).about().get("is_simulated") is True
    if is_simulated and not simulated:
        raise SessionError(
            f"{folder} is a simulated night, and tells nothing of real elements: with --simulated"
            " it goes into a ledger of its own"
        )
    if simulated and not is_simulated:
        raise SessionError(f"{folder} is a real night: leave --simulated out")


def _kept(found: "Sequence[NightRows]", path: Path) -> "ElementLedger":
    """The ledger with these rows in it."""
    from rsoconsole.cli.words.ledger_words import say_moved_aside
    from rsoconsole.session import damage_words, keep_rows, read_element_ledger

    if not found:
        ledger = read_element_ledger(path)
        if words := damage_words(ledger.unreadable, path):
            output.print_to_stderr(f"rsoconsole: {words}")
        return ledger
    sessions = [session for each in found for session in each.sessions]
    ledger, aside = keep_rows(sessions, [row for each in found for row in each.rows], path)
    say_moved_aside(aside)
    return ledger


def _write(fitted: "Sequence[FittedFactors]", config_path: Path | None) -> Path:
    """Write factors to the configuration file; return its path. Raises ConfigError, OrbitError."""
    from rsoconsole.pipeline import settings_of

    if not fitted:
        raise OrbitError("not written: the ledger holds no track; name nights")
    factors = settings_of(fitted, load_config(config_path, environ={}).catalogue)
    return write_to_config(config_path, {"catalogue.error_factors": factors})
