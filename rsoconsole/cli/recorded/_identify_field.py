"""``identify --field``: the objects that are in frames."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, OrbitError, SessionError
from rsoconsole.cli.recorded.frames import read_each, warn
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import ProgressBar
from rsoconsole.cli.words.ledger_words import say_moved_aside
from rsoconsole.cli.words.options import catalogue_of
from rsoconsole.cli.words.standard_input import InputFiles
from rsoconsole.config import effective_settings, load_config
from rsoconsole.orbits import Identification
from rsoconsole.pipeline import (
    MIN_TRACKS,
    FieldFrame,
    ObservedTrack,
    Past,
    PlateMode,
    keep,
    longest_arc,
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
    from rsoconsole.cli.words.element_error_words import source_lines
    from rsoconsole.cli.words.field_words import frame_lines, movers_lines
    from rsoconsole.instruments import EXTENSION_KEY, read_frames
    from rsoconsole.pipeline import (
        FEWEST,
        CatalogueMatcher,
        errors_report,
        frame_report,
        movers_report,
        named_movers,
        open_field_reader,
    )

    config = load_config(config_path)
    _expect_site(config_path)
    paths, tle = files.paths[:frame_count], files.paths[frame_count:]
    run = CatalogueMatcher(config, catalogue_of(tle or list(config.catalogue.tle_files)))
    read: list[tuple[str, FieldFrame]] = []
    with open_field_reader(config, plate) as reader:

        def work(path: Path, number: int, _bar: ProgressBar) -> None:
            for image in read_frames(path, number, extension=extension):
                label, shown = image.header.get(EXTENSION_KEY), files.name(path)
                name = f"{shown}[{label}]" if label else shown
                read.append((name, reader.read(image)))

        failures = read_each(files, paths, json_, work)
    read.sort(key=lambda each: each[1].t_mid_utc_ns)
    frames = [frame for _, frame in read]
    movers = run.movers(frames) if len(frames) >= FEWEST else ()
    named = named_movers(movers)
    said: set[str] = set()
    errors, regimes = errors_report(config.catalogue), set[str]()
    for name, frame in read:
        found = {**frame_report(name, run.frame(frame), named), "element_errors": errors}
        regimes |= {each["regime"] for each in found["crossed"]}
        output.answer(json_, found, frame_lines)
        warn(found["frame"], found["notes"], said)
    if len(read) > 1:
        report = movers_report([name for name, _ in read], frames, movers)
        output.answer(json_, report, lambda found: movers_lines(found, FEWEST))
    if not json_:
        output.say(*source_lines(errors, regimes))
    output.exit_if(failures)


def _expect_site(config_path: Path | None) -> None:
    """Raises ConfigError without a configured site: the default one would name wrong objects."""
    wanted = ("site.latitude_deg", "site.longitude_deg")
    missing = [
        each.name
        for each in effective_settings(config_path)
        if each.name in wanted and each.origin == "default"
    ]
    if missing:
        raise ConfigError(
            f"the configuration sets no site ({', '.join(missing)}): where the frames were taken"
            " decides what crossed them; set latitude, longitude (east positive) and elevation"
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
            and SessionReader(self._folder).about().get("is_simulated") is True
        )
        self._path = ledger_path(is_simulated=is_simulated)
        self._names = self._recognised()

    def report_of(self, number: int) -> dict[str, Any] | None:
        """The ledger entry that a track matches, for JSON; None where none does.

        ``number``: the track's.
        """
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

    def keep(self) -> list[dict[str, Any]]:
        """Put the tracks that no catalogue explains into the ledger; return their numbers.

        One object per track, for JSON. Raises OrbitError for a file of observations, SessionError
        where session or ledger cannot be used.
        """
        if self._folder is None:
            raise OrbitError("--keep takes a session: a file of observations has no tracks of one")
        kept = keep(self._folder, self._unknown, self._named, self._path)
        say_moved_aside(kept.moved_aside)
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
        return Past(ledger.without(session)).names_of(arcs, self._unknown[0].site)
