"""What a relative path comes to: separation, rate, and the next closest approach. Pure."""

from typing import Any

import numpy as np

from rsoconsole.records import ClosestKind, FloatArray, PairMotion, PathKind
from rsoconsole.sky import NS_PER_S
from rsoconsole.tracking.association.relative import RelativePath

_STEPS = 73
"""Instants of the horizon at which a path is looked at."""
_NEWTON_STEPS = 3
_LOW, _HIGH, _LOWEST, _HIGHEST = 16.0, 84.0, 2.5, 97.5
_AT_AN_END = 0.02
"""Share of the horizon: nearer to one of its ends the least separation is there."""


def pair_motion(
    tracks: tuple[int, int],
    path: RelativePath,
    t_utc_ns: int,
    *,
    warned_arcsec: float = 0.0,
    warned_ahead_s: float = 0.0,
) -> PairMotion:
    """How two tracks move to each other at an instant, for the record.

    ``warned_arcsec`` and ``warned_ahead_s``: how near, and how soon, an approach is warned of.
    """
    late_s = (t_utc_ns - path.t_utc_ns) / NS_PER_S
    since_s = late_s + np.linspace(0.0, path.horizon_s, _STEPS)
    ways = path.at(since_s)
    now, rate = ways[:, 0], 60.0 * path.rate_at(since_s[:1])[:, 0]
    separation = np.hypot(*now.T)
    towards = now / np.maximum(separation, 1e-9)[:, None]
    separation_rate = np.sum(towards * rate, axis=1)
    east, north = np.mean(now, axis=0)
    angle_deg = float(np.degrees(np.arctan2(east, north))) % 360.0
    beside_deg = (np.degrees(np.arctan2(*now.T)) - angle_deg + 180.0) % 360.0 - 180.0
    at_s, nearest = closest(since_s, ways)
    after_s = at_s - late_s
    likely_s, soonest_s, latest_s = map(float, np.percentile(after_s, [50.0, _LOW, _HIGH]))
    share = likely_s / path.horizon_s
    kind: ClosestKind = (
        "now" if share < _AT_AN_END else "beyond" if share > 1.0 - _AT_AN_END else "ahead"
    )
    shares = [50.0, _LOW, _HIGH, _LOWEST, _HIGHEST]
    middle, low, high, lowest, highest = np.percentile(nearest, shares)
    soon = np.hypot(*np.moveaxis(ways[:, since_s - late_s <= warned_ahead_s], -1, 0))
    is_warned = (nearest < warned_arcsec) & (after_s <= warned_ahead_s)
    is_warned |= np.min(soon, axis=1, initial=np.inf) < warned_arcsec
    sigma_now, sigma_rate = np.std(now, axis=0), np.std(rate, axis=0)
    mean_rate = np.mean(rate, axis=0)
    return PairMotion(
        track_id=tracks[0],
        other_track_id=tracks[1],
        t_utc_ns=t_utc_ns,
        frames=path.frames,
        east_arcsec=_rounded(east),
        north_arcsec=_rounded(north),
        sigma_east_arcsec=_rounded(sigma_now[0]),
        sigma_north_arcsec=_rounded(sigma_now[1]),
        separation_arcsec=_rounded(np.mean(separation)),
        sigma_separation_arcsec=_rounded(np.std(separation)),
        position_angle_deg=_rounded(angle_deg) % 360.0,
        sigma_position_angle_deg=_rounded(np.sqrt(np.mean(beside_deg**2))),
        rate_east_arcsec_min=_rounded(mean_rate[0]),
        rate_north_arcsec_min=_rounded(mean_rate[1]),
        sigma_rate_east_arcsec_min=_rounded(sigma_rate[0]),
        sigma_rate_north_arcsec_min=_rounded(sigma_rate[1]),
        separation_rate_arcsec_min=_rounded(np.mean(separation_rate)),
        sigma_separation_rate_arcsec_min=_rounded(np.std(separation_rate)),
        closest=kind,
        closest_utc_ns=t_utc_ns + round(likely_s * NS_PER_S),
        sigma_closest_s=_rounded((latest_s - soonest_s) / 2.0),
        closest_arcsec=_rounded(middle),
        closest_low_arcsec=_rounded(low),
        closest_high_arcsec=_rounded(high),
        closest_lowest_arcsec=_rounded(lowest),
        closest_highest_arcsec=_rounded(highest),
        horizon_s=_rounded(path.horizon_s),
        path=_kind_of(ways, mean_rate / 60.0, since_s, likely_s + late_s),
        close_probability=_rounded(np.mean(is_warned)),
    )


def closest(since_s: FloatArray, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(S,) when each of the paths (S, M, 2), at even instants (M,), is nearest to 0, and how near.

    Between three instants a path is a parabola.
    """
    squares = ways[..., 0] ** 2 + ways[..., 1] ** 2
    at = np.clip(np.argmin(squares, axis=1), 1, ways.shape[1] - 2)
    rows = np.arange(len(ways))
    before, middle, after = (ways[rows, at + step] for step in (-1, 0, 1))
    rate, bend = (after - before) / 2.0, (after + before) / 2.0 - middle
    x = np.zeros(len(ways))
    for _ in range(_NEWTON_STEPS):
        place = middle + rate * x[:, None] + bend * x[:, None] ** 2
        slope = rate + 2.0 * bend * x[:, None]
        curve = np.sum(slope**2, axis=1) + np.maximum(2.0 * np.sum(place * bend, axis=1), 0.0)
        x = np.clip(x - np.sum(place * slope, axis=1) / np.maximum(curve, 1e-12), -1.0, 1.0)
    place = middle + rate * x[:, None] + bend * x[:, None] ** 2
    step_s = float(since_s[1] - since_s[0])
    return np.asarray(since_s[at] + x * step_s), np.hypot(*place.T)


def _kind_of(
    ways: FloatArray, rate_arcsec_s: FloatArray, since_s: FloatArray, at_s: float
) -> PathKind:
    """Whether the path's bend counts until it is nearest, beside its error."""
    number = int(np.argmin(np.abs(since_s - at_s)))
    mean, start = np.mean(ways[:, number], axis=0), np.mean(ways[:, 0], axis=0)
    straight = start + rate_arcsec_s * (since_s[number] - since_s[0])
    sigma = float(np.hypot(*np.std(ways[:, number], axis=0)))
    return "curved" if float(np.hypot(*(mean - straight))) > sigma else "straight"


def _rounded(value: np.floating[Any] | float) -> float:
    """For the record: no more digits than it is known to."""
    return round(float(value), 3)
