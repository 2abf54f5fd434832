"""``rsoconsole catalogue``: sources of elements, fetched on request, and their elements' age."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rsoconsole.base import ControlError, OrbitError, value_errors_as
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import progress_bar
from rsoconsole.cli.words.options import ConfigOption, JsonOption, SocketOption
from rsoconsole.cli.words.usage import write_to_config
from rsoconsole.config import Config, expand_home, load_config, without_secrets
from rsoconsole.words import count_words, utc_ns_to_iso

if TYPE_CHECKING:
    from rsoconsole.pipeline import ElementSource, SourceStatus, SourceUpdate, SourceUpdater

SLEW_WAIT_S = 300.0
_POLL_S = 2.0
NS_PER_HOUR = 3_600_000_000_000

catalogue_app = typer.Typer(
    no_args_is_help=True,
    help="Elements from CelesTrak, Space-Track and others, cached: update, list, add.",
)


@catalogue_app.command()
def update(
    *,
    source: Annotated[
        list[str] | None,
        typer.Argument(help="Of those added, these alone; default: all, in their order."),
    ] = None,
    config: ConfigOption = None,
    socket: SocketOption = None,
    json_: JsonOption = False,
) -> None:
    """Fetch the elements of all sources, each at most once in two hours.

    This verb alone fetches elements: run it by hand or from a timer. A source that refuses (403)
    is not asked again until it is added again. Where a fetch fails, the elements kept before
    stay. While the mount slews, the verb waits.

    --json: `source, fetched, ok, detail` and the keys of 'catalogue list'.
    Example: rsoconsole catalogue update
    """
    settings = load_config(config)
    chosen = _chosen(_configured(settings), source or [])
    run = _run(settings, wait=lambda: _wait_while_slewing(socket))
    run.store.set_sources(_configured(settings))
    faults = 0
    with progress_bar("sources", len(chosen)) as bar:
        for each in run.run(chosen):
            faults += each.is_fault
            bar()
            with bar.hide_while_printing():
                _report(each, settings, json_)
    output.exit_if(faults, f"{count_words(faults, 'source')} could not be fetched; each says why")


def _report(each: "SourceUpdate", settings: Config, json_: bool) -> None:
    if json_:
        outcome = {"fetched": each.is_fetched, "ok": not each.is_fault, "detail": each.words}
        output.emit_json({**_row(each.source, each.kept, settings), **outcome})
        return
    mark = "FAIL" if each.is_fault else "new " if each.is_fetched else "-   "
    output.say(f"{mark} {each.source.words:24} {each.words}")


@catalogue_app.command("list")
def list_(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """List the sources of elements by precedence, and how old their elements are.

    An object that several sources have is taken from the first, unless a later one has elements
    that are three days newer.

    Example: rsoconsole catalogue list --json
    """
    from rsoconsole.pipeline import ElementStore, SourceStatus

    settings = load_config(config)
    kept = ElementStore().statuses()
    sources = _configured(settings)
    rows = [
        _row(each, kept.get(each.text, SourceStatus(source=each.text)), settings)
        for each in sources
    ]
    rows += [_file_row(path) for path in settings.catalogue.tle_files if not path.is_dir()]
    for row in rows:
        output.print_answer(json_, row, _line)
    if not json_ and not sources and not settings.catalogue.tle_files:
        output.say(
            "no elements: 'rsoconsole catalogue add celestrak:geo' names a source,"
            " 'rsoconsole catalogue add FILE' brings a file in"
        )


@catalogue_app.command()
def add(
    *,
    source: Annotated[
        list[str],
        typer.Argument(
            help="celestrak:GROUP, supgp:FILE, space-track:all, an address (https://...) or a file."
        ),
    ],
    first: Annotated[
        bool, typer.Option("--first", help="With precedence over those that are there.")
    ] = False,
    config: ConfigOption = None,
    json_: JsonOption = False,
) -> None:
    """Add sources of elements to the configuration; files are read at once, offline.

    The cache of elements is named in catalogue.tle_files too, so that identification, goto and
    passes use it. A source that is listed already keeps its place; one that has refused may be
    asked again.

    Groups of CelesTrak are geo, active, visual, gnss and so on; its supplemental elements, made
    of the owners' own orbits, are starlink, intelsat, ses, gps and so on. space-track:all needs
    an account, in the file catalogue.space_track_login. Amateurs' elements of classified
    satellites are named by their web address.

    Example: rsoconsole catalogue add supgp:intelsat celestrak:geo
    """
    from rsoconsole.pipeline import SourceStatus

    given = [_source_of(text) for text in source]
    settings = load_config(config, environ={})
    run = _run(load_config(config))
    there = _configured(settings)
    new = [each for each in given if each.text not in {one.text for one in there}]
    order = [*new, *there] if first else [*there, *new]
    # A file that cannot be read is not added.
    brought = {each.text: run.import_file(each) for each in given if each.file is not None}
    files = [str(path) for path in settings.catalogue.tle_files]
    if str(run.store.folder) not in files:
        files.append(str(run.store.folder))
    write_to_config(
        config,
        {"catalogue.sources": [each.text for each in order], "catalogue.tle_files": files},
        is_secret=any(each.words != each.text for each in order),  # an address with a password
    )
    run.store.set_sources(order)
    settings = load_config(config)
    for each in given:
        known = brought.get(each.text) or run.store.update_status(
            each, refused_utc_ns=None, fault=None
        )
        output.print_answer(
            json_, _row(each, known or SourceStatus(source=each.text), settings), _line
        )
    if any(each.file is None for each in given) and not json_:
        output.say(
            "'rsoconsole catalogue update' fetches them; a running engine reads them when"
            " it is started again"
        )


def _source_of(text: str) -> "ElementSource":
    """A source as people write it: a file and an address need no kind. Raises OrbitError."""
    from rsoconsole.pipeline import parse_source

    with value_errors_as(OrbitError):
        if text.startswith(("http://", "https://")):
            text = f"url:{text}"
        elif text.startswith(("~", "file:")) or Path(text).exists():
            text = f"file:{expand_home(text.removeprefix('file:')).resolve()}"
        return parse_source(text)


def _configured(settings: Config) -> "list[ElementSource]":
    from rsoconsole.pipeline import parse_source

    return [parse_source(text) for text in dict.fromkeys(settings.catalogue.sources)]


def _chosen(there: "list[ElementSource]", wanted: list[str]) -> "list[ElementSource]":
    if not there:
        raise OrbitError(
            "no source of elements: 'rsoconsole catalogue add celestrak:geo' names one"
            " (nothing is fetched unasked)"
        )
    if not wanted:
        return there
    known = {each.text: each for each in there}
    texts = [_source_of(text).text for text in wanted]
    missing = [without_secrets(text) for text in texts if text not in known]
    if missing:
        raise OrbitError(f"{missing[0]} is not among the sources: 'rsoconsole catalogue add' first")
    return [known[text] for text in texts]


def _run(settings: Config, wait: Callable[[], None] = lambda: None) -> "SourceUpdater":
    from rsoconsole.pipeline import ElementStore, SourceUpdater

    catalogue = settings.catalogue
    return SourceUpdater(
        store=ElementStore(),
        celestrak_url=catalogue.celestrak_url,
        space_track_url=catalogue.space_track_url,
        space_track_login=catalogue.space_track_login,
        wait=wait,
    )


def _wait_while_slewing(socket: Path | None) -> None:
    """Wait until the running engine's mount stands; not at all without one. Raises OrbitError."""
    from rsoconsole.control import ControlClient, Sender, ask_status

    deadline = time.monotonic() + SLEW_WAIT_S
    while True:
        try:
            status = ask_status(ControlClient(socket, sender=Sender(name="status")))
        except ControlError:
            return
        if not status.is_slewing and status.slew_left_s is None:
            return
        if time.monotonic() > deadline:
            raise OrbitError(
                f"the mount slews for {SLEW_WAIT_S / 60:.0f} min: nothing is fetched meanwhile,"
                " run it again later"
            )
        time.sleep(_POLL_S)


