"""Conversion of observations in any form to directions of one object, for orbits and names."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from rsoconsole.base import InputError, value_errors_as
from rsoconsole.library._given import ConfigLike, Number, Place, in_unit, required_site, site_of
from rsoconsole.library._observations import (
    TableLike,
    expect_one_object,
    expect_table,
    read_directions,
)
from rsoconsole.library.formats.observed import ReadOptions, read_observations
from rsoconsole.library.notebook.session import Session
from rsoconsole.library.tracking import Track
from rsoconsole.night import NightTrack
from rsoconsole.orbits import reduce_directions
from rsoconsole.pipeline import ObservedTrack, directions_from_measurements
from rsoconsole.records import Measurement, Site

Observations: TypeAlias = str | PathLike[str] | Session | Track | NightTrack | TableLike
"""Path of a session or of a file of observations, a session, a track, a table of one object."""
Group: TypeAlias = tuple[ObservedTrack, ...]
"""The tracks of one session, the longest first, or the observations of a single object."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CallerValues:
    """The caller's values for what observations do not state; None: not given."""

    sigma: Number | None = None
    site: Place | None = None
    track: int | None = None
    target: str | None = None
    radians: bool | None = None
    config: ConfigLike = None


def read_observation_groups(
    what: Observations | Sequence[Observations], ask: CallerValues
) -> list[Group]:
    """Read observations as groups of tracks, in the order given.

    A session gives one group, all its tracks; a file one group for each station; a track or a table
    one group. ``ask``: values given by the caller. Raises InputError for an argument without
    observations, and the errors of reading files and sessions.
    """
    if isinstance(what, list | tuple):
        if not what:
            raise InputError("no observations: the list is empty")
        return [group for each in what for group in _groups(each, ask)]
    return _groups(what, ask)


def _groups(what: Any, ask: CallerValues) -> list[Group]:
    if isinstance(what, Session | str | PathLike):
        path = what.path if isinstance(what, Session) else Path(fspath(what)).expanduser()
        groups = list(read_observations(path, _read_as(ask)))
        return groups if ask.track is None else [_only(groups, ask.track)]
    if isinstance(what, Track):
        return [(_observed_track(f"track {what.number}", what.number, what.site, what.taken),)]
    if isinstance(what, NightTrack):
        if ask.site is None:
            raise InputError(
                "a session's track does not say where it was seen from: give the session,"
                f" rso.orbit(night, track={what.number}), or site="
            )
        name = f"track {what.number}"
        return [(_observed_track(name, what.number, site_of(ask.site), what.measurements),)]
    if isinstance(what, Mapping):
        raise InputError(
            f"{len(what)} tracks: an orbit is of one object; take one of them, as in tracks[1]"
        )
    return [(_observed_table(what, ask),)]


def _read_as(ask: CallerValues) -> ReadOptions:
    sigma = 1.0 if ask.sigma is None else in_unit(ask.sigma, "arcsec", "sigma")
    if sigma <= 0.0:
        raise InputError(f"sigma: {sigma:g} arcsec must be above 0")
    return ReadOptions(
        sigma_arcsec=sigma,
        site=None if ask.site is None else site_of(ask.site),
        target=ask.target,
        is_radians=ask.radians,
    )


def _only(groups: list[Group], track: int) -> Group:
    """The track with this number, as ``night.tracks`` numbers the tracks."""
    known = [each for group in groups for each in group if each.track_id is not None]
    if not known:
        raise InputError("track: a file has none; only sessions do")
    chosen = [each for each in known if each.track_id == track]
    if not chosen:
        numbers = ", ".join(str(n) for n in sorted(each.track_id or 0 for each in known))
        raise InputError(f"there is no track {track}: there are {numbers}")
    return (chosen[0],)


def _observed_track(
    name: str, number_: int, site: Site, taken: Sequence[Measurement]
) -> ObservedTrack:
    with value_errors_as(InputError):
        seen = directions_from_measurements(site, taken)
    return ObservedTrack(
        name=name, site=site, limits=None, seen=seen, number=number_, track_id=number_
    )


def _observed_table(value: Any, ask: CallerValues) -> ObservedTrack:
    table = expect_table(value, "file, session, track or table of observations")
    # Nobody knows when a crossing was where, or where along itself one that the frame cuts was.
    for name, is_wanted in (("is_crossing", False), ("is_clipped", False), ("is_taken", True)):
        if name in table.colnames:
            table = table[np.asarray(table[name], bool) == is_wanted]
    rows = read_directions(table, 1.0 if ask.sigma is None else ask.sigma)
    expect_one_object(table)
    site = required_site(ask.site, rows.site, ask.config)
    with value_errors_as(InputError):
        seen = reduce_directions(
            site, rows.t_utc_ns, rows.ra_icrs_deg, rows.dec_icrs_deg, rows.cov_sky_arcsec2
        )
    return ObservedTrack(name="the table", site=site, limits=None, seen=seen)
