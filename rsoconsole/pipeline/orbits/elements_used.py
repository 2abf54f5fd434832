"""Which element files a session is identified by, where nobody names them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.errors import OrbitError, SessionError
from rsoconsole.session.reading import SessionReader

NO_ELEMENTS = (
    "no catalogue: name element sets with {}, or in catalogue.tle_files of the configuration"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementsUsed:
    """The files, and whether they are those of the session."""

    files: tuple[Path, ...]
    is_recorded: bool
    """They are those that the session was recorded with, not the configuration's."""


def elements_used(path: Path, configured: Sequence[Path], option: str) -> ElementsUsed:
    """The configuration's; of a simulated night, or without any, those that the session began with.

    Raises OrbitError with the remedy, the caller's option or the setting, where there are none.
    """
    own, is_simulated = _of_session(path)
    there = tuple(file for file in own if file.exists())
    if there and (is_simulated or not configured):
        return ElementsUsed(files=there, is_recorded=True)
    if configured:
        return ElementsUsed(files=tuple(configured), is_recorded=False)
    gone = f"; the session had {', '.join(map(str, own))}, which is no more there" if own else ""
    raise OrbitError(NO_ELEMENTS.format(option) + gone)


def _of_session(path: Path) -> tuple[tuple[Path, ...], bool]:
    """The element files that a session began with, and whether it was simulated."""
    if not path.is_dir():
        return (), False  # a file of observations
    try:
        reader = SessionReader(path)
        is_simulated = reader.about().get("is_simulated") is True
        return reader.config().catalogue.tle_files, is_simulated
    except SessionError:
        return (), False  # reading its directions says what is wrong with it
