"""Uncorrelated tracks: stored in the ledger, and recognised on later nights."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsoconsole.base import SessionError
from rsoconsole.orbits import (
    SURE_SAME,
    Correlation,
    EarlierTrack,
    KnownOrbit,
    MeasuredDirections,
    Orbit,
    PerturbedPropagator,
    common_error_arcsec,
    correlate_tracks,
    determine_orbit,
    merged_tracklets,
    mid_track_direction_and_rates,
    reduce_directions,
)
from rsoconsole.pipeline.orbits.orbit_determination import orbit_record_fields
from rsoconsole.pipeline.orbits.standard_magnitudes import standard_magnitude_by_orbit
from rsoconsole.pipeline.orbits.track_measurements import (
    ObservedTrack,
    longest_arc,
    read_observed_tracks,
)
from rsoconsole.records import FloatArray, Identified, LedgerName, Site
from rsoconsole.session import (
    Change,
    Ledger,
    LedgerObject,
    LedgerOrbit,
    LedgerTrack,
    SessionReader,
    change_ledger,
    keep_change,
    ledger_path,
    withdraw_change,
)
from rsoconsole.words import NS_PER_S

MIN_TRACKS = 5
"""Fewest directions of a track that is kept; fewer may be glints of different satellites."""
_MAX_DIRECTIONS = 40
_TOGETHER = 4
"""Most tracks of an object, the latest, that are fitted with one orbit."""
_SAME_RMS = 3.0
"""Largest ratio of the RMS of several nights' directions to that of one night's."""
_MAX_COMMON_ARCSEC = 10.0
"""Largest error in common of a whole night, by forces and stars, that is allowed beside it."""
_KNOWN = ("free", "constrained by prior")


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptTrack:
    """Track of a session that is kept in the ledger."""

    track: int
    number: int
    is_new: bool
    recognised: Correlation | None
    """Correlation with the ledger's objects; None where the track was in the ledger already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptSession:
    """Result of keeping the tracks of a session in the ledger."""

    tracks: tuple[KeptTrack, ...] = ()
    taken_back: tuple[int, ...] = ()
    """Tracks withdrawn from the ledger, because they now have a catalogued name."""
    too_short: tuple[int, ...] = ()
    moved_aside: Path | None = None
    """Path to which a damaged ledger was moved; None where it was sound."""


class Past:
    """Objects that were in the ledger when the night began."""

    def __init__(self, ledger: Ledger) -> None:
        self._objects = {each.number: each for each in ledger.objects}
        self._before = latest_ledger_tracks(ledger.objects)

    def ledger_names(
        self, tracks: Mapping[int, MeasuredDirections], site: Site
    ) -> dict[int, LedgerName]:
        """Return names from the ledger, by track id, of tracks that are or may be its objects."""
        if not self._before or not tracks:
            return {}
        found = correlate_tracks(list(tracks.values()), site, self._before)
        return {
            track_id: self._name(*answer.candidates[0], answer.separation_arcsec)
            for track_id, answer in zip(tracks, found, strict=True)
            if answer.candidates
        }

    def _name(self, number: int, probability: float, off: float | None) -> LedgerName:
        known = self._objects[number]
        return LedgerName(
            number=number,
            name=known.called,
            t_last_utc_ns=known.last.t_last_utc_ns,
            probability=probability,
            is_sure=probability >= SURE_SAME,
            separation_arcsec=0.0 if off is None or not math.isfinite(off) else off,
        )


def latest_ledger_tracks(objects: Sequence[LedgerObject]) -> tuple[EarlierTrack, ...]:
    """Return the latest tracks of each object in the ledger, for correlation."""
    return tuple(_seen_before(each.number, track) for each in objects for track in each.tracks[-2:])


def keep_unknown_tracks(folder: Path, path: Path | None = None) -> KeptSession:
    """Keep the tracks of a closed session whose recorded identification is "unknown".

    Tracks never compared with a catalogue are left out. ``path``: the ledger; None: the usual one.
    Raises SessionError.
    """
    identified: dict[int, Identified] = {}
    for _, _, record in SessionReader(folder).records(kinds=(Identified,)):
        if isinstance(record, Identified):
            identified[record.track_id] = record
    unknown = {n for n, each in identified.items() if each.verdict == "unknown"}
    if not unknown:
        return KeptSession()
    tracks = [each for each in read_observed_tracks(folder) if each.track_id in unknown]
    return keep_tracks(folder, tracks, (), path)


