"""Which element files a session is identified by, where no option names them."""

from collections.abc import Sequence
from pathlib import Path

from rsoconsole.cli.words import output
from rsoconsole.errors import OrbitError, SessionError


def element_files(path: Path, configured: Sequence[Path]) -> list[Path]:
    """The configuration's; of a simulated night, or without any, those that the session began with.

    Raises OrbitError with the remedy where there are none.
    """
    own, is_simulated = _of_session(path)
    there = [file for file in own if file.exists()]
    if there and (is_simulated or not configured):
        named = ", ".join(map(str, there))
        output.complain(f"rsoconsole: by the elements that the session was recorded with: {named}")
        return there
    if configured:
        return list(configured)
    gone = f"; the session had {', '.join(map(str, own))}, which is no more there" if own else ""
    raise OrbitError(
        "no catalogue: name element sets with --tle FILE, or in catalogue.tle_files of the"
        f" configuration{gone}"
    )


def _of_session(path: Path) -> tuple[tuple[Path, ...], bool]:
    """The element files that a session began with, and whether it was simulated."""
    from rsoconsole.session.reading import SessionReader

    if not path.is_dir():
        return (), False  # a file of observations
    try:
        reader = SessionReader(path)
        is_simulated = reader.about().get("is_simulated") is True
        return reader.config().catalogue.tle_files, is_simulated
    except SessionError:
        return (), False  # reading its directions says what is wrong with it
