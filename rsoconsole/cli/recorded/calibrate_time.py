"""The verb calibrate-time: shutter timing from navigation satellites in recorded nights."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.base import ConfigError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import (
    ConfigOption,
    JsonOption,
    SessionsArgument,
    WriteOption,
    read_element_sets,
)
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
    """Measure when the shutter opens, from navigation satellites in recorded nights.

    Every whole streak of a GPS, Galileo, QZSS or BeiDou satellite is compared
    with its orbit: the error along the track divided by the rate is a time. This
    gives for each camera mode (exposure, binning, subframe, gain) the bias
    (true mid-exposure of the first row minus the header's), its scatter from
    frame to frame and the line time of a rolling shutter, each with its
    error. An offset common to all catalogue stars is fitted too: satellites that
    move in several directions separate it from time. Some twenty
    tracks of six frames each, all over the sky and over the frame, give the
    bias to 2 to 4 ms where the ends of streaks are good to 0.35 arcsec,
    to 7 ms in wind that shakes the image by 1 arcsec, to 11 ms at 2.5 arcsec:
    take twice the frames there.

    Broadcast files (2 m, 0.3 ms) can be had in the same night, SP3 files later.

    With --write the result goes into exposure.calibrated of the
    configuration. Nights recorded from then on use it for times, for their errors
    in R, for exports and orbits; 'doctor' shows it with its age.

    Example: rsoconsole calibrate-time night --rinex BRDC00IGS.rnx --write
    """
    from rsoconsole.cli.words.calibrate_time_words import cautions, timing_lines, timing_report
    from rsoconsole.pipeline import with_norad_ids

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
    with progress_bar("shutter"):
        found, file = _found(nights, rinex, sp3, entries)
    found = with_norad_ids(found, file, entries)
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
    from rsoconsole.pipeline import calibrate_shutter_timing as calibrate
    from rsoconsole.pipeline import navigation_from_elements, read_rinex, read_sp3
    from rsoconsole.session import SessionReader

    if rinex:
        file, source = read_rinex(rinex), _names(rinex)
    elif sp3:
        file, source = read_sp3(sp3), _names(sp3)
    else:
        last_ns = max((SessionReader(night).counts().t_last_utc_ns or 0) for night in nights)
        file, source = navigation_from_elements(entries, last_ns), "the element files"
    return calibrate(nights, file, source), file


def _names(files: Sequence[Path]) -> str:
    return ", ".join(path.name for path in files)


def _elements(
    nights: Sequence[Path], tle: Sequence[Path] | None, configured: Sequence[Path]
) -> "Sequence[CatalogueEntry]":
    """Element files: those named; else, for names alone, those of the nights or configured."""
    from rsoconsole.session import SessionReader

    if tle:
        return read_element_sets(tle).entries
    own = [path for night in nights for path in SessionReader(night).config().catalogue.tle_files]
    there = [path for path in dict.fromkeys([*own, *configured]) if path.exists()]
    return read_element_sets(there).entries if there else ()


def _write(found: "FoundTiming", config_path: Path | None, *, force: bool) -> Path:
    """Put the result into the configuration file; return its path. Raises ConfigError."""
    from rsoconsole.pipeline import less_certain_timings, merged_timings, timing_settings
    from rsoconsole.words import camera_mode_words, timing_errors_words

    if found.simulated and not force:
        raise ConfigError(
            f"not written: {found.simulated[0].name} is of the simulated observatory, whose shutter"
            " is not your camera's; --force writes it all the same"
        )
    exposure = load_config(config_path, environ={}).exposure
    timings = timing_settings(found)
    worse = less_certain_timings(timings, exposure)
    if worse and not force:
        new, old = worse[0]
        raise ConfigError(
            f"not written: at {camera_mode_words(old.camera_mode)} the configuration has"
            f" {timing_errors_words(old)} (of {old.measured_on}), this result"
            f" {timing_errors_words(new)}: add nights, or --force"
        )
    whole = [each.model_dump(mode="json") for each in merged_timings(exposure, timings)]
    return write_to_config(config_path, {"exposure.calibrated": whole})