def keep_tracks(
    folder: Path,
    tracks: Sequence[ObservedTrack],
    named: Sequence[ObservedTrack],
    path: Path | None = None,
) -> KeptSession:
    """Store a session's uncatalogued tracks in the ledger; withdraw those identified since.

    ``tracks``: the uncatalogued ones; ``named``: the identified ones; ``path``: the ledger's file;
    None: the user's, a separate one for simulated nights. Raises SessionError.
    """
    session = folder.resolve().name
    is_simulated = SessionReader(folder).read_meta().get("is_simulated") is True
    path = path or ledger_path(is_simulated=is_simulated)
    long = sorted(
        (each for each in tracks if len(each.seen) >= MIN_TRACKS), key=lambda each: each.number
    )
    ready = [(each, longest_arc(each.seen)) for each in long]
    orbits = [_determined(arc) for _, arc in ready]
    done: list[KeptTrack] = []
    back: list[int] = []

    def changes(ledger: Ledger) -> list[Change]:
        # Nothing is on the disk yet: with another's change in between it would be asked again.
        found: list[Change] = []
        for each in named:
            if ledger.number_of_track(session, each.track_id or 0) is not None:
                found.append(withdraw_change(session, each.track_id or 0))
                back.append(each.number)
        done.extend(_kept_tracks(session, ledger, ready))
        for (each, arc), orbit, track_kept in zip(ready, orbits, done, strict=True):
            number = track_kept.number
            before = [known for known in ledger.objects if known.number == number]
            track = _ledger_track(folder, each, arc, is_simulated=is_simulated)
            best = _best_orbit(arc, orbit, before[0] if before else None, session)
            if best is not None:
                track = _with_orbit(track, each, *best)
            found.append(keep_change(number, track))
        return found

    if not ready and not named:
        return KeptSession(too_short=_short(tracks))
    _, aside = change_ledger(changes, path)
    return KeptSession(
        tracks=tuple(done), taken_back=tuple(back), too_short=_short(tracks), moved_aside=aside
    )


def _short(tracks: Sequence[ObservedTrack]) -> tuple[int, ...]:
    return tuple(each.number for each in tracks if len(each.seen) < MIN_TRACKS)


def _kept_tracks(
    session: str, ledger: Ledger, ready: Sequence[tuple[ObservedTrack, MeasuredDirections]]
) -> list[KeptTrack]:
    """Return each track with its object: known by its own entry, recognised, or new."""
    known = [ledger.number_of_track(session, each.track_id or 0) for each, _ in ready]
    own = {number for number in known if number is not None}
    asked = [n for n, number in enumerate(known) if number is None]
    # A session's own entries are no earlier night; its tracks are compared with one another below.
    before = [
        each
        for each in ledger.objects
        if each.number not in own and any(t.session != session for t in each.tracks)
    ]
    answers: dict[int, Correlation] = {}
    if asked:
        found = correlate_tracks(
            [ready[n][1] for n in asked], ready[0][0].site, latest_ledger_tracks(before)
        )
        answers = dict(zip(asked, found, strict=True))
    new: list[tuple[int, MeasuredDirections, Site]] = []
    done, following = [], ledger.next_number
    for n, (each, arc) in enumerate(ready):
        number, answer, is_new = known[n], answers.get(n), False
        if number is None:
            number = answer.number if answer is not None else None
            if number is None:
                number = _of_this_night(arc, each.site, new)
            if number is None:
                number, is_new = following, True
                following += 1
            new.append((number, arc, each.site))
        done.append(KeptTrack(track=each.number, number=number, is_new=is_new, recognised=answer))
    return done


def _of_this_night(
    arc: MeasuredDirections, site: Site, new: Sequence[tuple[int, MeasuredDirections, Site]]
) -> int | None:
    """Return the object of an earlier track of this session that had ended, if it is the same."""
    at_once = {
        number
        for number, other, _ in new
        if other.t_utc_ns[0] <= arc.t_utc_ns[-1] and arc.t_utc_ns[0] <= other.t_utc_ns[-1]
    }
    before = [_of_arc(*each) for each in new if each[0] not in at_once]
    return correlate_tracks([arc], site, before)[0].number if before else None


def _of_arc(number: int, arc: MeasuredDirections, site: Site) -> EarlierTrack:
    t, ra, dec, rate, _ = mid_track_direction_and_rates(arc)
    orbit = _determined(arc)
    return EarlierTrack(
        number=number,
        site=site,
        t_utc_ns=t,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        rate_arcsec_s=rate,
        orbit=orbit,
        is_held=orbit is not None and orbit.prior == "slot",
    )


def _determined(arc: MeasuredDirections) -> Orbit | None:
    """Return an orbit that is worth keeping; None where there is none."""
    with np.errstate(all="ignore"):
        orbit = determine_orbit(arc)
    if orbit is None or orbit.label not in _KNOWN:
        return None
    return orbit if np.all(np.isfinite(orbit.covariance)) else None


