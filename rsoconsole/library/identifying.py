"""``rso.identify``: which catalogued object was seen."""

from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, Unpack, overload

from rsoconsole.config import CatalogueConfig
from rsoconsole.errors import InputError, OrbitError
from rsoconsole.library.given import ConfigLike, Number, Place, config_of, number
from rsoconsole.library.identification import Identification
from rsoconsole.library.known_orbit import Orbit
from rsoconsole.library.observations import TableLike
from rsoconsole.library.observed import Asked, Observations, groups_of
from rsoconsole.library.tracks import Track, Tracks
from rsoconsole.night import NightTrack
from rsoconsole.notebook import Session
from rsoconsole.orbits.elements import CatalogueEntry, parse_catalogue
from rsoconsole.orbits.first import Sightings
from rsoconsole.orbits.identification import identify_jointly
from rsoconsole.pipeline.orbits import elements_used, errors_of, longest_arc, read_catalogue
from rsoconsole.records import Site

ElementsLike: TypeAlias = str | PathLike[str] | Sequence[str | PathLike[str]]
"""Files of element sets (TLE, OMM as XML, JSON or CSV), or the text of one of them."""


class Beside(TypedDict, total=False):
    """What may be given beside observations."""

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
    **beside: Unpack[Beside],
) -> Identification: ...


@overload
def identify(
    observations: Tracks | Mapping[int, Track] | Mapping[int, NightTrack] | Session,
    **beside: Unpack[Beside],
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
    """Say which catalogued object was seen, as ``rsoconsole identify`` does.

    ``observations``: an orbit of ``rso.orbit`` (the directions that it is of), a track, a table
    of one object, a file, or a session's path; or all tracks of ``rso.track``, or a session of
    ``rso.open_session``: these are named together, because one catalogued object is one track.
    ``tle``: files of element sets (TLE; OMM as XML, JSON, CSV), or their text; None: those of
    ``catalogue.tle_files`` in the configuration, or those that a session was recorded with.
    ``gate``: how far off an object may be, degrees. ``track``: which of a session's tracks
    answers, as ``night.tracks`` numbers them; None: the longest of a path, all of a session.
    ``sigma``, ``site``, ``target``, ``radians``
    and ``config`` as ``rso.orbit`` has them; ``config`` also says how far elements may be off.

    Returns an ``rso.Identification``; of several tracks a dict of them by number. "ambiguous"
    and "unknown" are answers too.

    Raises OrbitError for element sets that cannot be read, or none; else as ``rso.orbit`` does.

    >>> name = rso.identify(found, tle="catalogue.tle")
    >>> name.verdict, name.name, name.matches["name", "separation", "probability"]
    """
    gate_deg = number(gate, "deg", "gate")
    if not 0.0 < gate_deg <= 5.0:
        raise InputError(f"gate: {gate_deg:g} deg must be above 0, and 5 at most")
    catalogue = config_of(config).catalogue
    entries = _entries(tle, observations, catalogue)
    ask = Asked(sigma=sigma, site=site, target=target, radians=radians, config=config)
    seen, where, chosen = _seen(observations, ask, track)
    arcs = {name: longest_arc(each) for name, each in seen.items()}
    named = identify_jointly(
        list(arcs.values()), where, entries, gate_deg=gate_deg, errors=errors_of(catalogue)
    )
    found = {
        name: Identification(each, arc)
        for (name, arc), each in zip(arcs.items(), named, strict=True)
    }
    return found if chosen is None else found[chosen]


def _seen(
    what: Any, ask: Asked, track: int | None
) -> tuple[dict[int, Sightings], Site, int | None]:
    """Directions by track, where they were seen from, and which track answers; None: all."""
    if isinstance(what, Orbit):
        return {1: what.seen}, what.site, 1
    if isinstance(what, Mapping):
        if not what:
            raise InputError("no tracks: nothing was followed")
        groups = [groups_of(each, ask)[0][0] for each in what.values()]
        numbers = list(what)
    else:
        # One station's, which has most.
        tracks = max(groups_of(what, ask), key=lambda group: len(group[0].seen))
        groups = list(tracks)
        numbers = [each.number if each.track_id is None else each.track_id for each in tracks]
    seen = {n: each.seen for n, each in zip(numbers, groups, strict=True)}
    if track is not None and track not in seen:
        raise InputError(f"there is no track {track}: there are {', '.join(map(str, seen))}")
    is_many = isinstance(what, Mapping | Session)
    answers = None if is_many and track is None else (track or numbers[0])
    return seen, groups[0].site, answers


def _entries(
    tle: ElementsLike | None, what: Any, catalogue: CatalogueConfig
) -> tuple[CatalogueEntry, ...]:
    if isinstance(tle, str) and "\n" in tle:
        return parse_catalogue(tle, "the text")
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
        files = list(elements_used(path, catalogue.tle_files, "tle=").files)
    return read_catalogue(files)
