"""Verbs that prepare a computer: doctor, config, index, alerts."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rsoconsole.base import ConfigError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.batch_options import byte_progress
from rsoconsole.cli.words.options import ConfigOption, JsonOption
from rsoconsole.config import APP, default_config_path, load_config
from rsoconsole.words import count_words

if TYPE_CHECKING:
    from rsoconsole.config import Setting
    from rsoconsole.engine import CheckResult

config_app = typer.Typer(
    no_args_is_help=True, help="The effective configuration: show, init, check."
)
alerts_app = typer.Typer(
    no_args_is_help=True, help="Messages to the operator's telephone and mail: test."
)
index_app = typer.Typer(no_args_is_help=True, help="Plate-solver index files: list, install.")


def doctor(
    config: ConfigOption = None,
    json_: JsonOption = False,
    bench: Annotated[
        bool, typer.Option("--bench", help="Measure this machine instead; half a minute.")
    ] = False,
) -> None:
    """Check this machine: model, index files, INDI server, clock, power, disk, terminal.

    Exit 1 when a check fails. With --bench a simulated frame goes through every stage of a night,
    and the times say which exposure and cadence this machine can hold; exit 1 where it cannot
    hold the configured ones. The camera's own transfer time is not included. --bench --json
    prints one object of kind "machine", one of kind "stage" for each (stage, median_ms, least_ms,
    largest_ms, repeats), and one of kind "verdict" (is_held, shortest_cadence_s, night_mb and so
    on, ok).
    Example: rsoconsole doctor --json
    """
    if bench:
        from rsoconsole.cli.demo.bench import run_bench

        run_bench(load_config(config), json_=json_)
        return
    from rsoconsole.engine import run_checks

    failed = 0
    for check in run_checks(load_config(config)):
        failed += check.ok is False
        output.print_answer(json_, check, _check_lines)
    output.exit_if(failed, f"{count_words(failed, 'check')} failed; each says what to do")


def _check_lines(check: "CheckResult") -> Iterator[str]:
    mark = {True: "ok  ", False: "FAIL", None: "?   "}[check.ok]
    yield f"{mark} {check.check:16} {check.detail}"
    if not check.ok and check.remedy:
        yield f"     {'':16} {check.remedy}"


@config_app.command("show")
def config_show(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """Show every setting in force, and where its value comes from.

    An option takes precedence over an environment variable (RSOCONSOLE_SITE__LATITUDE_DEG=51.5),
    that over the file, and the file over the default. A list in a variable is one value, or JSON.

    Example: rsoconsole config show
    """
    from rsoconsole.config import effective_settings

    for setting in effective_settings(config):
        output.print_answer(json_, setting, _setting_line)


def _setting_line(setting: "Setting") -> str:
    value = "-" if setting.value is None else setting.value
    origin = setting.variable or setting.origin
    return f"{setting.name:30} {value!s:24} {origin:12} {setting.description}"


@config_app.command("init")
def config_init(
    path: Annotated[Path | None, typer.Argument(help="Default: your configuration folder.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
) -> None:
    """Write a commented configuration file with every setting and its default.

    Example: rsoconsole config init
    """
    from rsoconsole.config import write_initial_config

    output.say(f"wrote {write_initial_config(path, force=force)}")


@config_app.command("check")
def config_check(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """List everything that is wrong with the configuration, each fault with its remedy.

    Example: rsoconsole config check --config night.toml
    """
    from rsoconsole.config import config_faults

    faults = config_faults(config)
    for fault in faults:
        output.print_answer(json_, fault, lambda f: f"{f.name or 'file'}: {f.problem}: {f.remedy}")
    output.exit_if(len(faults), f"{count_words(len(faults), 'fault')} in the configuration")
    if not json_:
        output.say(*valid_config_lines(config))


def valid_config_lines(config: Path | None) -> list[str]:
    """Return lines on a valid configuration file, or on the defaults where there is no file."""
    path = config or default_config_path()
    if path.exists():
        return [f"{path}: the configuration is sound"]
    settings = load_config(config)
    site, optics, indi = settings.site, settings.optics, settings.indi
    return [
        f"there is no configuration file: {path} does not exist, and the defaults hold",
        f"  site    {site.name}, latitude {site.latitude_deg:g}, longitude {site.longitude_deg:g}",
        f"  optics  {optics.focal_length_mm:g} mm, {optics.pixel_um:g} µm,"
        f" {optics.width_px} x {optics.height_px} px",
        f"  INDI    {indi.host}:{indi.port}, {indi.mount}, {indi.camera}",
        "'rsoconsole config init' writes a file to change them in",
    ]


@index_app.command("list")
def index_list(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """List the index files found, and the series that the configured field needs.

    Example: rsoconsole index list
    """
    from rsoconsole.instruments import folders_to_search, list_index_files, needed_tycho_numbers

    settings = load_config(config)
    needed = needed_tycho_numbers(settings.optics.field_deg)
    for file in list_index_files(folders_to_search(settings.solver.index_dirs)):
        is_needed = file.scale in needed
        if json_:
            output.emit_json(file, is_needed=is_needed)
            continue
        cover = f"Dec {file.dec_deg[0]:+.0f} to {file.dec_deg[1]:+.0f}"
        note = file.fault or ("needed" if is_needed else "")
        size = f"{file.size_bytes / 1e6:6.1f} MB"
        output.say(f"{file.scale or '?':>4}  {cover:18} {size}  {note:8} {file.path}")
    if not json_:
        output.say(f"your field needs scales {', '.join(str(n) for n in needed)}")


@index_app.command("install")
def index_install(
    from_: Annotated[
        Path | None,
        typer.Option("--from", help="Folder with index files or unpacked Debian packages."),
    ] = None,
    scale: Annotated[
        list[int] | None, typer.Option(help="Numbers of the series; default: what the field needs.")
    ] = None,
    config: ConfigOption = None,
) -> None:
    """Install the index files that the configured field of view needs.

    Example: rsoconsole index install --from /usr/share/astrometry
    """
    from rsoconsole.instruments import install_index_files, needed_tycho_numbers

    settings = load_config(config)
    wanted = tuple(scale) if scale else needed_tycho_numbers(settings.optics.field_deg)
    with byte_progress() as report:
        installed = install_index_files(wanted, from_dir=from_, progress=report)
    for file in installed:
        output.say(f"{file.scale}  {file.size_bytes / 1e6:.1f} MB  {file.path}")


@alerts_app.command("test")
def send_test_alert(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """Send a test message by each service of [alerts], and call the heartbeat once.

    Exit 1 where one of them fails. --json: `service, ok, detail`, one object a service.

    Example: rsoconsole alerts test
    """
    from rsoconsole.engine import send_heartbeat, send_within, services_of

    settings = load_config(config)
    if not settings.alerts.is_configured:
        raise ConfigError(
            'no service is configured: write alerts.services = ["ntfy://TOPIC"] into the'
            " configuration, with a topic of your own"
        )
    title = f"rsoconsole {settings.site.name}: test"
    body = "a test: word reaches you"
    with _only_own_messages():
        results = [
            (each.name, send_within(each.url, title, body)) for each in services_of(settings.alerts)
        ]
    if settings.alerts.heartbeat_url:
        results.append(("heartbeat", send_heartbeat(settings.alerts.heartbeat_url)))
    for name, done in results:
        if json_:
            output.emit_json({"service": name, "ok": done.ok, "detail": done.detail})
        else:
            output.say(f"{'ok  ' if done.ok else 'FAIL'} {name:16} {done.detail}")
    failed = sum(not done.ok for _, done in results)
    output.exit_if(failed, f"{count_words(failed, 'service')} did not take it; each says why")


@contextlib.contextmanager
def _only_own_messages() -> Iterator[None]:
    """Keep messages of apprise and its libraries out of the log: they may hold an address."""
    handlers, own = list(logging.getLogger().handlers), logging.Filter(APP)
    for handler in handlers:
        handler.addFilter(own)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(own)
