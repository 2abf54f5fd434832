"""identify --field: what was in the frames."""

from pathlib import Path

from rsoconsole.cli.recorded.frames import read_each, warn
from rsoconsole.cli.words import Bar, Piped, catalogue_of, output
from rsoconsole.config import effective_settings, load_config
from rsoconsole.errors import ConfigError
from rsoconsole.pipeline.field import FieldFrame, PlateMode


def identify_field(
    files: Piped,
    frame_count: int,
    plate: PlateMode,
    config_path: Path | None,
    *,
    extension: str | None,
    json_: bool,
) -> None:
    """Read the frames one after another, then answer. A frame that cannot be used ends nothing.

    ``frame_count``: how many of the files are frames; the others hold elements.
    """
    from rsoconsole.cli.words import frame_lines, movers_lines, source_lines
    from rsoconsole.instruments.frames import EXTENSION_KEY, read_frames
    from rsoconsole.pipeline.field import (
        FEWEST,
        FieldRun,
        frame_report,
        movers_report,
        named_movers,
        open_field_reader,
    )
    from rsoconsole.pipeline.orbits import errors_report

    config = load_config(config_path)
    _expect_site(config_path)
    paths, tle = files.paths[:frame_count], files.paths[frame_count:]
    run = FieldRun(config, catalogue_of(tle or list(config.catalogue.tle_files)))
    read: list[tuple[str, FieldFrame]] = []
    with open_field_reader(config, plate) as reader:

        def work(path: Path, number: int, _bar: Bar) -> None:
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
    output.exit_where(failures)


def _expect_site(config_path: Path | None) -> None:
    """Raises ConfigError where nobody has set a site: a default one would name wrong objects."""
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
