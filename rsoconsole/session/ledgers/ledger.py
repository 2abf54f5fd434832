"""Ledger of tracks that no catalogue explains, kept across nights in the user's state folder.

One file of lines that is only ever added to (``line_file``): an added track, a new name, a
forgotten object; the present state is a fold over them. A track that is added again (by session and
track id) replaces itself.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError
from rsoconsole.config import state_dir
from rsoconsole.session.log.codec import from_json_value
from rsoconsole.session.log.line_file import Change, LineFile, Lines

FORMAT = 1
_MAX_NAME = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerOrbit:
    """An orbit with its covariance, on GCRS axes."""

    label: str
    prior: str
    epoch_utc_ns: int
    r_gcrs_km: tuple[float, ...]
    v_gcrs_km_s: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    """Covariance (6, 6), km and km/s."""
    a_km: float
    e: float
    i_deg: float
    sigma_a_km: float
    rms_arcsec: float
    nights: int = 1
    """Number of tracks that it rests on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerTrack:
    """Track in the ledger."""

    session: str
    """Name of the session's folder."""
    folder: str
    """Path of the session's folder."""
    track_id: int
    latitude_deg: float
    longitude_deg: float
    elevation_m: float
    t_first_utc_ns: int
    t_last_utc_ns: int
    observations: int
    t_utc_ns: int
    """Instant of the direction and its rates, the middle of the track."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_east_arcsec_s: float
    rate_north_arcsec_s: float
    covariance: tuple[tuple[float, ...], ...]
    """Covariance (4, 4) of east, its rate, north, its rate: arcsec and arcsec/s."""
    orbit: LedgerOrbit | None
    """Orbit of the track; None where the track determines too little of one."""
    directions: tuple[tuple[float, ...], ...]
    """Some of its directions: seconds since ``t_utc_ns``, RA and Dec (deg), covariance ee, en,
    nn."""
    is_simulated: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerObject:
    """Uncatalogued object, with all its tracks."""

    number: int
    name: str
    """Name by the operator; empty: none."""
    tracks: tuple[LedgerTrack, ...]
    """Tracks in order of time."""

    @property
    def called(self) -> str:
        """Name for display."""
        return self.name or f"UCT {self.number}"

    @property
    def last(self) -> LedgerTrack:
        """Latest track."""
        return self.tracks[-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ledger:
    """Ledger of uncatalogued objects."""

    objects: tuple[LedgerObject, ...] = ()
    """Objects in order of number."""
    next_number: int = 1
    """Number of the next new object: none is used twice, even where its object was forgotten."""
    unreadable: tuple[int, ...] = ()
    """Numbers of the lines that cannot be read."""

    def named(self, number: int) -> LedgerObject:
        """Return an object by its number. Raises SessionError where the ledger has no such
        object."""
        for each in self.objects:
            if each.number == number:
                return each
        known = ", ".join(str(each.number) for each in self.objects[:12]) or "none"
        raise SessionError(f"the ledger has no UCT {number}; there are: {known}")

    def without(self, session: str) -> "Ledger":
        """Return the ledger without the tracks of a session."""
        objects = []
        for each in self.objects:
            tracks = tuple(track for track in each.tracks if track.session != session)
            if tracks:
                objects.append(replace(each, tracks=tracks))
        return replace(self, objects=tuple(objects))

    def number_of(self, session: str, track_id: int) -> int | None:
        """Number of the object that a track was kept as; None where it was not."""
        for each in self.objects:
            if any((t.session, t.track_id) == (session, track_id) for t in each.tracks):
                return each.number
        return None


def ledger_path(*, is_simulated: bool = False) -> Path:
    """Path of this user's ledger; simulated nights have one of their own."""
    return state_dir() / ("ledger-simulated.jsonl" if is_simulated else "ledger.jsonl")


def keep_change(number: int, track: LedgerTrack) -> Change:
    """Change: a track is added to an object that is new or known."""
    return {"did": "kept", "number": number, "track": asdict(track)}


def rename_change(number: int, name: str) -> Change:
    """Change: an object gets a name. Raises SessionError for one that cannot be displayed."""
    if len(name) > _MAX_NAME or not name.isprintable():
        raise SessionError(f"a name has at most {_MAX_NAME} characters, all of them printable")
    return {"did": "renamed", "number": number, "name": name.strip()}


def forget_change(number: int) -> Change:
    """Change: an object is no longer listed or matched; its lines stay in the file."""
    return {"did": "forgotten", "number": number}


def withdraw_change(session: str, track_id: int) -> Change:
    """Change: a track is withdrawn, because it has been identified with a catalogued object
    since."""
    return {"did": "taken back", "session": session, "track_id": track_id}


def read_ledger(path: Path | None = None) -> Ledger:
    """Read the ledger; an empty one where there is none. Raises SessionError."""
    file = _file(path or ledger_path())
    return _folded(file, file.lines())


def change_ledger(
    change: Callable[[Ledger], Sequence[Change]], path: Path | None = None
) -> tuple[Ledger, Path | None]:
    """Add the changes that ``change`` returns for the ledger, on the disk when this returns.

    Nobody else writes meanwhile. Returns the ledger, and the new path of a damaged file. Raises
    SessionError where another writer takes too long, and where the file cannot be written.
    """
    return _file(path or ledger_path()).change(_folded, change)


def _file(path: Path) -> LineFile:
    return LineFile(path=path, called="the ledger", format=FORMAT)


def _folded(file: LineFile, lines: Lines) -> Ledger:
    """Add up the lines. Raises SessionError for a ledger that a later version has written."""
    tracks: dict[tuple[str, int], tuple[int, LedgerTrack]] = {}
    names: dict[int, str] = {}
    gone: set[int] = set()
    highest = 0

    def take(said: Mapping[str, Any]) -> None:
        nonlocal highest
        match said["did"]:
            case "kept":
                track = _track(said["track"])
                tracks[track.session, track.track_id] = (_whole(said["number"]), track)
            case "renamed":
                names[_whole(said["number"])] = str(said["name"])
            case "forgotten":
                gone.add(_whole(said["number"]))
            case "taken back":
                tracks.pop((str(said["session"]), _whole(said["track_id"])), None)
            case _:
                raise ValueError(f"{said['did']!r} is nothing that a ledger says")
        highest = max(highest, said.get("number", 0))

    bad = file.read(lines, take)
    by_number: dict[int, list[LedgerTrack]] = {}
    for number, track in tracks.values():
        if number not in gone:
            by_number.setdefault(number, []).append(track)
    objects = [
        LedgerObject(
            number=number,
            name=names.get(number, ""),
            tracks=tuple(sorted(own, key=lambda each: each.t_utc_ns)),
        )
        for number, own in sorted(by_number.items())
    ]
    return Ledger(objects=tuple(objects), next_number=highest + 1, unreadable=bad)


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise ValueError(f"{value!r} is no number of an object")
    return value


def _track(said: object) -> LedgerTrack:
    """Read a track. Raises ValueError, KeyError or TypeError for values unfit for computation."""
    track: LedgerTrack = from_json_value(LedgerTrack, said)
    _expect_square(track.covariance, 4)
    if track.orbit is not None:
        _expect_square(track.orbit.covariance, 6)
        if len(track.orbit.r_gcrs_km) != 3 or len(track.orbit.v_gcrs_km_s) != 3:
            raise ValueError("a state has three and three numbers")
    return track


def _expect_square(rows: Sequence[Sequence[float]], size: int) -> None:
    if [len(row) for row in rows] != [size] * size:
        raise ValueError(f"a covariance is {size} by {size}")
