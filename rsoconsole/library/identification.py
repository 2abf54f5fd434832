"""``rso.identify``: which catalogued object was observed."""

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, Unpack, overload

import numpy as np

from rsoconsole.base import InputError, OrbitError
from rsoconsole.config import CatalogueConfig
from rsoconsole.library._given import ConfigLike, Number, Place, in_unit, resolve_config
from rsoconsole.library._observations import TableLike
from rsoconsole.library._observed import CallerValues, Observations, read_observation_groups
from rsoconsole.library.known_orbit import Orbit
from rsoconsole.library.notebook.session import Session
from rsoconsole.library.tracking import Track, Tracks
from rsoconsole.night import NightTrack
from rsoconsole.orbits import (
    ElementSets,
    MeasuredDirections,
    UnusedSet,
    identify_jointly,
    parse_element_sets,
)
from rsoconsole.orbits import Identification as Found
from rsoconsole.pipeline import (
    catalogue_errors,
    choose_element_files,
    identification_report,
    longest_arc,
    read_catalogue,
)
from rsoconsole.records import Site

if TYPE_CHECKING:
    from astropy.table import QTable

Verdict = Literal["identified", "ambiguous", "unknown"]


class Identification:
    """Result of the identification of one track; differences are measured minus predicted."""

    def __init__(
        self, found: Found, seen: MeasuredDirections, not_used: tuple[UnusedSet, ...] = ()
    ) -> None:
        self._found = found
        self._seen = seen
        self.not_used = not_used
        """Element sets of the files that could not be used, each with its reason."""

    @property
    def verdict(self) -> Verdict:
        """Result: "identified" (with a probability of 95 % or more), "ambiguous" or "unknown"."""
        return self._found.verdict

    @property
    def name(self) -> str | None:
        """Name of the object; None unless it is identified."""
        return self._found.matches[0].name if self.verdict == "identified" else None

    @property
    def norad_id(self) -> int | None:
        """Catalogue number of the object; None unless it is identified."""
        return self._found.matches[0].norad_id if self.verdict == "identified" else None

    @property
    def probability(self) -> float | None:
        """Probability that the track is the identified object; None unless it is identified."""
        return self._found.matches[0].probability if self.verdict == "identified" else None

    @property
    def not_catalogued(self) -> float:
        """Probability that the observed object is in no catalogue."""
        return self._found.not_catalogued

    @property
    def reason(self) -> str:
        """Reason for the result, in words."""
        return self._found.reason

    @property
    def hint(self) -> str:
        """Sentence on a possible manoeuvre; empty where nothing suggests one."""
        return self._found.hint

    @property
    def catalogued(self) -> int:
        """Number of catalogued objects that were compared with the track."""
        return self._found.catalogued

    @property
    def matches(self) -> "QTable":
        """Table of the nearest catalogued objects, best first, at the middle of the directions.

        ``norad_id``, ``name``: the object.
        ``separation``: angle between measured and predicted direction.
        ``along_track``: positive where the object is ahead of its elements.
        ``cross_track``: positive to the north for an object that moves east.
        ``along_track_time``: ``along_track`` as a time, positive where the object is early.
        ``rate_difference``: of the angular speed; NaN where a single direction gives no rate.
        ``elements_epoch``: epoch of the object's elements.
        ``elements_age``: age of the elements at the directions; negative where they are newer.
        ``score``: Mahalanobis distance of measured from predicted, sigma.
        ``probability``: that the track is this object.
        ``is_within_gate``: True where the object is within the gate.
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
        """Return the report that ``rsoconsole identify --json`` gives on this track."""
        arc_s = float(self._seen.t_s[-1] - self._seen.t_s[0])
        return identification_report(self.name or "", self._found, arc_s)

    def __repr__(self) -> str:
        if self.name is None:
            return f"<Identification {self.verdict}: {self.reason}>"
        return (
            f"<Identification {self.name} ({self.norad_id}), {100 * (self.probability or 0):.1f} %>"
        )


ElementsLike: TypeAlias = str | PathLike[str] | Sequence[str | PathLike[str]]
"""Paths of files of element sets (TLE, OMM as XML, JSON, CSV, KVN), or the text of such a file."""


class IdentifyKeywords(TypedDict, total=False):
    """Keyword arguments of ``identify``."""

    tle: ElementsLike | None
    gate: Number
    track: int | None
    sigma: Number | None
    site: Place | None
    target: str | None
    radians: bool | None
    config: ConfigLike


@overload
def identify(
    observations: Orbit | Track | NightTrack | str | PathLike[str] | TableLike,
    **beside: Unpack[IdentifyKeywords],
) -> Identification: ...


@overload
def identify(
    observations: Tracks | Mapping[int, Track] | Mapping[int, NightTrack] | Session,
    **beside: Unpack[IdentifyKeywords],
) -> dict[int, Identification]: ...


def identify(
    observations: Orbit | Observations | Mapping[int, Track] | Mapping[int, NightTrack],
    *,
    tle: ElementsLike | None = None,
    gate: Number = 0.2,
    track: int | None = None,
    sigma: Number | None = None,
    site: Place | None = None,
    target: str | None = None,
    radians: bool | None = None,
    config: ConfigLike = None,
) -> Identification | dict[int, Identification]:
    """Say which catalogued object was observed, as ``rsoconsole identify`` does.

    ``observations``: an orbit of ``rso.orbit`` (its directions are used), a track, a table of one
    object, a file, or a session's path; or all tracks of ``rso.track``, or a session of
    ``rso.open_session``. Several tracks are identified together, because one catalogued object can
    be only one of them.
    ``tle``: files of element sets (TLE; OMM as XML, JSON, CSV, KVN), or their text; None: the files
    of ``catalogue.tle_files`` in the configuration, or those that a session was recorded with.
    ``gate``: largest separation of an object from the track, degrees.
    ``track``: number of the only track to return, as ``night.tracks`` numbers them; None: the
    longest track of a path, all tracks of a session.
    ``sigma``, ``site``, ``target``, ``radians``, ``config``: as for ``rso.orbit``; ``config`` also
    gives the errors of the elements.

    Returns an ``rso.Identification``; for several tracks a dict of them by track number.
    "ambiguous" and "unknown" are results too. Element sets that cannot be used are in
    ``not_used`` of each.

    Raises OrbitError where no element set can be used, and for missing files; else as ``rso.orbit``
    does.

    >>> name = rso.identify(found, tle="catalogue.tle")
    >>> name.verdict, name.name, name.matches["name", "separation", "probability"]
    """
    gate_deg = in_unit(gate, "deg", "gate")
    if not 0.0 < gate_deg <= 5.0:
        raise InputError(f"gate: {gate_deg:g} deg must be above 0, and 5 at most")
    catalogue = resolve_config(config).catalogue
    sets = given_element_sets(tle, observations, catalogue)
    ask = CallerValues(sigma=sigma, site=site, target=target, radians=radians, config=config)
    seen, where, chosen = _seen(observations, ask, track)
    arcs = {name: longest_arc(each) for name, each in seen.items()}
    named = identify_jointly(
        list(arcs.values()),
        where,
        sets.entries,
        gate_deg=gate_deg,
        errors=catalogue_errors(catalogue),
    )
    found = {
        name: Identification(each, arc, sets.not_used)
        for (name, arc), each in zip(arcs.items(), named, strict=True)
    }
    return found if chosen is None else found[chosen]


def _seen(
    what: Any, ask: CallerValues, track: int | None
) -> tuple[dict[int, MeasuredDirections], Site, int | None]:
    """Directions by track, their site, and the track that answers; None: all."""
    if isinstance(what, Orbit):
        return {1: what.seen}, what.site, 1
    if isinstance(what, Mapping):
        if not what:
            raise InputError("no tracks: nothing was followed")
        groups = [read_observation_groups(each, ask)[0][0] for each in what.values()]
        numbers = list(what)
    else:
        # One station's, which has most.
        tracks = max(read_observation_groups(what, ask), key=lambda group: len(group[0].seen))
        groups = list(tracks)
        numbers = [each.number if each.track_id is None else each.track_id for each in tracks]
    seen = {n: each.seen for n, each in zip(numbers, groups, strict=True)}
    if track is not None and track not in seen:
        raise InputError(f"there is no track {track}: there are {', '.join(map(str, seen))}")
    is_many = isinstance(what, Mapping | Session)
    answers = None if is_many and track is None else (track or numbers[0])
    return seen, groups[0].site, answers


def given_element_sets(
    tle: ElementsLike | None, what: Any, catalogue: CatalogueConfig
) -> ElementSets:
    """Element sets that ``tle`` is; where None those configured, or of the session ``what``."""
    if isinstance(tle, str) and "\n" in tle:
        return parse_element_sets(tle, "the text")
    if isinstance(tle, str | PathLike):
        files = [Path(fspath(tle)).expanduser()]
    elif tle is not None and not isinstance(tle, Sequence):
        raise InputError(f"tle: {tle!r} is no file: give paths, or the text of element sets")
    elif tle is not None:
        files = [Path(fspath(each)).expanduser() for each in tle]
        if not files:
            raise OrbitError("no catalogue: the list of element files is empty")
    else:
        path = what.path if isinstance(what, Session) else Path()
        if isinstance(what, str | PathLike):
            path = Path(fspath(what)).expanduser()
        files = list(choose_element_files(path, catalogue.tle_files, "tle=").files)
    return read_catalogue(files)
