"""The verb calibrate-elements: errors of element sets, measured on the user's own nights."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rsoconsole.base import OrbitError, SessionError
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import ConfigOption, JsonOption, TleOption, WriteOption
from rsoconsole.cli.words.standard_input import InputFiles, open_input_files
from rsoconsole.cli.words.usage import write_to_config
from rsoconsole.config import Config, load_config

if TYPE_CHECKING:
    from rsoconsole.orbits import CatalogueEntry, FittedFactors
    from rsoconsole.pipeline import CalibrationRows
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
    """Measure how far elements are off, from tracks of your own nights that are surely named.

    Each track goes into a ledger: observed minus computed along its path
    (seconds, km) and across (arcsec, km), and how old its elements were. A track
    given again replaces its earlier entry. Without NIGHT the ledger is shown.

    'identify' and the engine assume errors of elements from the literature. They
    are multiplied by factors for each kind of orbit, fitted to the ledger: along
    the track at the epoch, along by age, and across. The error assumed for a
    manoeuvre is not changed. Few tracks change the factors little; many tracks
    of one object count as few.

    A track whose brightness is on record also gives its object's magnitude at
    1000 km and a phase angle of 90 deg, by which 'passes' and 'crossings'
    predict how bright it will be.

    With --write the factors go into catalogue.error_factors of the
    configuration and hold for later identifications; recorded sessions keep
    theirs. A wrong clock looks like wrong elements: run 'calibrate-time' first.

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
) -> "tuple[list[tuple[Path, CalibrationRows]], int]":
    """Results of the nights, and the number of nights without: an unusable one ends no other."""
    from rsoconsole.cli.words.options import read_element_sets, session_element_files
    from rsoconsole.pipeline import (
        is_session,
        rows_of_identify_output,
        rows_of_session,
        wide_element_errors,
    )

    catalogue = settings.catalogue
    known: dict[tuple[Path, ...], Sequence[CatalogueEntry]] = {}
    found: list[tuple[Path, CalibrationRows]] = []
    failures = 0

    def of_session(night: Path) -> "CalibrationRows":
        folder = night if night.is_dir() else night.parent
        _expect_kind(folder, simulated=simulated)
        sets = tle or tuple(session_element_files(folder, catalogue.tle_files))
        if sets not in known:
            known[sets] = read_element_sets(sets, files).entries
        return rows_of_session(night, known[sets], wide_element_errors(catalogue))

    tle = tuple(files.paths[nights:])
    with progress_bar("nights", nights) as bar:
        for night in files.paths[:nights]:
            try:
                rows = (
                    of_session(night)
                    if is_session(night)
                    else rows_of_identify_output(night, is_simulated=simulated)
                )
                found.append((Path(files.name(night)), rows))
            except (OrbitError, SessionError) as error:
                failures += 1
                with bar.hide_while_printing():
                    output.print_to_stderr(f"rsoconsole: {files.name_standard_input(str(error))}")
            bar()
    return found, failures


def _expect_kind(folder: Path, *, simulated: bool) -> None:
    """Raises SessionError for a simulated night among real ones, and the other way round."""
    from rsoconsole.session import SessionReader

    is_simulated = SessionReader(folder).read_meta().get("is_simulated") is True
    if is_simulated and not simulated:
        raise SessionError(
            f"{folder} is a simulated night, and tells nothing of real elements: with --simulated"
            " it goes into a ledger of its own"
        )
    if simulated and not is_simulated:
        raise SessionError(f"{folder} is a real night: leave --simulated out")


def _kept(found: "Sequence[CalibrationRows]", path: Path) -> "ElementLedger":
    """The ledger with these rows in it."""
    from rsoconsole.cli.words.ledger_words import report_moved_ledger
    from rsoconsole.session import damage_words, read_element_ledger, replace_session_rows

    if not found:
        ledger = read_element_ledger(path)
        if words := damage_words(ledger.unreadable, path):
            output.print_to_stderr(f"rsoconsole: {words}")
        return ledger
    sessions = [session for each in found for session in each.sessions]
    ledger, aside = replace_session_rows(
        sessions, [row for each in found for row in each.rows], path
    )
    report_moved_ledger(aside)
    return ledger


def _write(fitted: "Sequence[FittedFactors]", config_path: Path | None) -> Path:
    """Write factors to the configuration file; return its path. Raises ConfigError, OrbitError."""
    from rsoconsole.pipeline import merged_error_factors

    if not fitted:
        raise OrbitError("not written: the ledger holds no track; name nights")
    factors = merged_error_factors(fitted, load_config(config_path, environ={}).catalogue)
    return write_to_config(config_path, {"catalogue.error_factors": factors})
