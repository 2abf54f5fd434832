"""What ``rso.track`` gives: tracks by number, each with its tables."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING

from rsoconsole.errors import InputError
from rsoconsole.library.columns import table_of
from rsoconsole.library.measuring import SIGMAS
from rsoconsole.library.observations import META, sigmas_of
from rsoconsole.night import NightTrack
from rsoconsole.records import Identified, Measurement, OrbitEstimate, Record, Site

if TYPE_CHECKING:
    from astropy.table import QTable
    from astropy.units import Quantity

_TABLES = ("measurements", "track", "not_followed", "misses", "orbits", "identifications")


class Track:
    """One object over the frames: what it was measured at, how it was followed."""

    def __init__(self, *, site: Site, found: NightTrack) -> None:
        self._found = found
        self.site = site
        """Where it was seen from."""

    @property
    def number(self) -> int:
        """From 1, in the order in which tracks began."""
        return self._found.number

    @property
    def measurements(self) -> "QTable":
        """Those that it took, in order of time; as ``rso.measure`` has them."""
        rows = self._found.measurements
        more = [
            dict(zip((c.name for c in SIGMAS[:3]), sigmas_of(m.cov_sky_arcsec2), strict=True))
            for m in rows
        ]
        meta = {"track": self.number, META: {"site": asdict(self.site)}}
        return table_of("measurements", rows, meta, extra=SIGMAS[:3], more=more)

    @property
    def states(self) -> "QTable":
        """The filter's states with their covariance (4, 4), innovations and NIS."""
        return table_of("track", self._found.states, {"track": self.number})

    @property
    def orbit(self) -> OrbitEstimate | None:
        """The last orbit while it was followed; ``rso.orbit`` finds it again with all the rest."""
        return self._found.orbit

    @property
    def identified(self) -> Identified | None:
        """The last name while it was followed, where the configuration names a catalogue."""
        return self._found.identified

    @property
    def missed(self) -> Mapping[int, str]:
        """Frames that did not show it, by their numbers, and why."""
        return self._found.missed

    @property
    def ended(self) -> str:
        """What ended it, in words; empty: it was followed to the last frame."""
        return self._found.ended

    @property
    def residual_rms(self) -> "Quantity | None":
        """Of measured minus predicted, on the sky; None without an update."""
        from astropy import units

        rms = self._found.quality.residual_rms_arcsec
        return None if rms is None else rms * units.arcsec

    @property
    def nis_mean(self) -> float | None:
        """Normalised innovation squared, 2 on average where the errors are as stated."""
        return self._found.quality.nis_mean

    @property
    def taken(self) -> tuple[Measurement, ...]:
        """The measurements as records."""
        return self._found.measurements

    def __len__(self) -> int:
        return len(self._found.measurements)

    def __repr__(self) -> str:
        rms = self._found.quality.residual_rms_arcsec
        words = "" if rms is None else f', residual rms {rms:.2f}"'
        ended = f", ended: {self.ended}" if self.ended else ""
        return f"<Track {self.number}: {len(self)} measurements{words}{ended}>"


class Tracks(dict[int, Track]):
    """Tracks by number; with everything that was decided on the way."""

    def __init__(self, tracks: Mapping[int, Track], records: tuple[Record, ...]) -> None:
        super().__init__(tracks)
        self.records = records
        """All of it in order, as a session's log has it."""

    def table(self, name: str) -> "QTable":
        """One of a session's tables over all tracks, e.g. ``"misses"`` or ``"not_followed"``.

        Raises InputError for a name that there is not.
        """
        if name not in _TABLES:
            raise InputError(f"there is no table {name!r}; there are {', '.join(_TABLES)}")
        return table_of(name, self.records, {"table": name})
