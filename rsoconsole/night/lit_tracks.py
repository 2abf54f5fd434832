"""Brightness of a night's tracks: light curve, period and glints of each. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.night.frame import NightFrame
from rsoconsole.night.glints import Glint, glints_of
from rsoconsole.night.light_curve import LightCurve, light_curve_of
from rsoconsole.night.light_period import PeriodSearch, find_period
from rsoconsole.night.tracks import NightTrack, tracks_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackLight:
    """Light curve of one track with its period and glints."""

    track: NightTrack
    curve: LightCurve
    search: PeriodSearch
    """Result of the search for a period."""
    glints: tuple[Glint, ...]

    @property
    def mag(self) -> float | None:
        """Median magnitude of its streaks; None where none has a magnitude."""
        known = self._known()
        return float(np.median(known)) if known.size else None

    @property
    def brightest_mag(self) -> float | None:
        """Magnitude of its brightest streak; None where none has a magnitude."""
        known = self._known()
        return float(known.min()) if known.size else None

    @property
    def faintest_mag(self) -> float | None:
        """Magnitude of its faintest streak; None where none has a magnitude."""
        known = self._known()
        return float(known.max()) if known.size else None

    def _known(self) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
        mag = self.curve.points.mag
        return mag[np.isfinite(mag)]


def tracks_with_light(frames: Sequence[NightFrame]) -> dict[int, LightCurve]:
    """Return the light curves of a night's tracks that have brightness on record, by number.

    That of the most streaks comes first; of equal ones that of the lower number.
    """
    found = {
        number: curve
        for number, track in tracks_of(frames).items()
        if (curve := light_curve_of(frames, track)) is not None
    }
    return dict(sorted(found.items(), key=lambda each: (-len(each[1].points), each[0])))


def light_of_track(frames: Sequence[NightFrame], track_id: int) -> TrackLight | None:
    """Return light curve, period and glints of a track; None where no brightness is on record."""
    track = tracks_of(frames).get(track_id)
    curve = None if track is None else light_curve_of(frames, track)
    if track is None or curve is None:
        return None
    return TrackLight(track=track, curve=curve, search=find_period(curve), glints=glints_of(curve))
