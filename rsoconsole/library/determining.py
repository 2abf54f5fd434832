"""``rso.orbit``: the orbit of what was observed, and how well it is known."""

from collections.abc import Sequence
from typing import Literal

from rsoconsole.errors import InputError, OrbitError
from rsoconsole.library.given import ConfigLike, Number, Place
from rsoconsole.library.known_orbit import Orbit
from rsoconsole.library.observed import Asked, Observations, groups_of
from rsoconsole.orbits.determination import PriorName
from rsoconsole.pipeline.orbits import find_by_gooding, find_orbit

Method = Literal["least squares", "gooding"]


def orbit(
    observations: Observations | Sequence[Observations],
    *,
    prior: PriorName = "auto",
    method: Method = "least squares",
    track: int | None = None,
    sigma: Number | None = None,
    site: Place | None = None,
    target: str | None = None,
    radians: bool | None = None,
    config: ConfigLike = None,
) -> Orbit:
    """Find the orbit of what was observed, as ``rsoconsole orbit`` does.

    ``observations``: a track of ``rso.track``; a table of one object, as ``rso.track`` takes it;
    a session (``rso.open_session``) or its path; a file (CCSDS TDM, IOD and UK lines, tables,
    JSON); or a list of these, several nights of one object. ``prior``: what is believed of the
    orbit beforehand: ``"auto"`` only what is needed, ``"none"``, ``"slot"`` (held over the
    equator), ``"geo"``, ``"meo"`` (nearly circular). ``method``: ``"gooding"`` for Gooding's
    orbit through three of the directions alone. ``track``: which of a session's, as
    ``night.tracks`` numbers them; None: the longest, and others that one orbit fits too.
    ``sigma`` (arcsec): of directions that state none; None: 1. ``site``: of those that do not
    say it. ``target``: which object of a file of several. ``radians``: what a file's angles are
    in where it does not say. ``config``:
    for the site of tables without one.

    Returns an ``rso.Orbit``: elements as quantities, covariance, label, places ahead, elements
    for SGP4. Directions are taken as astrometric: aberration and light time are dealt with here.

    Raises OrbitError where no orbit is found, saying why; InputError, OrbitError, ExportError or
    SessionError for observations that cannot be used.

    >>> found = rso.orbit(tracks[1])
    >>> found.label, found.a, found.sigma_a, found.predict(Time.now() + [1, 2] * u.h)
    """
    if method not in ("least squares", "gooding"):
        raise InputError(f"method: {method!r} is neither 'least squares' nor 'gooding'")
    if prior not in ("auto", "none", "slot", "geo", "meo"):
        raise InputError(f"prior: {prior!r} is none of auto, none, slot, geo, meo")
    ask = Asked(sigma=sigma, site=site, track=track, target=target, radians=radians, config=config)
    groups = groups_of(observations, ask)
    if method == "gooding":
        if len(groups) > 1:
            raise InputError("gooding takes one session, file or track")
        found = find_by_gooding(groups[0][0])
    else:
        others = [each for group in groups for each in group[1:]]
        found = find_orbit([group[0] for group in groups], prior=prior, others=others)
    if found.orbit is None:
        raise OrbitError(f"no orbit: {found.reason}")
    return Orbit(found, found.orbit)
