"""Which satellites of the element files stand above the limit now, and for how long. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits.elements import CatalogueEntry, nearest_in_epoch_of_each
from rsoconsole.pipeline.outlook.standing import standing
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import LIT_SHARE, NS_PER_S, lit_fraction, separation_deg, unit_to_direction

MINUTES = (*range(21), *range(25, 60, 5), *range(60, 721, 15))
"""When it is looked at: close together at first, as a low satellite is up for minutes."""
STEP_S = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Up:
    """One satellite above the limit."""

    norad_id: int
    name: str
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Geometric, to some arcseconds: a go-to asks for the place again."""
    alt_deg: float
    az_deg: float
    is_lit: bool
    """By the Sun: in the Earth's shadow there is nothing to see."""
    rate_arcsec_s: float
    """How fast it moves over the stars."""
    minutes_left: float | None
    """Until it sinks to the limit; None: not within 12 hours."""


def up_now(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: int, limits: LimitsConfig
) -> tuple[Up, ...]:
    """Those above altitude limit and horizon mask, the highest first.

    Elements that SGP4 refuses are left out.
    """
    nearest = nearest_in_epoch_of_each(entries, t_utc_ns)
    if not nearest:
        return ()
    now = standing(nearest, site, np.array([t_utc_ns, t_utc_ns + STEP_S * NS_PER_S]), limits)
    is_up = now.margin_deg[:, 0] > 0.0
    there = [each for each, up in zip(nearest, is_up, strict=True) if up]
    if not there:
        return ()
    ra_deg, dec_deg = unit_to_direction(now.line_km[is_up])
    rates = np.asarray(separation_deg(ra_deg[:, 0], dec_deg[:, 0], ra_deg[:, 1], dec_deg[:, 1]))
    lit = lit_fraction(now.r_km[is_up, 0], t_utc_ns) >= LIT_SHARE
    left = _minutes_left(there, site, t_utc_ns, limits)
    found = [
        Up(
            norad_id=each.norad_id,
            name=each.name or str(each.norad_id),
            ra_icrs_deg=float(ra_deg[n, 0]),
            dec_icrs_deg=float(dec_deg[n, 0]),
            alt_deg=float(now.alt_deg[is_up][n, 0]),
            az_deg=float(now.az_deg[is_up][n, 0]),
            is_lit=bool(lit[n]),
            rate_arcsec_s=float(rates[n]) * 3600.0 / STEP_S,
            minutes_left=None if np.isinf(left[n]) else float(left[n]),
        )
        for n, each in enumerate(there)
    ]
    return tuple(sorted(found, key=lambda up: -up.alt_deg))


def _minutes_left(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: int, limits: LimitsConfig
) -> FloatArray:
    """Minutes until the margin of each is used up; infinite where it is not."""
    minutes = np.array(MINUTES)
    t = t_utc_ns + minutes.astype(np.int64) * 60 * NS_PER_S
    margin = standing(entries, site, t, limits).margin_deg
    is_down = margin <= 0.0
    first = np.argmax(is_down, axis=1)
    rows = np.arange(len(entries))
    last = np.maximum(first - 1, 0)
    before, after = margin[rows, last], margin[rows, first]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before / (before - after)
        left = minutes[last] + share * (minutes[first] - minutes[last])
    return np.where(is_down.any(axis=1), left, np.inf)