def _row(source: "ElementSource", kept: "SourceStatus", settings: Config) -> dict[str, Any]:
    from rsoconsole.pipeline import default_folder

    now_utc_ns, folder = time.time_ns(), default_folder()
    next_utc = None
    if kept.refused_utc_ns is None and source.file is None:
        next_utc = utc_ns_to_iso(max(kept.due_utc_ns(now_utc_ns), now_utc_ns), 0)
    return {
        **_kept_row(kept),
        "source": source.words,  # without the password of an address
        "next_utc": next_utc,
        "in_use": kept.file is not None and folder in settings.catalogue.tle_files,
        "path": None if kept.file is None else folder / kept.file,
    }


def _file_row(path: Path) -> dict[str, Any]:
    """Row of a file that the configuration names itself."""
    from rsoconsole.pipeline import SourceStatus, element_figures, read_catalogue

    try:
        figures: Any = element_figures(read_catalogue([path]))
        kept = SourceStatus(source=str(path), **figures)
    except OrbitError as error:
        kept = SourceStatus(source=str(path), fault=str(error))
    return {**_kept_row(kept), "next_utc": None, "in_use": kept.fault is None, "path": path}


def _kept_row(kept: "SourceStatus") -> dict[str, Any]:
    now_utc_ns = time.time_ns()

    def hours(t_utc_ns: int | None) -> float | None:
        return None if t_utc_ns is None else round((now_utc_ns - t_utc_ns) / NS_PER_HOUR, 2)

    ages = {"age_h": kept.fetched_utc_ns, "middle_age_h": kept.middle_epoch_utc_ns}
    return {
        **output.with_unit_keys(kept),
        **{name: hours(t_utc_ns) for name, t_utc_ns in ages.items()},
    }


def _line(row: dict[str, Any]) -> str:
    from rsoconsole.orbits import not_used_words

    words = [f"{row['source']:28} {row['objects']:>7,} objects"]
    if row["age_h"] is not None:
        words.append(f"fetched {row['age_h']:.1f} h ago")
    if row["middle_age_h"] is not None:
        words.append(f"half of its elements younger than {row['middle_age_h'] / 24:.1f} d")
    if row["objects"] == 0 and row["fault"] is None and row["refused_utc"] is None:
        words.append("not fetched yet")
    if row["refused_utc"]:
        words.append(f"REFUSED {row['refused_utc'][:19]}Z")
    elif row["fault"]:
        words.append(f"last time: {row['fault']}")
    if row["objects"] and not row["in_use"]:
        words.append("not in catalogue.tle_files, so not used")
    if row["not_used"]:
        words.append(not_used_words(row["sets"], [each["words"] for each in row["not_used"]]))
    return "  ".join(words[:1]) + ("; " + "; ".join(words[1:]) if words[1:] else "")
