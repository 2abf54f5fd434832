"""Correlation of uncorrelated tracks with uncatalogued objects seen before. Pure.

Earlier tracks predict place and motion of an object, with an error that grows with time. For an
undisturbed orbit the error is that of the orbit and of the forces left out; for an object moved
since, that of elements of the same age after manoeuvres. A satellite that stays over its place on
the ground, as a geostationary one kept in its slot, is expected where it was at the same sidereal
time, even if a short arc gave no orbit or a wrong one. The result is a probability, relative to
another uncatalogued object's being there by chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.first.directions import MeasuredDirections
from rsoconsole.orbits.identification._assignments import best_assignments
from rsoconsole.orbits.identification.element_errors import (
    MANOEUVRED,
    manoeuvred_probability,
    orbit_regime,
    sigma_at_age_km,
)
from rsoconsole.orbits.identification.joint_identification import simultaneous_tracks
from rsoconsole.orbits.motion.prediction import KnownOrbit, SkyMotion, predict, predict_motion
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2, osculating_elements, propagate
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    ARCSEC_RAD,
    IntArray,
    direction_to_unit,
    site_gcrs,
    unit_to_direction,
    wrap_180,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S

SURE_SAME = 0.95
"""Probability from which on a track counts as one of an object seen before."""
_CREDIBLE = 23.5
"""Squared Mahalanobis distance, 4 degrees of freedom: one in ten thousand lies beyond."""
_SIDEREAL_ARCSEC_S = 15.04107
_TURN_RAD_S = 7.2921e-5
BELT_ARCSEC_S = 0.3
"""Rate over the ground below which an object counts as geostationary: a swing of 1.1 degrees."""
_BOX_ARCSEC = 220.0
"""One sigma of a satellite's place in its slot: slots are 0.1 deg to either side."""
_SWING_ARCSEC, _SWING_ARCSEC_A_DAY = 60.0, 8.0
"""One sigma of the change of its daily swings about that place: inclination and eccentricity."""
_SIDEREAL_DAY_NS = round(86_164.0905 * NS_PER_S)
_STRANGERS = {True: 1.4e-5, False: 3.6e-10}
"""Density of objects that no public catalogue knows, a square arcsec and square arcsec/s: in the
belt, where a fifth of 500 objects stand in 360 by 0.2 deg with rates within 0.05 arcsec/s, and
elsewhere (``identify.UNCATALOGUED``)."""
_FORCES_KM_A_DAY = 0.7
"""Error by forces that the model of an undisturbed orbit leaves out: 4 arcsec a day in the belt."""
_VAGUE_ARCSEC = 5400.0
"""Largest sigma of a prediction that is used."""
_FAR_DEG = 4.0
_MAX_DIRECTIONS = 24
_MIDDLE_S = 900.0
"""Time to either side of its middle within which a track is compared."""
_GATE_DEG, _GATE_DEG_A_DAY = 4.0, 0.2
"""Gate of the two-body prediction for a closer look: at once, and for each day."""
_THERE_DEG, _ELSEWHERE_DEG = 3.0, 20.0
"""Gate of the place above the ground: from one site, and with the parallax of another."""
_EACH = 24


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EarlierTrack:
    """One earlier track of an uncatalogued object."""

    number: int
    site: Site
    t_utc_ns: int
    """Instant of the direction: the middle of the track."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_arcsec_s: tuple[float, float]
    """Rate against the stars, east and north."""
    orbit: KnownOrbit | None
    """Orbit determined from the track; None where there is none."""
    is_held: bool = False
    """True where the orbit was fitted with the prior that the satellite is kept in its slot."""

    @property
    def is_in_belt(self) -> bool:
        """True where the object stayed over its place on the ground while it was seen."""
        return _over_ground(self.rate_arcsec_s, self.dec_icrs_deg) < BELT_ARCSEC_S


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """Result of the correlation of one track."""

    number: int | None
    """Number of the object; None where the track is not surely of one seen before."""
    separation_arcsec: float | None
    """Distance from the predicted to the measured place, of the likeliest object."""
    candidates: tuple[tuple[int, float], ...]
    """(Number, probability) of each object above 5 %, the likeliest first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Offset:
    """Measured minus predicted at the middle: east, its rate, north, its rate; arcsec, arcsec/s."""

    values: FloatArray
    covariance: FloatArray


