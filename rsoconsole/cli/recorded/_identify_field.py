"""``identify --field``: the objects that are in frames."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, OrbitError, SessionError
from rsoconsole.cli.recorded.frames import print_new_notes, run_on_each_frame
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import ProgressBar
from rsoconsole.cli.words.ledger_words import report_moved_ledger
from rsoconsole.cli.words.options import read_element_sets
from rsoconsole.cli.words.standard_input import InputFiles
from rsoconsole.config import load_config
from rsoconsole.orbits import Identification
from rsoconsole.pipeline import (
    MIN_TRACKS,
    FieldFrame,
    FrameSite,
    ObservedTrack,
    Past,
    PlateMode,
    keep_tracks,
    longest_arc,
    site_of_frames,
)
from rsoconsole.records import LedgerName
from rsoconsole.session import SessionReader, damage_words, ledger_path, read_ledger
from rsoconsole.words import utc_ns_to_iso


def identify_field(
    files: InputFiles,
    frame_count: int,
    plate: PlateMode,
    config_path: Path | None,
    *,
    extension: str | None,
    json_: bool,
) -> None:
    """Identify and print the objects in frames; an unusable frame is reported and skipped.

    ``files``: the frames, then files of elements. ``frame_count``: number of the frames.
    """
    from rsoconsole.cli.words.element_error_words import error_source_lines
    from rsoconsole.cli.words.field_words import frame_lines, movers_lines
    from rsoconsole.instruments import EXTENSION_KEY, read_frames
    from rsoconsole.pipeline import (
        FEWEST,
        CatalogueMatcher,
        errors_report,
        frame_report,
        mover_numbers_by_norad_id,
        movers_report,
        open_field_reader,
    )

    config = load_config(config_path)
    paths, tle = files.paths[:frame_count], files.paths[frame_count:]
    place = site_of_frames(paths, config, extension=extension)
    _expect_site(place)
    config = place.config
    sets = read_element_sets(tle or list(config.catalogue.tle_files), files)
    run = CatalogueMatcher(config, sets.entries)
    read: list[tuple[str, FieldFrame]] = []
    with open_field_reader(config, plate) as reader:

        def work(path: Path, number: int, _bar: ProgressBar) -> None:
            for image in read_frames(path, number, extension=extension):
                label, shown = image.header.get(EXTENSION_KEY), files.name(path)
                name = f"{shown}[{label}]" if label else shown
                found = reader.read(image)
                notes = (*found.notes, *place.notes(image))
                read.append((name, replace(found, notes=notes)))

        failures = run_on_each_frame(files, paths, json_, work)
    read.sort(key=lambda each: each[1].t_mid_utc_ns)
    frames = [frame for _, frame in read]
    movers = run.match_movers(frames) if len(frames) >= FEWEST else ()
    named = mover_numbers_by_norad_id(movers)
    said: set[str] = set()
    errors, regimes = errors_report(config.catalogue), set[str]()
    for name, frame in read:
        found = {
            **frame_report(name, run.match_frame(frame), named),
            "site": place.report,
            "element_errors": errors,
        }
        regimes |= {each["regime"] for each in found["crossed"]}
        output.print_answer(json_, found, frame_lines)
        print_new_notes(found["frame"], found["notes"], said)
    if len(read) > 1:
        report = movers_report([name for name, _ in read], frames, movers)
        output.print_answer(json_, report, lambda found: movers_lines(found, FEWEST))
    if json_ and sets.not_used:
        output.emit_json({"not_used": sets.not_used})
    if not json_:
        output.say(*error_source_lines(errors, regimes))
    output.exit_if(failures)


def _expect_site(place: FrameSite) -> None:
    """Raises ConfigError without a site: the default one would name wrong objects."""
    if place.source == "default":
        headers = "nor do the headers of the first frames (SITELAT, SITELONG)"
        if place.words:
            headers = f"and that in the headers of the first frames cannot be used ({place.words})"
        raise ConfigError(
            f"the configuration sets no site (site.latitude_deg, site.longitude_deg), {headers}:"
            " where they were taken decides what crossed them; set latitude, longitude (east"
            " positive) and elevation"
        )


class SessionLedger:
    """The ledger of uncatalogued objects, compared with the tracks of one session or file."""

    def __init__(
        self, path: Path, tracks: Sequence[ObservedTrack], named: Sequence[Identification]
    ) -> None:
        """``named``: the identification of each track, in the order of ``tracks``."""
        is_session = tracks[0].track_id is not None
        self._folder = (path if path.is_dir() else path.parent) if is_session else None
        self._unknown = [
            each for each, name in zip(tracks, named, strict=True) if name.verdict == "unknown"
        ]
        self._named = [
            each for each, name in zip(tracks, named, strict=True) if name.verdict == "identified"
        ]
        is_simulated = (
            self._folder is not None
            and SessionReader(self._folder).read_meta().get("is_simulated") is True
        )
        self._path = ledger_path(is_simulated=is_simulated)
        self._names = self._recognised()

    def matching_entry(self, number: int) -> dict[str, Any] | None:
        """Return the ledger entry that track ``number`` matches, for JSON; None without a match."""
        name = self._names.get(number)
        if name is None:
            return None
        return {
            "number": name.number,
            "name": name.name,
            "probability": name.probability,
            "separation_arcsec": name.separation_arcsec,
            "t_last_utc": utc_ns_to_iso(name.t_last_utc_ns),
        }

    def add_unexplained_tracks(self) -> list[dict[str, Any]]:
        """Add the tracks that no catalogue explains to the ledger; return a JSON object for each.

        Its keys: track, number in the ledger, is_new. Raises OrbitError for a file of
        observations, SessionError where session or ledger cannot be used.
        """
        if self._folder is None:
            raise OrbitError("--keep takes a session: a file of observations has no tracks of one")
        kept = keep_tracks(self._folder, self._unknown, self._named, self._path)
        report_moved_ledger(kept.moved_aside)
        for number in kept.too_short:
            output.print_to_stderr(
                f"rsoconsole: track {number} has fewer than {MIN_TRACKS} directions"
            )
        for number in kept.taken_back:
            output.print_to_stderr(
                f"rsoconsole: track {number} has a catalogued name: not kept any more"
            )
        return [
            {"track": each.track, "number": each.number, "is_new": each.is_new}
            for each in kept.tracks
        ]

    def _recognised(self) -> dict[int, LedgerName]:
        """Names in the ledger by track number; the session's own entries name nothing."""
        try:
            ledger = read_ledger(self._path)
        except SessionError as error:
            output.print_to_stderr(f"rsoconsole: {error}")
            return {}
        if words := damage_words(ledger.unreadable, self._path):
            output.print_to_stderr(f"rsoconsole: {words}")
        if not self._unknown:
            return {}
        session = "" if self._folder is None else self._folder.resolve().name
        arcs = {each.number: longest_arc(each.seen) for each in self._unknown}
        return Past(ledger.without_session(session)).ledger_names(arcs, self._unknown[0].site)
