"""The verb identify: catalogued objects for the tracks of a night or the streaks in frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from rsoconsole.cli.recorded.frames import ExtensionOption
from rsoconsole.cli.recorded.orbit import (
    ObjectOption,
    RadiansOption,
    SigmaOption,
    SiteOption,
    StationsOption,
    TrackOption,
    read_options,
)
from rsoconsole.cli.words import completion, output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import (
    ConfigOption,
    JsonOption,
    TleOption,
    read_element_sets,
    session_element_files,
)
from rsoconsole.cli.words.standard_input import (
    FilesFromOption,
    InputFiles,
    given_files,
    open_input_files,
)
from rsoconsole.config import Config, load_config

if TYPE_CHECKING:
    from rsoconsole.library import ReadOptions
    from rsoconsole.pipeline import ObservedTrack


def identify(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="SESSION-or-FILE | FRAME...",
            help="Session or file of observations; with --field frames (FITS); - for standard"
            " input.",
            autocompletion=completion.sessions,
            show_default=False,
        ),
    ] = None,
    *,
    files_from: FilesFromOption = None,
    field: Annotated[
        bool, typer.Option("--field", help="What was in these frames: each by itself, and movers.")
    ] = False,
    plate: Annotated[
        Literal["auto", "solve", "header"],
        typer.Option(
            help="With --field: solve each frame, take its header's WCS, or (auto) the header's"
            " where solving fails."
        ),
    ] = "auto",
    extension: ExtensionOption = None,
    tle: TleOption = None,
    gate: Annotated[
        float, typer.Option(min=0.001, max=5.0, help="How far off an object may be, degrees.")
    ] = 0.2,
    track: TrackOption = None,
    sigma: SigmaOption = 1.0,
    site: SiteOption = None,
    stations: StationsOption = None,
    object_: ObjectOption = None,
    radians: RadiansOption = None,
    keep: Annotated[
        bool,
        typer.Option(
            "--keep", help="Keep the session's tracks that no catalogue explains in the ledger."
        ),
    ] = False,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Identify the catalogued object that was followed, or list those it may have been.

    Every object of the files is propagated by its elements to the time of the
    track and compared in position and motion, with the error that elements of
    that age have. Without --tle the files of catalogue.tle_files in the
    configuration are used; for a simulated night, or where none are configured,
    those that the session was recorded with. 'ambiguous' and 'unknown' are
    answers too.

    All tracks of a session are named together: a catalogued object is at most
    one of the tracks seen at the same time, and an error common to the elements
    of one slot is found from the positions of its members relative to each
    other. Where another choice is one twentieth as likely or more, the answer
    is 'ambiguous'.

    Files of observations may be what 'rsoconsole orbit' reads.

    A track that no catalogue explains is looked up in the ledger of such tracks,
    and added to it with --keep (see 'rsoconsole ledger'). Tracks of simulated
    nights have a ledger of their own.

    Example: rsoconsole identify sessions/intelsat-14 --tle catalogue.tle

    With --field the arguments are frames, and the question is what each shows.
    Every catalogued object whose path comes into the frame during the exposure is
    compared with every streak and crossing that the detector finds: how far
    ahead of its elements or behind them (seconds), how far off its path
    (arcsec), direction, and rate times exposure against length. One streak
    is one object. Listed are the streaks with their names or 'not in catalogue',
    and the catalogued objects that were not seen. Points that move through three
    frames or more, and are no star, are measured in each frame.

    How far off an object may be is assumed from the literature by element
    age and kind of orbit until 'calibrate-elements' has measured it on your
    nights; the last line says which holds. Low objects are sought at least a minute
    along their path, and no elements more than 60 days from the frame are used.
    The frames need a start and an exposure time, and configuration or header the
    site.

    Example: rsoconsole identify --field night/*.fits --tle catalogue.tle
    """
    given = given_files(paths, files_from)
    if field:
        from rsoconsole.cli.recorded._identify_field import identify_field

        if keep or track is not None:
            raise typer.BadParameter("--keep and --track are for sessions", param_hint="--field")
        with open_input_files([*given, *(tle or [])]) as files:
            identify_field(files, len(given), plate, config, extension=extension, json_=json_)
        return
    if extension is not None:
        raise typer.BadParameter("only frames have images: --field", param_hint="--extension")
    if len(given) != 1:
        raise typer.BadParameter("one session or file at a time; frames need --field")
    ask = read_options(sigma, site, stations, object_, is_radians=radians)
    with open_input_files([*given, *(tle or [])]) as files:
        report, is_several = _report(
            files, load_config(config), ask, track=track, gate_deg=gate, is_kept=keep
        )
    if json_:
        output.emit_json(report)
        return
    from rsoconsole.cli.words.element_error_words import error_source_lines
    from rsoconsole.cli.words.field_words import ledger_match_lines, track_identification_lines
    from rsoconsole.cli.words.orbit_words import identification_lines

    if track is None and is_several:
        output.say(*track_identification_lines(report["tracks"]), "")
    regimes = {each["regime"] for each in report["matches"]}
    output.say(
        *identification_lines(report),
        *error_source_lines(report["element_errors"], regimes),
        *ledger_match_lines(report),
    )


