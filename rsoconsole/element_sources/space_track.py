"""Space-Track's account: in a file of its own that nobody else can read, never in a message."""

from pathlib import Path

from rsoconsole.element_sources.fetch import Fetcher, FetchError
from rsoconsole.errors import OrbitError
from rsoconsole.foreign_text import read_private

NEEDED = (
    "write your Space-Track user name and password as two lines of a file, 'chmod 600' it, and name"
    " it in catalogue.space_track_login"
)


def read_login(path: Path | None) -> tuple[str, str]:
    """User name and password. Raises OrbitError with what to do; neither is ever in it."""
    if path is None:
        raise OrbitError(f"Space-Track wants an account: {NEEDED}")
    lines = read_private(path, OrbitError, NEEDED)
    if len(lines) != 2:
        raise OrbitError(f"{path} has {len(lines)} lines: {NEEDED}")
    return lines[0], lines[1]


def fetch_with_login(url: str, base_url: str, login: tuple[str, str], deadline_s: float) -> bytes:
    """One query under an account. Raises FetchError; a failed login counts as a refusal."""
    fetcher = Fetcher(deadline_s=deadline_s, is_bound=True)
    answer = fetcher.get(
        f"{base_url.rstrip('/')}/ajaxauth/login",
        form={"identity": login[0], "password": login[1]},
    )
    if b"failed" in answer[:200].lower():
        raise FetchError("Space-Track does not accept the account", "refused")
    return fetcher.get(url)