def correlate_tracks(
    tracks: Sequence[MeasuredDirections], site: Site, before: Sequence[EarlierTrack]
) -> tuple[Correlation, ...]:
    """Correlate the tracks of a night with objects seen before.

    Tracks seen at the same time are of different objects. ``before`` may hold several tracks of one
    object: the likeliest of them counts.
    """
    numbers = sorted({each.number for each in before})
    scores = np.full((len(tracks), len(numbers) + 1), -np.inf)
    off = np.full((len(tracks), len(numbers)), np.nan)
    for t, track in enumerate(tracks):
        _, _, dec_deg, rate, _ = mid_track_direction_and_rates(track)
        scores[t, -1] = np.log(_STRANGERS[_over_ground(rate, dec_deg) < BELT_ARCSEC_S])
        for each in before:
            n = numbers.index(each.number)
            found = track_log_density(each, track, site)
            if found is not None and found[0] > scores[t, n]:
                scores[t, n], off[t, n] = found
    assignments = best_assignments(scores, simultaneous_tracks(tracks), _EACH)
    rows = np.arange(len(tracks))
    sums = np.array([np.sum(scores[rows, list(each)]) for each in assignments])
    shares = np.exp(sums - np.max(sums))
    shares /= np.sum(shares)
    marginals = np.zeros_like(scores)
    for assignment, share in zip(assignments, shares, strict=True):
        marginals[rows, list(assignment)] += share
    return tuple(_answer(numbers, marginals[t, :-1], off[t]) for t in rows)


def track_log_density(
    before: EarlierTrack, seen: MeasuredDirections, site: Site
) -> tuple[float, float] | None:
    """Return the log density of a track's offset from a prediction, and the offset.

    The prediction is an earlier track's; the offset is in arcsec. None where it is beyond the gate,
    or where there is no prediction for that instant.
    """
    track = _middle_of(seen)
    days = abs(track.epoch_utc_ns - before.t_utc_ns) / NS_PER_DAY
    cases: list[tuple[float, _Offset]] = []
    share = _moved_share(before, days)
    if before.orbit is not None and _is_near(before.orbit, track):
        cases += _by_orbit(before, track, site, days, share)
    is_there = before.is_in_belt and _is_over_there(before, track, site)
    if is_there and before.orbit is None:
        cases.append((1.0, _over_its_place(before, track, site)))
    elif is_there:
        cases += [(share / 2.0, each) for each in _held(before, track, site, days)]
    whole, nearest = -np.inf, None
    for weight, case in cases:
        chi2 = float(case.values @ np.linalg.solve(case.covariance, case.values))
        if chi2 > _CREDIBLE or weight <= 0.0:
            continue
        size = float(np.linalg.slogdet(2.0 * np.pi * case.covariance)[1])
        density = np.log(weight) - chi2 / 2.0 - size / 2.0
        if nearest is None or density > nearest[0]:
            nearest = (density, float(np.hypot(case.values[0], case.values[2])))
        whole = float(np.logaddexp(whole, density))
    return None if nearest is None else (whole, nearest[1])


