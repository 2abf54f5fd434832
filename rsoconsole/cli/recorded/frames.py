"""Verbs that work on recorded frames: process, detect, solve."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rsoconsole.base import FrameError
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import (
    NoDaskOption,
    ProgressBar,
    SchedulerOption,
    SerialOption,
    WorkersOption,
    progress_bar,
    resolved_paths,
)
from rsoconsole.cli.words.frame_words import (
    detect_lines,
    image_name,
    process_words,
    solve_lines,
)
from rsoconsole.cli.words.options import ConfigOption, JsonOption, PresetOption, TauOption
from rsoconsole.cli.words.standard_input import (
    FilesFromOption,
    InputFiles,
    given_files,
    open_input_files,
)
from rsoconsole.config import Config, load_config

if TYPE_CHECKING:
    from rsoconsole.pipeline import BatchNight, NightOutcome, WorkerPool


def process_nights(
    nights: "tuple[BatchNight, ...]",
    root: Path,
    pool_of: "Callable[[int], WorkerPool]",
    json_: bool,
) -> None:
    """Make a session of each night under ``root`` and report it.

    ``pool_of``: makes a pool of the given number of workers. Exits with 1 where a night failed or
    had unreadable frames.
    """
    from rsoconsole.pipeline.batch import batch_nights

    is_whole = True
    with batch_nights.lock_batch_folder(root), progress_bar("nights", len(nights)) as bar:
        for outcome in batch_nights.process_nights(nights, pool_of, on_done=bar):
            is_whole = is_whole and outcome.error is None and not outcome.unreadable
            with bar.hide_while_printing():
                _say(outcome, json_)
    output.exit_if(not is_whole)


def _say(outcome: "NightOutcome", json_: bool) -> None:
    output.emit_json(_night_report(outcome)) if json_ else output.say(_night_words(outcome))
    for words in (*outcome.unreadable, *filter(None, (outcome.error,))):
        output.print_to_stderr(f"rsoconsole: {outcome.source.name}: {words}")


_AS_IT_IS = (
    *("frames", "unreadable", "detections", "measurements", "misses", "without_time"),
    "locked_after_frames",
)
"""Keys of the report that are copied from the outcome."""


def _night_report(outcome: "NightOutcome") -> dict[str, Any]:
    return {
        "night": str(outcome.source),
        "session": None if outcome.state == "failed" else str(outcome.session),
        "outcome": outcome.state,
        "error": outcome.error,
        **{name: getattr(outcome, name) for name in _AS_IT_IS},
        "state": outcome.last_state,
    }


def _night_words(outcome: "NightOutcome") -> str:
    if outcome.state == "failed":
        return f"{outcome.source.name}: failed"
    locked = outcome.locked_after_frames
    followed = "nothing locked" if locked is None else f"locked after frame {locked}"
    timeless = outcome.without_time
    no_time = f", {timeless} without a time of exposure" if timeless else ""
    already = ", done already" if outcome.state == "skipped" else ""
    return (
        f"{outcome.source.name}: {outcome.frames} frames, {outcome.measurements} measurements,"
        f" {followed}, {outcome.misses} missed{no_time}{already}  {outcome.session}"
    )


FramesArgument = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="FRAME...",
        help="FITS (.gz .bz2 .fz), TIFF or PNG files; - for one on standard input.",
        show_default=False,
    ),
]
ExtensionOption = Annotated[
    str | None,
    typer.Option(
        "--extension",
        metavar="NAME|N|all",
        help="Image of a FITS file that has several: its extension's name (SCI or SCI,2), its"
        " number, or all for one after another. Default: the first.",
    ),
]


def report_error(files: InputFiles, path: Path, error: FrameError, json_: bool) -> None:
    """Report an error of an input file, on stderr or as JSON."""
    output.report_fault(json_, files.name_standard_input(str(error)), frame=files.name(path))


def run_on_each_frame(
    files: InputFiles,
    paths: Sequence[Path],
    json_: bool,
    work: Callable[[Path, int, ProgressBar], None],
) -> int:
    """Run ``work`` on each frame in order; return the number of frames that raised FrameError.

    Such frames are reported and skipped. ``work`` gets the path, its number (1 for the first) and
    the progress bar.
    """
    failures = 0
    with progress_bar("frames", len(paths)) as bar:
        for number, path in enumerate(paths, start=1):
            try:
                work(path, number, bar)
            except FrameError as error:
                failures += 1
                with bar.hide_while_printing():
                    report_error(files, path, error, json_)
            bar()
    return failures


def _each(
    files: InputFiles,
    json_: bool,
    work: Callable[[Path, int], Iterator[dict[str, Any]]],
    lines: Callable[[dict[str, Any]], list[str]],
) -> None:
    """Print what ``work`` finds in each of the files."""
    noted: set[str] = set()

    def show(path: Path, number: int, bar: ProgressBar) -> None:
        for found in work(path, number):
            with bar.hide_while_printing():
                output.print_answer(json_, found, lines)
                print_new_notes(image_name(found), found["notes"], noted)

    output.exit_if(run_on_each_frame(files, files.paths, json_, show))


def print_new_notes(name: str, notes: list[str], noted: set[str]) -> None:
    """Print a frame's notes on stderr that are not in ``noted``, and add them to it.

    ``name``: the frame's name.
    """
    for note in notes:
        if note not in noted:
            noted.add(note)
            output.print_to_stderr(f"rsoconsole: {name}: {note}")


def process(
    frames: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FRAME... | NIGHT...",
            help="FITS (.gz .bz2 .fz), TIFF or PNG files, - for one on standard input; or folders"
            " of them, or sessions.",
            autocompletion=completion.sessions,
            show_default=False,
        ),
    ] = None,
    *,
    files_from: FilesFromOption = None,
    session: Annotated[
        Path | None,
        typer.Option(
            help="Also record it as a session in this new folder; for nights: the folder in which"
            " each becomes a session of its own."
        ),
    ] = None,
    config: ConfigOption = None,
    tau: TauOption = None,
    preset: PresetOption = None,
    extension: ExtensionOption = None,
    again: Annotated[
        bool, typer.Option("--again", help="Make also those nights again that are there already.")
    ] = False,
    workers: WorkersOption = None,
    serial: SerialOption = False,
    scheduler: SchedulerOption = None,
    no_dask: NoDaskOption = False,
    json_: JsonOption = False,
) -> None:
    """Run the autonomous algorithm over recorded frames, without a mount.

    Frames are taken in the order given. Example: rsoconsole process night/*.fits --json

    Example: find night -name '*.fits' | sort | rsoconsole process --files-from -

    A folder is a night: its frames in the order of their names, or a session's kept frames,
    become a session. Several nights run at once (on Dask where it is installed). The same command
    given again continues interrupted work: finished nights are not processed twice.
    Example: rsoconsole process nights/* --session processed
    """
    from rsoconsole.pipeline import choose_pool, nights_of_folders

    overrides = {"detector.tau": tau, "filter.preset": preset}
    settings = load_config(config, {k: v for k, v in overrides.items() if v is not None})
    given = given_files(frames, files_from)
    is_nights = bool(given) and all(path.is_dir() for path in given)
    if extension is not None and (is_nights or extension.strip().lower() == "all"):
        raise typer.BadParameter(
            "a track follows one image after another: name one extension, and single files",
            param_hint="--extension",
        )
    if is_nights:
        if session is None:
            raise typer.BadParameter(
                "a folder of frames becomes a session: --session names where",
                param_hint="--session",
            )
        nights = nights_of_folders(
            resolved_paths(given), session.resolve(), settings, is_again=again
        )
        pool_of = partial(
            choose_pool,
            workers=workers,
            scheduler=scheduler,
            is_serial=serial,
            is_dask_wanted=not no_dask,
        )
        process_nights(nights, session.resolve(), pool_of, json_)
        return
    with open_input_files(given) as files:
        _process_frames(files, session, settings, extension, json_)


def _process_frames(
    files: InputFiles, session: Path | None, settings: Config, extension: str | None, json_: bool
) -> None:
    from rsoconsole.pipeline import (
        ProcessedFrame,
        open_reducer,
        process_files,
        process_report,
        site_of_frames,
    )
    from rsoconsole.session import BatchRecording

    failures = 0
    noted: set[str] = set()
    place = site_of_frames(files.paths, settings, extension=extension)
    settings = place.config
    with (
        open_reducer(settings) as (reducer, model_sha256),
        progress_bar("frames", len(files.paths)) as bar,
    ):
        recording = BatchRecording(session, settings, model_sha256)
        try:
            for result in process_files(files.paths, reducer, settings, extension=extension):
                bar()
                if not isinstance(result, ProcessedFrame):
                    failures += 1
                    with bar.hide_while_printing():
                        report_error(files, *result, json_)
                    continue
                recording.append(result.records, result.t_mid_utc_ns)
                found = process_report(files.name(result.path), result, place)
                with bar.hide_while_printing():
                    output.print_answer(json_, found, process_words)
                    print_new_notes(image_name(found), found["notes"], noted)
        finally:
            recording.close()
    output.exit_if(failures)


def detect(
    frames: FramesArgument = None,
    *,
    files_from: FilesFromOption = None,
    tau: TauOption = None,
    map_mode: Annotated[
        str | None,
        typer.Option(
            help="Map the network sees: fast or paper.", autocompletion=completion.map_modes
        ),
    ] = None,
    extension: ExtensionOption = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Find streaks in frames, and measure their magnitudes.

    A frame with a streak is plate-solved where its header has a direction: its stars then give the
    zero point; without one magnitudes are instrumental (0 mag is 1 ADU a second).

    Of a file with several images the first is taken; a line on stderr names the others. Stderr
    also reports, once, faults of a frame: 8 bits a pixel, or a scale or an exposure for which
    confidence is not calibrated.

    Example: rsoconsole detect frame.fits --tau 0.2 --json

    Example: find night -name '*.fits' | rsoconsole detect --files-from -

    Example: rsoconsole detect mosaic.fits --extension all
    """
    from rsoconsole.instruments import EXTENSION_KEY, read_frames
    from rsoconsole.pipeline import FrameDetector, detections_report, points_report

    overrides = {"detector.tau": tau, "detector.map_mode": map_mode}
    whole = load_config(config, {k: v for k, v in overrides.items() if v is not None})
    given = given_files(frames, files_from)
    with open_input_files(given) as files, FrameDetector(whole) as detector:

        def work(path: Path, number: int) -> Iterator[dict[str, Any]]:
            for frame in read_frames(path, number, extension=extension):
                found = detector.detect(frame)
                yield detections_report(
                    files.name(path),
                    found.detections,
                    found.photometry,
                    points=points_report(found.points),
                    extension=frame.header.get(EXTENSION_KEY),
                    notes=found.notes,
                )

        _each(files, json_, work, detect_lines)


def solve(
    frames: FramesArgument = None,
    *,
    files_from: FilesFromOption = None,
    ra: Annotated[float | None, typer.Option(help="Centre, RA in degrees.")] = None,
    dec: Annotated[float | None, typer.Option(help="Centre, Dec in degrees.")] = None,
    radius: Annotated[float | None, typer.Option(min=0.01, help="How far off, degrees.")] = None,
    scale: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="LOW HIGH", help="Plate scale, arcsec a pixel."),
    ] = None,
    extension: ExtensionOption = None,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Plate-solve frames; hints come from the header, options override them.

    A field that fails with its hints is tried with those that the header is likely to mean, then
    without any, within the same deadline; if that succeeds, the wrong hint is named, with its
    likely cause. Where a field needs finer index files than are installed,
    the answer names them. A field without a solution is reported and is no error.

    Example: rsoconsole solve frame.fits --ra 303.2 --dec 46.0 --scale 10 10.6
    """
    from rsoconsole.instruments import read_frames
    from rsoconsole.pipeline import MAX_MASKED, FrameSolver, solved_report

    if (ra is None) != (dec is None):
        raise typer.BadParameter("give both --ra and --dec, or neither")
    settings = load_config(config)
    given = given_files(frames, files_from)
    with open_input_files(given) as files, FrameSolver.open(settings) as solver:

        def work(path: Path, number: int) -> Iterator[dict[str, Any]]:
            frames_of = read_frames(
                path, number, extension=extension, max_nonfinite_fraction=MAX_MASKED
            )
            for frame in frames_of:
                solved = solver.solve(
                    frame,
                    ra_icrs_deg=ra,
                    dec_icrs_deg=dec,
                    radius_deg=radius,
                    scale_arcsec_px=scale,
                )
                yield solved_report(
                    files.name(path),
                    solved.solution,
                    frame,
                    wrong=solved.wrong,
                    index_missing=solved.index_missing,
                    notes=solved.notes,
                )

        _each(files, json_, work, solve_lines)
