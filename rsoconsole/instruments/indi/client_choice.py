"""Chooses the INDI client library: the configured one, or the first that is installed."""

import importlib.metadata
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rsoconsole.base import InstrumentError

if TYPE_CHECKING:
    from rsoconsole.instruments.indi.indi_client import IndiClient, Vector

ANY_CLIENT = "or set indi.client to auto"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientLibrary:
    """One Python library that speaks INDI."""

    name: str
    """Value of the setting ``indi.client`` that selects it."""
    module: str
    package: str
    install: str

    @property
    def is_installed(self) -> bool:
        """True when its module is installed; loading it may still fail."""
        return importlib.util.find_spec(self.module) is not None

    @property
    def title(self) -> str:
        """Name of the package, with its version."""
        try:
            return f"{self.package} {importlib.metadata.version(self.package)}"
        except importlib.metadata.PackageNotFoundError:
            return self.package


LIBRARIES = (
    ClientLibrary(
        name="pyindi",
        module="PyIndi",
        package="pyindi-client",
        install="pip install --no-deps pyindi-client",
    ),
    ClientLibrary(
        name="indipyclient",
        module="indipyclient",
        package="indipyclient",
        install="pip install indipyclient",
    ),
)
"""Known libraries, in the order in which the setting ``auto`` prefers them."""


def client_library(setting: str) -> ClientLibrary:
    """Return the library that the setting ``indi.client`` selects here.

    Raises InstrumentError where it is not installed.
    """
    for library in allowed_libraries(setting):
        if library.is_installed:
            return library
    raise InstrumentError(_missing(setting))


def open_client(
    setting: str,
    device: str,
    on_vector: "Callable[[Vector], None]",
    on_message: Callable[[str], None] | None = None,
) -> "tuple[IndiClient, ClientLibrary]":
    """Open a client by the first allowed library that loads; return it with that library.

    ``setting``: value of ``indi.client``. Raises InstrumentError where no library loads.
    """
    fault: ImportError | None = None
    for library in allowed_libraries(setting):
        try:
            return _maker(library)(device, on_vector, on_message), library
        except ImportError as error:
            fault = fault or error
    raise InstrumentError(f"{_missing(setting)} ({fault})") from fault


def allowed_libraries(setting: str) -> tuple[ClientLibrary, ...]:
    """Return the libraries that the setting ``indi.client`` allows, in order of preference."""
    return LIBRARIES if setting == "auto" else tuple(x for x in LIBRARIES if x.name == setting)


def _maker(library: ClientLibrary) -> "type[IndiClient]":
    if library.name == "pyindi":
        from rsoconsole.instruments.indi._pyindi_client import PyIndiClient

        return PyIndiClient
    from rsoconsole.instruments.indi._indipyclient_client import IndipyClient

    return IndipyClient


def _missing(setting: str) -> str:
    meant = allowed_libraries(setting)
    if setting == "auto":
        return f"no INDI client is installed here: '{meant[-1].install}'"
    return (
        f"indi.client is '{setting}', but {meant[0].package} is not installed here or does not "
        f"load: '{meant[0].install}', {ANY_CLIENT}"
    )