def mid_track_direction_and_rates(
    seen: MeasuredDirections,
) -> tuple[int, float, float, tuple[float, float], FloatArray]:
    """Direction and rates of a track at its middle, fitted to the directions near it.

    Returns the instant, right ascension and declination in degrees, the rates (east, north) in
    arcsec/s, and the covariance (4, 4) of east, its rate, north, its rate in arcsec and arcsec/s.
    """
    track = _middle_of(seen)
    middle = int(np.argmin(np.abs(track.t_s)))
    ra, dec = float(track.ra_icrs_deg[middle]), float(track.dec_icrs_deg[middle])
    rate = _SIDEREAL_ARCSEC_S if _is_slow(track) else 0.0
    moving = ra + rate * track.t_s / 3600.0
    offset = _fitted(track, moving, np.full(len(track), dec), np.cos(np.radians(dec)))
    east, east_rate, north, north_rate = offset.values
    cos_dec = float(np.cos(np.radians(dec)))
    return (
        track.epoch_utc_ns,
        (ra + east / 3600.0 / cos_dec) % 360.0,
        dec + north / 3600.0,
        (float(east_rate + rate * cos_dec), float(north_rate)),
        offset.covariance,
    )


def _answer(numbers: Sequence[int], shares: FloatArray, off: FloatArray) -> Correlation:
    order = [int(n) for n in np.argsort(-shares, kind="stable") if shares[n] > 1.0 - SURE_SAME]
    best = order[0] if order else None
    return Correlation(
        number=numbers[best] if best is not None and shares[best] >= SURE_SAME else None,
        separation_arcsec=None if best is None else float(off[best]),
        candidates=tuple((numbers[n], float(shares[n])) for n in order),
    )


