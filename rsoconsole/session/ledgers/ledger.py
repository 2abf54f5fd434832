"""Ledger of uncatalogued tracks, kept across nights in the user's state folder.

Lines are only appended to its file (``line_file``): a track is added or withdrawn, an object is
named or forgotten. The present state results from all lines in order. A track that is added again
(same session and track id) replaces its earlier entry.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError
from rsoconsole.config import state_dir
from rsoconsole.orbits import StandardMagnitude, standard_magnitude
from rsoconsole.session.log.codec import from_json_value
from rsoconsole.session.log.line_file import Change, LineFile, Lines

FORMAT = 1
_MAX_NAME = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerOrbit:
    """An orbit with its covariance, along GCRS axes."""

    label: str
    prior: str
    epoch_utc_ns: int
    r_gcrs_km: tuple[float, ...]
    v_gcrs_km_s: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of r and v, (6, 6), km and km/s."""
    a_km: float
    e: float
    i_deg: float
    sigma_a_km: float
    rms_arcsec: float
    nights: int = 1
    """Number of tracks that the orbit was fitted to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerTrack:
    """One track in the ledger: where and when it was seen, its motion, its orbit."""

    session: str
    folder: str
    track_id: int
    latitude_deg: float
    longitude_deg: float
    elevation_m: float
    t_first_utc_ns: int
    t_last_utc_ns: int
    observations: int
    t_utc_ns: int
    """Instant of ``ra_icrs_deg``, ``dec_icrs_deg`` and the rates: the middle of the track."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_east_arcsec_s: float
    rate_north_arcsec_s: float
    covariance: tuple[tuple[float, ...], ...]
    """Covariance (4, 4) of east, east rate, north, north rate: arcsec and arcsec/s."""
    orbit: LedgerOrbit | None
    """Orbit of the track; None where the track does not determine one."""
    directions: tuple[tuple[float, ...], ...]
    """Some of its directions: seconds since ``t_utc_ns``, RA, Dec (deg), covariance ee, en, nn."""
    is_simulated: bool = False
    standard_mag: float | None = None
    """Median of its V magnitudes at 1000 km and 90 deg, by ``orbit``; None where too few are."""
    standard_mag_sigma: float | None = None
    """Robust scatter of one of them, with the error of the distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerObject:
    """An uncatalogued object, with all of its tracks."""

    number: int
    name: str
    """Name that the operator gave; empty: none."""
    tracks: tuple[LedgerTrack, ...]

    @property
    def called(self) -> str:
        """Name for display: the operator's, or one made of the number."""
        return self.name or f"UCT {self.number}"

    @property
    def last(self) -> LedgerTrack:
        """The latest track."""
        return self.tracks[-1]

    @property
    def standard_mag(self) -> float | None:
        """Median of its tracks' magnitudes at 1000 km and 90 deg; None where no track has one."""
        found = self._standard
        return None if found is None else found.mag

    @property
    def standard_mag_sigma(self) -> float | None:
        """Scatter of a single magnitude about ``standard_mag``."""
        found = self._standard
        return None if found is None else found.sigma_mag

    @property
    def _standard(self) -> StandardMagnitude | None:
        known = [
            (each.standard_mag, each.standard_mag_sigma)
            for each in self.tracks
            if each.standard_mag is not None and each.standard_mag_sigma is not None
        ]
        return standard_magnitude([mag for mag, _ in known], [sigma for _, sigma in known])


@dataclass(frozen=True, slots=True, kw_only=True)
class Ledger:
    """The uncatalogued objects of all nights."""

    objects: tuple[LedgerObject, ...] = ()
    next_number: int = 1
    """Number for the next new object; the number of a forgotten object is not used again."""
    unreadable: tuple[int, ...] = ()
    """Numbers, from 1, of the lines of the file that cannot be read."""

    def object_by_number(self, number: int) -> LedgerObject:
        """Return the object with this number. Raises SessionError where there is none."""
        for each in self.objects:
            if each.number == number:
                return each
        known = ", ".join(str(each.number) for each in self.objects[:12]) or "none"
        raise SessionError(f"the ledger has no UCT {number}; there are: {known}")

    def without_session(self, session: str) -> "Ledger":
        """Return the ledger without the tracks of a session; ``session``: name of its folder."""
        objects = []
        for each in self.objects:
            tracks = tuple(track for track in each.tracks if track.session != session)
            if tracks:
                objects.append(replace(each, tracks=tracks))
        return replace(self, objects=tuple(objects))

    def number_of_track(self, session: str, track_id: int) -> int | None:
        """Return the number of the object that has this track; None where no object has it."""
        for each in self.objects:
            if any((t.session, t.track_id) == (session, track_id) for t in each.tracks):
                return each.number
        return None


def ledger_path(*, is_simulated: bool = False) -> Path:
    """Return the path of this user's ledger; simulated nights have another file."""
    return state_dir() / ("ledger-simulated.jsonl" if is_simulated else "ledger.jsonl")


def keep_change(number: int, track: LedgerTrack) -> Change:
    """Return the line that adds a track to object ``number``, which may be new."""
    return {"did": "kept", "number": number, "track": asdict(track)}


def rename_change(number: int, name: str) -> Change:
    """Return the line that names an object. Raises SessionError for a name not displayable."""
    if len(name) > _MAX_NAME or not name.isprintable():
        raise SessionError(f"a name has at most {_MAX_NAME} characters, all of them printable")
    return {"did": "renamed", "number": number, "name": name.strip()}


def forget_change(number: int) -> Change:
    """Return the line after which an object is not listed or matched; its lines remain."""
    return {"did": "forgotten", "number": number}


def withdraw_change(session: str, track_id: int) -> Change:
    """Return the change that withdraws a track that has since been identified."""
    return {"did": "taken back", "session": session, "track_id": track_id}


def read_ledger(path: Path | None = None) -> Ledger:
    """Read the ledger at ``path``; None: this user's. Empty where there is no file.

    Raises SessionError.
    """
    file = _file(path or ledger_path())
    return _folded(file, file.lines())


def change_ledger(
    change: Callable[[Ledger], Sequence[Change]], path: Path | None = None
) -> tuple[Ledger, Path | None]:
    """Append the changes that ``change`` returns for the present ledger.

    They are on the disk on return; the file is locked meanwhile. ``path``: None: this user's
    ledger. Returns (the new ledger, path to which a damaged file was moved or None). Raises
    SessionError where another writer takes too long, and where the file cannot be written.
    """
    return _file(path or ledger_path()).append_changes(_folded, change)


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

    bad = file.parse_lines(lines, take)
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