def _ledger_track(
    folder: Path, observed: ObservedTrack, arc: MeasuredDirections, *, is_simulated: bool
) -> LedgerTrack:
    t, ra, dec, rate, covariance = mid_track_direction_and_rates(arc)
    step = max(1, -(-len(arc) // _MAX_DIRECTIONS))
    some = arc.subset(np.arange(0, len(arc), step))
    cov = np.linalg.inv(np.swapaxes(some.whitening, -1, -2) @ some.whitening)
    rows = np.stack(
        [
            (some.t_utc_ns - t) / NS_PER_S,
            some.ra_icrs_deg,
            some.dec_icrs_deg,
            *(cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]),
        ],
        axis=-1,
    )
    site = observed.site
    return LedgerTrack(
        session=folder.resolve().name,
        folder=str(folder.resolve()),
        track_id=observed.track_id or 0,
        latitude_deg=site.latitude_deg,
        longitude_deg=site.longitude_deg,
        elevation_m=site.elevation_m,
        t_first_utc_ns=int(arc.t_utc_ns[0]),
        t_last_utc_ns=int(arc.t_utc_ns[-1]),
        observations=len(arc),
        t_utc_ns=t,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        rate_east_arcsec_s=rate[0],
        rate_north_arcsec_s=rate[1],
        covariance=_rows(covariance),
        orbit=None,
        directions=_rows(rows),
        is_simulated=is_simulated,
    )


def _with_orbit(
    track: LedgerTrack, observed: ObservedTrack, orbit: Orbit, nights: int
) -> LedgerTrack:
    """Add an orbit, with the number of tracks in it, and the magnitude that its distance gives."""
    first, last = track.t_first_utc_ns, track.t_last_utc_ns
    lights = [each for each in observed.lights if first <= each.t_utc_ns <= last]
    standard = standard_magnitude_by_orbit(lights, orbit, observed.site)
    return replace(
        track,
        orbit=LedgerOrbit(**orbit_record_fields(orbit), nights=nights),
        standard_mag=None if standard is None else standard.mag,
        standard_mag_sigma=None if standard is None else standard.sigma_mag,
    )


def _best_orbit(
    arc: MeasuredDirections, orbit: Orbit | None, before: LedgerObject | None, session: str
) -> tuple[Orbit, int] | None:
    """Orbit through the object's latest tracks where one fits them all, else the track's own.

    With the number of tracks that it is fitted to.
    """
    earlier = [] if before is None else [t for t in before.tracks if t.session != session]
    if earlier and orbit is not None:
        parts = [_sightings_of(each) for each in earlier[-_TOGETHER:]]
        whole = merged_tracklets([*parts, arc])[0]
        joined, common = _determined(whole), min(common_error_arcsec(whole), _MAX_COMMON_ARCSEC)
        most = math.hypot(_SAME_RMS * orbit.rms_arcsec, common)
        if joined is not None and joined.rms_arcsec <= most:
            return joined, 1 + len(parts)
    return None if orbit is None else (orbit, 1)


def _rows(values: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in values)


def _site_of(track: LedgerTrack) -> Site:
    return Site(
        latitude_deg=track.latitude_deg,
        longitude_deg=track.longitude_deg,
        elevation_m=track.elevation_m,
    )


def _sightings_of(track: LedgerTrack) -> MeasuredDirections:
    rows = np.array(track.directions)
    t = track.t_utc_ns + np.round(rows[:, 0] * NS_PER_S).astype(np.int64)
    try:
        return reduce_directions(_site_of(track), t, rows[:, 1], rows[:, 2], rows[:, 3:])
    except (ValueError, IndexError) as error:
        raise SessionError(
            f"the ledger's track of {track.session} holds no directions: {error}"
        ) from error


def _seen_before(number: int, track: LedgerTrack) -> EarlierTrack:
    orbit = track.orbit
    known = (
        None
        if orbit is None
        else KnownOrbit(
            epoch_utc_ns=orbit.epoch_utc_ns,
            r_km=np.array(orbit.r_gcrs_km),
            v_km_s=np.array(orbit.v_gcrs_km_s),
            covariance=np.array(orbit.covariance),
            forces=PerturbedPropagator(epoch_utc_ns=orbit.epoch_utc_ns),
        )
    )
    return EarlierTrack(
        number=number,
        site=_site_of(track),
        t_utc_ns=track.t_utc_ns,
        ra_icrs_deg=track.ra_icrs_deg,
        dec_icrs_deg=track.dec_icrs_deg,
        rate_arcsec_s=(track.rate_east_arcsec_s, track.rate_north_arcsec_s),
        orbit=known,
        is_held=orbit is not None and orbit.prior == "slot",
    )