def _middle_of(seen: MeasuredDirections) -> MeasuredDirections:
    """Sightings of a few directions about the middle, evenly chosen."""
    near = np.flatnonzero(np.abs(seen.t_s) <= _MIDDLE_S)
    step = max(1, -(-len(near) // _MAX_DIRECTIONS))
    return seen.subset(near[::step])


def _over_ground(rate_arcsec_s: tuple[float, float], dec_deg: float) -> float:
    """Rate against a place that stands still above the ground, arcsec/s."""
    return float(
        np.hypot(
            rate_arcsec_s[0] - _SIDEREAL_ARCSEC_S * np.cos(np.radians(dec_deg)), rate_arcsec_s[1]
        )
    )


def _is_slow(track: MeasuredDirections) -> bool:
    """True where its rate is nearer to that of the ground than to that of the stars."""
    span_s = float(track.t_s[-1] - track.t_s[0])
    if span_s <= 0.0:
        return False
    rate = 3600.0 * float(wrap_180(track.ra_icrs_deg[-1] - track.ra_icrs_deg[0])) / span_s
    return abs(rate - _SIDEREAL_ARCSEC_S) < _SIDEREAL_ARCSEC_S / 2.0


def _moved_share(before: EarlierTrack, days: float) -> float:
    """Probability that the object has been moved since."""
    if before.is_held or (before.orbit is None and before.is_in_belt):
        return 0.9 * (1.0 - float(np.exp(-days / 5.0)))
    if before.orbit is None:
        return 0.0
    elements = osculating_elements(before.orbit.r_km, before.orbit.v_km_s)
    return manoeuvred_probability(orbit_regime(_revolutions(elements.a_km), elements.e), days)


def _revolutions(a_km: float) -> float:
    """Revolutions a day."""
    return float(np.sqrt(MU_EARTH_KM3_S2 / a_km**3) * 86_400.0 / (2.0 * np.pi))


def _is_near(orbit: KnownOrbit, track: MeasuredDirections) -> bool:
    """True where the two-body prediction is within its gate, which costs nothing."""
    middle = int(np.argmin(np.abs(track.t_s)))
    since_s = np.array([(int(track.t_utc_ns[middle]) - orbit.epoch_utc_ns) / NS_PER_S])
    r, _ = propagate(orbit.r_km, orbit.v_km_s, since_s)
    u = r[0] - track.sites_km[middle]
    cosine = float(u @ track.towards[middle] / np.linalg.norm(u))
    gate = _GATE_DEG + _GATE_DEG_A_DAY * abs(float(since_s[0])) / 86_400.0
    return bool(np.isfinite(cosine)) and cosine > float(np.cos(np.radians(min(gate, 90.0))))


def _is_over_there(before: EarlierTrack, track: MeasuredDirections, site: Site) -> bool:
    """True where it is near the earlier place above the ground, which costs nothing to compute."""
    middle = int(np.argmin(np.abs(track.t_s)))
    instant = track.t_utc_ns[middle : middle + 1]
    ra_deg = before.ra_icrs_deg + float(_sidereal_deg(before.t_utc_ns, instant)[0])
    line = direction_to_unit(ra_deg, before.dec_icrs_deg)
    gate = _THERE_DEG if site == before.site else _ELSEWHERE_DEG
    return float(line @ track.towards[middle]) > float(np.cos(np.radians(gate)))


def _by_orbit(
    before: EarlierTrack, track: MeasuredDirections, site: Site, days: float, share: float
) -> list[tuple[float, _Offset]]:
    """Offsets from its orbit, undisturbed and moved, with their weights."""
    orbit = before.orbit
    assert orbit is not None
    found = _predicted(orbit, track, site)
    if found is None:
        return []
    motion, offset, range_km = found
    elements = osculating_elements(orbit.r_km, orbit.v_km_s)
    spread = MANOEUVRED[orbit_regime(_revolutions(elements.a_km), elements.e)]
    n = _revolutions(elements.a_km) * 2.0 * np.pi / 86_400.0
    forces = _FORCES_KM_A_DAY * days
    cases = []
    for weight, sizes in (
        (1.0 - share, (forces, forces / 4.0)),
        (
            share / 2.0 if before.is_in_belt else share,
            (
                float(sigma_at_age_km(spread.along, days)),
                float(sigma_at_age_km(spread.across, days)),
            ),
        ),
    ):
        growth = _on_sky(motion, sizes, range_km, n)
        covariance = offset.covariance + motion.covariance + growth
        cases.append((weight, _Offset(values=offset.values, covariance=covariance)))
    return cases


def _predicted(
    orbit: KnownOrbit, track: MeasuredDirections, site: Site, back_ns: int = 0
) -> tuple[SkyMotion, _Offset, float] | None:
    """Prediction of an orbit, ``back_ns`` earlier: motion, offset of the track from it, and
    distance in km.

    None where the prediction is worse than a degree or so.
    """
    with np.errstate(all="ignore"):
        motion = predict_motion(orbit, site, track.epoch_utc_ns - back_ns)
        places = predict(orbit, site, track.t_utc_ns - back_ns).places
    if motion is None or not np.all(np.isfinite(places.ra_icrs_deg)):
        return None
    if float(np.sqrt(np.max(np.diag(motion.covariance)[[0, 2]]))) > _VAGUE_ARCSEC:
        return None
    cos_dec = np.cos(np.radians(places.dec_icrs_deg))
    offset = _fitted(track, places.ra_icrs_deg, places.dec_icrs_deg, cos_dec)
    return motion, offset, float(np.median(places.range_km))


def _held(
    before: EarlierTrack, track: MeasuredDirections, site: Site, days: float
) -> list[_Offset]:
    """Offset from its orbit at the same sidereal time within half a day: held in its slot.

    The object may stand anywhere in the slot, and its swings about that place change by the week.
    """
    assert before.orbit is not None
    since_ns = track.epoch_utc_ns - before.orbit.epoch_utc_ns
    found = _predicted(
        before.orbit, track, site, round(since_ns / _SIDEREAL_DAY_NS) * _SIDEREAL_DAY_NS
    )
    if found is None:
        return []
    motion, offset, _ = found
    swing = float(np.hypot(_SWING_ARCSEC, _SWING_ARCSEC_A_DAY * days))
    place = float(np.hypot(_BOX_ARCSEC, swing))
    rate = _TURN_RAD_S * swing
    growth = np.diag(np.array([place, rate, swing, rate]) ** 2)
    return [
        _Offset(values=offset.values, covariance=offset.covariance + motion.covariance + growth)
    ]


def _over_its_place(before: EarlierTrack, track: MeasuredDirections, site: Site) -> _Offset:
    """Offset of a track from an earlier place above the ground.

    Allows for the parallax where the earlier site is another one.
    """
    turned = _sidereal_deg(before.t_utc_ns, track.t_utc_ns)
    ra, dec = before.ra_icrs_deg + turned, np.full(len(track), before.dec_icrs_deg)
    if site != before.site:
        ra, dec = _from_there(before, track, ra)
    cos_dec = np.cos(np.radians(dec))
    offset = _fitted(track, ra, dec, cos_dec)
    rate = _over_ground(before.rate_arcsec_s, before.dec_icrs_deg)
    # It swings about its place once a day, at a phase that nobody knows.
    swing = np.hypot(_BOX_ARCSEC, rate / _TURN_RAD_S)
    sizes = np.array([swing, _TURN_RAD_S * swing, swing, _TURN_RAD_S * swing])
    return _Offset(values=offset.values, covariance=offset.covariance + np.diag(sizes**2))


def _from_there(
    before: EarlierTrack, track: MeasuredDirections, ra_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Directions from the track's site to an object in the belt, seen from the other one."""
    instants = np.asarray(track.t_utc_ns, np.int64)
    there, _ = site_gcrs(before.site, instants)
    a, d = np.radians(ra_deg), np.radians(before.dec_icrs_deg)
    line = np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.full_like(a, np.sin(d))], -1)
    along = np.sum(there * line, axis=-1)
    reach = -along + np.sqrt(along**2 - np.sum(there**2, axis=-1) + 42_164.2**2)
    u = there + reach[:, None] * line - track.sites_km
    return unit_to_direction(u)


def _sidereal_deg(from_utc_ns: int, to_utc_ns: IntArray) -> FloatArray:
    since_s = (np.asarray(to_utc_ns, np.int64) - from_utc_ns) / NS_PER_S
    return np.asarray(since_s * _SIDEREAL_ARCSEC_S / 3600.0 % 360.0)


def _fitted(
    track: MeasuredDirections, ra_deg: FloatArray, dec_deg: FloatArray, cos_dec: FloatArray
) -> _Offset:
    """Offset and rate of the track, measured minus these places."""
    off = np.stack(
        [wrap_180(track.ra_icrs_deg - ra_deg) * cos_dec, track.dec_icrs_deg - dec_deg], axis=-1
    )
    off = np.clip(off, -_FAR_DEG, _FAR_DEG) * 3600.0
    since = track.t_s
    rows = np.zeros((len(track), 2, 4))
    rows[:, 0, 0] = rows[:, 1, 2] = 1.0
    rows[:, 0, 1] = rows[:, 1, 3] = since
    white = (track.whitening @ rows).reshape(-1, 4)
    values = track.whitened(off).reshape(-1)
    normal = white.T @ white
    # Where all are of one instant nothing is known of the rates.
    normal[[1, 3], [1, 3]] += 1.0 / 20.0**2
    covariance = np.linalg.inv(normal)
    solved = covariance @ white.T @ values
    freedom = max(len(values) - 4, 1)
    misfit = float(np.sum((values - white @ solved) ** 2)) / freedom
    return _Offset(values=solved, covariance=np.asarray(covariance * max(misfit, 1.0)))


def _on_sky(
    motion: SkyMotion, sizes_km: tuple[float, float], range_km: float, n_rad_s: float
) -> FloatArray:
    """Covariance (4, 4) of errors along and across the motion, and of the swing with them."""
    towards = np.array(motion.rate_arcsec_s)
    along = towards / max(float(np.linalg.norm(towards)), 1e-9)
    turn = np.stack([along, np.array([-along[1], along[0]])], axis=-1)
    sizes = np.array(sizes_km) / range_km / ARCSEC_RAD
    place = turn @ np.diag(sizes**2) @ turn.T
    found = np.zeros((4, 4))
    found[np.ix_([0, 2], [0, 2])] = place
    found[np.ix_([1, 3], [1, 3])] = place * n_rad_s**2
    return found
