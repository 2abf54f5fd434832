"""``rsoconsole alerts``: whether word reaches the operator."""

import contextlib
import logging
from collections.abc import Iterator

import typer

from rsoconsole.base import ConfigError
from rsoconsole.cli.words import output
from rsoconsole.cli.words.options import ConfigOption, JsonOption
from rsoconsole.config import APP, load_config
from rsoconsole.words import counted

alerts_app = typer.Typer(
    no_args_is_help=True, help="Messages to the operator's telephone and mail: test."
)


@alerts_app.command("test")
def send_test(config: ConfigOption = None, json_: JsonOption = False) -> None:
    """Send a message by each service of [alerts], and call the heartbeat once.

    Exit 1 where one of them does not take it. --json: `service, ok, detail`, one object a service.

    Example: rsoconsole alerts test
    """
    from rsoconsole.engine import call, send_within, services_of

    settings = load_config(config)
    if not settings.alerts.is_wanted:
        raise ConfigError(
            'no service is configured: write alerts.services = ["ntfy://TOPIC"] into the'
            " configuration, with a topic of your own"
        )
    title = f"rsoconsole {settings.site.name}: test"
    body = "a test: word reaches you"
    with _own_words_alone():
        results = [
            (each.name, send_within(each.url, title, body)) for each in services_of(settings.alerts)
        ]
    if settings.alerts.heartbeat_url:
        results.append(("heartbeat", call(settings.alerts.heartbeat_url)))
    for name, done in results:
        if json_:
            output.emit_json({"service": name, "ok": done.ok, "detail": done.detail})
        else:
            output.say(f"{'ok  ' if done.ok else 'FAIL'} {name:16} {done.detail}")
    failed = sum(not done.ok for _, done in results)
    output.exit_where(failed, f"{counted(failed, 'service')} did not take it; each says why")


@contextlib.contextmanager
def _own_words_alone() -> Iterator[None]:
    """Nothing that apprise and its libraries say is logged: it may hold an address."""
    handlers, own = list(logging.getLogger().handlers), logging.Filter(APP)
    for handler in handlers:
        handler.addFilter(own)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(own)
