"""The verb calibrate-time: shutter timing from navigation satellites in recorded nights."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.base import ConfigError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress
from rsoconsole.cli.words.options import ConfigOption, JsonOption, SessionsArgument, WriteOption
from rsoconsole.cli.words.usage import write_to_config
from rsoconsole.config import load_config

if TYPE_CHECKING:
    from rsoconsole.orbits import CatalogueEntry, NavigationFile
    from rsoconsole.pipeline import FoundTiming


def calibrate_time(
    nights: SessionsArgument,
    *,
    rinex: Annotated[
        list[Path] | None,
        typer.Option(help="Broadcast navigation file (RINEX 2, 3, 4; .gz); may be repeated."),
    ] = None,
    sp3: Annotated[
        list[Path] | None, typer.Option(help="Precise orbits (SP3-c, SP3-d; .gz); may be repeated.")
    ] = None,
    tle: Annotated[
        list[Path] | None,
        typer.Option(
            help="Element sets. Alone: a sanity check to 0.3 s; beside the others: names."
        ),
    ] = None,
    write: WriteOption = False,
    force: Annotated[
        bool, typer.Option("--force", help="Write also over a result with smaller errors.")
    ] = False,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """When does the shutter open? From navigation satellites in recorded nights.

    Every whole streak of a GPS, Galileo, QZSS or BeiDou satellite is held
    against its orbit: how far along it is off, over its rate, is time. That
    gives for each camera mode (exposure, binning, subframe, gain) the bias
    (true mid-exposure of the first row minus the header's), its scatter from
    frame to frame and the line time of a rolling shutter, each with its
    error. What all stars of the catalogue are off together is adjusted too:
    satellites that go in several directions tell it from time. Some twenty
    tracks of six frames each, all over the sky and over the frame, give the
    bias to 2 to 4 ms where the ends of streaks are good to 0.35 arcsec,
    to 7 ms in wind that shakes the image by an arcsec and to 11 where it
    does by 2.5: take twice the frames there.

    Broadcast files serve the night itself (2 m, 0.3 ms), SP3 afterwards.

    With --write the result goes into exposure.calibrated of the
    configuration: times, their errors in R, exports and orbits of nights
    recorded from then on rest on it; 'doctor' shows it with its age.

    Example: rsoconsole calibrate-time night --rinex BRDC00IGS.rnx --write
    """
    from rsoconsole.cli.words.calibrate_time_words import cautions, timing_lines, timing_report
    from rsoconsole.pipeline import with_norad

    given = [each for each in (rinex, sp3) if each]
    if len(given) > 1:
        raise typer.BadParameter("--rinex and --sp3 exclude each other")
    if not given and not tle:
        raise typer.BadParameter(
            "name the orbits: --rinex for the night itself, --sp3 afterwards, --tle as a sanity"
            " check"
        )
    if write and not given:
        raise typer.BadParameter(
            "elements are no calibration: give --rinex or --sp3", param_hint="--write"
        )
    settings = load_config(config)
    entries = _elements(nights, tle, settings.catalogue.tle_files)
    with progress("shutter"):
        found, file = _found(nights, rinex, sp3, entries)
    found = with_norad(found, file, entries)
    if not json_:  # what --force would write is seen before it is refused
        output.say(*timing_lines(found))
        for words in cautions(found):
            output.print_to_stderr(f"rsoconsole: {words}")
    try:
        written = _write(found, config, force=force) if write else None
    except ConfigError:
        if json_:
            output.emit_json(timing_report(found, None))
        raise
    if json_:
        output.emit_json(timing_report(found, written))
        return
    if written is not None:
        output.say("", f"written to {written}: nights that begin from now on use it")
    elif given:
        output.say("", "--write puts it into the configuration")


def _found(
    nights: Sequence[Path],
    rinex: Sequence[Path] | None,
    sp3: Sequence[Path] | None,
    entries: "Sequence[CatalogueEntry]",
) -> "tuple[FoundTiming, NavigationFile]":
    from rsoconsole.pipeline import calibrate_time as calibrate
    from rsoconsole.pipeline import from_elements, read_rinex, read_sp3
    from rsoconsole.session import SessionReader

    if rinex:
        file, source = read_rinex(rinex), _names(rinex)
    elif sp3:
        file, source = read_sp3(sp3), _names(sp3)
    else:
        last_ns = max((SessionReader(night).counts().t_last_utc_ns or 0) for night in nights)
        file, source = from_elements(entries, last_ns), "the element files"
    return calibrate(nights, file, source), file


def _names(files: Sequence[Path]) -> str:
    return ", ".join(path.name for path in files)


def _elements(
    nights: Sequence[Path], tle: Sequence[Path] | None, configured: Sequence[Path]
) -> "Sequence[CatalogueEntry]":
    """Element files: those named; else, for names alone, those of the nights or configured."""
    from rsoconsole.pipeline import read_catalogue
    from rsoconsole.session import SessionReader

    if tle:
        return read_catalogue(tle)
    own = [path for night in nights for path in SessionReader(night).config().catalogue.tle_files]
    there = [path for path in dict.fromkeys([*own, *configured]) if path.exists()]
    return read_catalogue(there)


def _write(found: "FoundTiming", config_path: Path | None, *, force: bool) -> Path:
    """Put the result into the configuration file; return its path. Raises ConfigError."""
    from rsoconsole.pipeline import merged_timings, timings_of, worse_than_known
    from rsoconsole.words import errors_words, mode_words

    if found.simulated and not force:
        raise ConfigError(
            f"not written: {found.simulated[0].name} is of the simulated observatory, whose shutter"
            " is not your camera's; --force writes it all the same"
        )
    exposure = load_config(config_path, environ={}).exposure
    timings = timings_of(found)
    worse = worse_than_known(timings, exposure)
    if worse and not force:
        new, old = worse[0]
        raise ConfigError(
            f"not written: at {mode_words(old.mode)} the configuration has {errors_words(old)}"
            f" (of {old.measured_on}), this result {errors_words(new)}: add nights, or --force"
        )
    whole = [each.model_dump(mode="json") for each in merged_timings(exposure, timings)]
    return write_to_config(config_path, {"exposure.calibrated": whole})