def _report(
    given: InputFiles,
    settings: Config,
    ask: "ReadOptions",
    *,
    track: int | None,
    gate_deg: float,
    is_kept: bool,
) -> tuple[dict[str, Any], bool]:
    """Identification of a session or a file, and True where it holds several tracks.

    ``given``: the session or file, then files of elements.
    """
    from rsoconsole.cli.recorded._identify_field import SessionLedger
    from rsoconsole.orbits import identify_jointly
    from rsoconsole.pipeline import (
        catalogue_errors,
        errors_report,
        identification_report,
        longest_arc,
        named_track_report,
    )

    catalogue = settings.catalogue
    path, *tle = given.paths
    files = tle or session_element_files(path, catalogue.tle_files)
    tracks, shown, lines_not_used = _tracks_of(path, ask, track)
    sets = read_element_sets(files, given)
    with progress_bar("names"):
        arcs = [longest_arc(each.seen) for each in tracks]
        named = identify_jointly(
            arcs,
            tracks[0].site,
            sets.entries,
            gate_deg=gate_deg,
            errors=catalogue_errors(catalogue),
        )
    ledger = SessionLedger(path, tracks, named)
    found = dict(zip((each.number for each in tracks), zip(named, arcs, strict=True), strict=True))
    one, arc = found[shown.number]
    arc_s = float(arc.t_s[-1] - arc.t_s[0])
    report: dict[str, Any] = identification_report(shown.name, one, arc_s)
    report["tracks"] = [
        {**named_track_report(number, *found[number]), "ledger": ledger.matching_entry(number)}
        for number in sorted(found)
    ]
    report["lines_not_used"] = lines_not_used
    report["kept"] = ledger.add_unexplained_tracks() if is_kept else None
    report["element_errors"] = errors_report(catalogue)
    report["not_used"] = sets.not_used
    return report, len(tracks) > 1


def _tracks_of(
    path: Path, ask: "ReadOptions", track: int | None
) -> "tuple[tuple[ObservedTrack, ...], ObservedTrack, list[str]]":
    """Tracks that are named together, the object that is reported in full, and lines not used."""
    from rsoconsole.library import read_observations

    groups = read_observations(path, ask)
    tracks = max(groups, key=lambda each: len(each[0].seen))
    not_used = [line for group in groups for each in group for line in each.not_used]
    if len(groups) > 1:
        output.print_to_stderr(
            f"rsoconsole: {len(groups)} stations; by {tracks[0].name}, which has most"
        )
    if track is not None:
        chosen = [each for each in tracks if each.number == track or each.track_id is None]
        # Asked for one that is not there, it says which there are.
        if not chosen:
            chosen = list(read_observations(path, ask, track=track)[0])
        return tracks, chosen[0], not_used
    if len(tracks) > 1:
        output.print_to_stderr(
            f"rsoconsole: {len(tracks)} tracks, named together; the longest in full, see --track"
        )
    return tracks, tracks[0], not_used
