"""``rso.lightcurve``: light curve of a track, with period and glints."""

from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.base import InputError, SessionError
from rsoconsole.library.formats.tables import to_astropy_time
from rsoconsole.library.notebook.session import Session, open_session
from rsoconsole.night import (
    Glint,
    LightPeriod,
    LightPoints,
    PeriodSearch,
    TrackLight,
    light_of_track,
    tracks_with_light,
)
from rsoconsole.records import Band, FloatArray

if TYPE_CHECKING:
    from astropy.time import Time
    from matplotlib.figure import Figure


class LightCurve:
    """Light curve of one track; made by ``rso.lightcurve``.

    Arrays have the shape (points,), a point a streak, in order of time; ``steps`` has the light
    along the streaks.
    """

    def __init__(self, session: Session, found: TrackLight) -> None:
        self._session = session
        self._found = found

    @property
    def track(self) -> int:
        """Number of the track."""
        return self._found.track.number

    @property
    def name(self) -> str | None:
        """Name of the object in the catalogue; None unless it is identified."""
        return self._found.track.name

    @property
    def band(self) -> Band:
        """Band of the magnitudes: "V", or "instrumental" where no star gave a zero point."""
        return self._found.curve.band

    @property
    def time(self) -> "Time":
        """Mid-exposure of each streak, UTC."""
        found: Time = to_astropy_time(self._found.curve.points.t_utc_ns)
        return found

    @property
    def mag(self) -> FloatArray:
        """Apparent magnitudes; NaN where no light is left above noise."""
        return self._found.curve.points.mag

    @property
    def mag_sigma(self) -> FloatArray:
        """One sigma of ``mag`` by noise and zero point, without the object's unknown colour."""
        return self._found.curve.points.mag_sigma

    @property
    def frames(self) -> Any:
        """Number of the frame of each streak."""
        return self._found.curve.points.frame_ids

    @property
    def points(self) -> LightPoints:
        """All of the streaks: times as UTC nanoseconds, magnitudes, relative light, flags."""
        return self._found.curve.points

    @property
    def steps(self) -> LightPoints:
        """Light along the streaks, each step at its own time; empty where it is not known."""
        return self._found.curve.steps

    @property
    def period(self) -> LightPeriod | None:
        """Period with its sigma, half and double; None where noise may have made it."""
        return self._found.search.period

    @property
    def search(self) -> PeriodSearch:
        """Search for the period: false-alarm probability, shortest and longest period searched."""
        return self._found.search

    @property
    def glints(self) -> tuple[Glint, ...]:
        """Short brightenings far above the rest, in order of time."""
        return self._found.glints

    @property
    def found(self) -> TrackLight:
        """All of it, as the verb ``lightcurve`` prints it."""
        return self._found

    def plot(self, figure: Any = None) -> "Figure":
        """Plot magnitude against time, and by the phase of the period where there is one.

        ``figure``: an empty matplotlib figure; None: a new one.
        """
        return self._session.plot_lightcurve(figure, track=self.track)

    def __repr__(self) -> str:
        period = self.period
        words = "no period" if period is None else f"period {period.period_s:.6g} s"
        return f"<LightCurve of track {self.track}, {len(self.points)} streaks, {words}>"


def lightcurve(session: Session | str | PathLike[str], track: int | None = None) -> LightCurve:
    """Return the light curve of a track of a session, with its period and glints.

    ``session``: a session or its folder; ``track``: number of the track; None: the track with the
    most streaks that have a brightness. Raises InputError for a track that is not there, and
    SessionError where no brightness is on record.

    >>> rso.lightcurve("sessions/intelsat-14").period
    """
    night = session if isinstance(session, Session) else open_session(Path(session))
    frames, known = night.night_frames, night.tracks
    if track is not None and track not in known:
        numbers = ", ".join(map(str, known)) or "none"
        raise InputError(f"there is no track {track}: there are {numbers}")
    numbers_lit = [*tracks_with_light(frames)]
    chosen = track if track is not None else next(iter(numbers_lit), None)
    found = None if chosen is None else light_of_track(frames, chosen)
    if found is None:
        of = "any track" if track is None else f"track {track}"
        raise SessionError(
            f"{night.title}: no brightness of {of} is on record; 'rsoconsole process' with"
            " --session measures it again from the frames"
        )
    return LightCurve(night, found)
