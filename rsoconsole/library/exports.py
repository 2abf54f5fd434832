"""``rso.to_udl`` and ``rso.to_score``: a session's brightness and directions for repositories."""

from os import PathLike, fspath
from pathlib import Path
from typing import TypeAlias

from rsoconsole.library.formats.api import ExportOptions, render
from rsoconsole.library.formats.score import ScoreDetector, ScoreOptions
from rsoconsole.library.formats.target import Target
from rsoconsole.library.formats.tdm import ORIGINATOR
from rsoconsole.library.notebook.session import Session

SessionLike: TypeAlias = str | PathLike[str] | Session
"""A session, or the path of its folder."""


def to_udl(
    session: SessionLike,
    *,
    track: int | None = None,
    norad: int | None = None,
    cospar: str | None = None,
    originator: str = ORIGINATOR,
) -> str:
    """Return what a session's tracks measured as JSON: EOObservation records of the UDL.

    ``track``: id of the only track to write; None: all. ``norad``, ``cospar``: catalogue number and
    international designator of its object; ``originator``: who makes the records. Nothing is
    uploaded. ``mag`` is Johnson V where the schema means Gaia G: the descriptor says so. Raises
    SessionError and ExportError.
    """
    options = ExportOptions(
        track=track, target=Target(norad_id=norad, cospar=cospar), originator=originator
    )
    return render(_path(session), "udl", options)[0]


def to_score(
    session: SessionLike,
    *,
    norad: int,
    observer_email: str,
    observer_orcid: str,
    detector: ScoreDetector,
    filter: str,  # noqa: A002 -- as the verb has it
    track: int | None = None,
) -> str:
    """Return a session's magnitudes in V as the CSV that SCORE of the IAU CPS takes.

    ``norad``: catalogue number of the object; ``observer_email``: where SCORE confirms;
    ``observer_orcid``: one or more, separated by commas; ``detector``: "CCD", "CMOS" or "OTHER";
    ``filter``: in front of the camera, "CLEAR" for none; ``track``: id of the track of that object
    where there are several. Measurements without a magnitude are left out. Nothing is uploaded.
    Raises SessionError and ExportError.
    """
    given = ScoreOptions(
        email=observer_email, orcid=observer_orcid, detector=detector, passband=filter
    )
    options = ExportOptions(track=track, target=Target(norad_id=norad), score=given)
    return render(_path(session), "score", options)[0]


def _path(session: SessionLike) -> Path:
    return session.path if isinstance(session, Session) else Path(fspath(session)).expanduser()
