"""Which catalogued object something is, and what else it might be; made by ``rso.identify``."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rsoconsole.orbits.first import Sightings
from rsoconsole.orbits.identification import Identification as Found
from rsoconsole.pipeline.words import identification_report

if TYPE_CHECKING:
    from astropy.table import QTable

Verdict = Literal["identified", "ambiguous", "unknown"]


class Identification:
    """The verdict on one track and what it rests on; measured minus predicted."""

    def __init__(self, found: Found, seen: Sightings) -> None:
        self._found = found
        self._seen = seen

    @property
    def verdict(self) -> Verdict:
        """ "identified" from a probability of 95 % on."""
        return self._found.verdict

    @property
    def name(self) -> str | None:
        """Of the object; None unless it is identified."""
        return self._found.matches[0].name if self.verdict == "identified" else None

    @property
    def norad_id(self) -> int | None:
        """Its catalogue number; None unless it is identified."""
        return self._found.matches[0].norad_id if self.verdict == "identified" else None

    @property
    def probability(self) -> float | None:
        """That it is this one; None unless it is identified."""
        return self._found.matches[0].probability if self.verdict == "identified" else None

    @property
    def not_catalogued(self) -> float:
        """Probability that no catalogue knows it."""
        return self._found.not_catalogued

    @property
    def reason(self) -> str:
        """What the verdict rests on."""
        return self._found.reason

    @property
    def hint(self) -> str:
        """Of a manoeuvre; empty as a rule."""
        return self._found.hint

    @property
    def catalogued(self) -> int:
        """Objects that it was compared with."""
        return self._found.catalogued

    @property
    def matches(self) -> "QTable":
        """The nearest objects, best first, at the middle of the directions.

        ``norad_id``, ``name``, ``separation``, ``along_track`` (positive: ahead of its elements),
        ``cross_track`` (positive: north of a motion to the east), ``along_track_time`` (how early
        it is), ``rate_difference`` (NaN where one direction tells no rate), ``elements_epoch``,
        ``elements_age`` (negative: younger than the directions), ``score`` (how many sigma off),
        ``probability``, ``is_within_gate``.
        """
        from astropy import units
        from astropy.table import QTable
        from astropy.time import Time

        from rsoconsole.sky import jd_utc

        found = self._found.matches

        def column(name: str) -> Any:
            return np.array([getattr(each, name) for each in found], float)

        table = QTable(meta={"verdict": self.verdict, "reason": self.reason})
        table["norad_id"] = np.array([each.norad_id for each in found], np.int64)
        table["name"] = np.array([each.name for each in found], str)
        table["separation"] = column("separation_arcsec") * units.arcsec
        table["along_track"] = column("along_track_arcsec") * units.arcsec
        table["cross_track"] = column("cross_track_arcsec") * units.arcsec
        table["along_track_time"] = column("along_track_s") * units.s
        table["rate_difference"] = column("rate_difference_percent") * units.percent
        epochs = np.array([each.tle_epoch_utc_ns for each in found], np.int64)
        table["elements_epoch"] = Time(*jd_utc(epochs), format="jd", scale="utc")
        table["elements_epoch"].format = "isot"
        table["elements_age"] = column("tle_age_days") * units.day
        table["score"] = column("score")
        table["probability"] = column("probability")
        table["is_within_gate"] = np.array([each.is_within_gate for each in found], bool)
        return table

    def report(self) -> dict[str, Any]:
        """What ``rsoconsole identify --json`` says of one track."""
        arc_s = float(self._seen.t_s[-1] - self._seen.t_s[0])
        return identification_report(self.name or "", self._found, arc_s)

    def __repr__(self) -> str:
        if self.name is None:
            return f"<Identification {self.verdict}: {self.reason}>"
        return (
            f"<Identification {self.name} ({self.norad_id}), {100 * (self.probability or 0):.1f} %>"
        )
