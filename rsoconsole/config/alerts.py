"""Settings of the alerts: which events, by which services; addresses are secrets."""

import re
from pathlib import Path
from typing import Literal, TypeAlias, get_args
from urllib.parse import urlsplit

from pydantic import Field, field_serializer, field_validator

from rsoconsole.config.observatory import Section
from rsoconsole.config.source_names import expect_web_address

AlertKind: TypeAlias = Literal[
    "lock", "identification", "loss", "clouds", "limit", "fault", "dawn", "done"
]
ALERT_KINDS: tuple[AlertKind, ...] = get_args(AlertKind)
_SERVICE = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]*)://\S+")


class AlertsConfig(Section):
    """Messages to the operator's telephone, sent by a separate process."""

    services: tuple[str, ...] = Field(
        (),
        repr=False,
        description="addresses as apprise writes them, such as ntfy://TOPIC or tgram://TOKEN/CHAT;"
        " secret: never shown",
    )
    services_file: Path | None = Field(
        None, description="file with one such address a line, which only you can read"
    )
    events: tuple[AlertKind, ...] = Field(ALERT_KINDS, description="what is told")
    quiet_min: float = Field(
        10.0, ge=0, le=1440, description="two of a kind are at least so far apart; faults: the same"
    )
    most_per_hour: int = Field(20, ge=1, le=1000, description="of faults and limits as many beside")
    heartbeat_url: str = Field(
        "",
        repr=False,
        description="address that is called as long as the engine lives: who misses the calls"
        " (healthchecks.io and the like) raises the alarm; secret",
    )
    heartbeat_s: float = Field(300.0, ge=1, le=86400, description="from call to call")

    @property
    def is_configured(self) -> bool:
        """True where a service or a heartbeat is configured."""
        return bool(self.services or self.services_file or self.heartbeat_url)

    @field_validator("services")
    @classmethod
    def _services_are_addresses(cls, urls: tuple[str, ...]) -> tuple[str, ...]:
        for url in urls:
            expect_service_url(url)
        return urls

    @field_validator("heartbeat_url")
    @classmethod
    def _heartbeat_is_an_address(cls, url: str) -> str:
        if url:
            try:
                expect_web_address(url)
            except ValueError:
                raise ValueError("heartbeat_url is no address: write https://...") from None
        return url

    @field_serializer("services", when_used="json")
    def _services_without_secrets(self, urls: tuple[str, ...]) -> list[str]:
        """As sessions, logs and 'config show' carry them."""
        return [f"{service_scheme(url)}://..." for url in urls]

    @field_serializer("heartbeat_url", when_used="json")
    def _heartbeat_without_secrets(self, url: str) -> str:
        if not url:
            return ""
        parts = urlsplit(url)
        return f"{parts.scheme}://{parts.hostname}/..."


def expect_service_url(url: str) -> None:
    """Raise ValueError where ``url`` is no service's address; the message never quotes it."""
    if not _SERVICE.fullmatch(url):
        raise ValueError("a service is an address of apprise, such as ntfy://TOPIC")


def service_scheme(url: str) -> str:
    """Return the scheme of a service's address, the only part that is not secret."""
    return url.partition(":")[0].lower()
