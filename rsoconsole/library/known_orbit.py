"""``rso.orbit``: an orbit with its elements, errors, predicted directions, and TLE or OMM."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rsoconsole.base import InputError, OrbitError
from rsoconsole.library._given import ConfigLike, Instant, Number, Place, instants_utc_ns, site_of
from rsoconsole.library._observed import CallerValues, Observations, read_observation_groups
from rsoconsole.library.formats.tables import to_astropy_time
from rsoconsole.orbits import (
    ANALYST_NUMBERS,
    MeasuredDirections,
    PriorName,
    omm_message,
    period_s,
    predict,
)
from rsoconsole.orbits import Orbit as Determined
from rsoconsole.pipeline import (
    FittedElements,
    FoundOrbit,
    OrbitArc,
    element_sigmas,
    elements_by_name,
    find_by_gooding,
    find_orbit,
    orbit_elements,
    orbit_report,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import icrs_to_altaz, lit_fraction

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord
    from astropy.table import QTable
    from astropy.time import Time
    from astropy.units import Quantity

Label = Literal["free", "constrained by prior", "weak geometry", "not observable"]
OmmForm = Literal["kvn", "xml", "json"]
_UNITS = {"a_km": "km", "i_deg": "deg", "raan_deg": "deg", "argp_deg": "deg", "m_deg": "deg"}


class Orbit:
    """An orbit found by ``rso.orbit``, with its errors.

    State, covariance and elements are osculating, along GCRS axes, at ``epoch``. ``tle`` and
    ``omm`` give mean elements in TEME, as SGP4 requires.
    """

    def __init__(self, found: FoundOrbit, orbit: Determined) -> None:
        self._found = found
        self._orbit = orbit
        self._elements = elements_by_name(orbit.r_km, orbit.v_km_s)

    # -- how well it is known --------------------------------------------------------------------

    @property
    def label(self) -> Label:
        """Label for how well the directions determine the orbit; ``reason`` explains it."""
        return self._orbit.label

    @property
    def reason(self) -> str:
        """Reason for the label, in words."""
        return self._found.reason

    @property
    def prior(self) -> str:
        """Name of the prior used in the fit; "none" for a free orbit."""
        return self._orbit.prior

    @property
    def observations(self) -> int:
        """Number of directions used."""
        return len(self._found.seen)

    @property
    def outliers(self) -> int:
        """Number of directions left out of the fit."""
        return self._orbit.outliers

    @property
    def not_used(self) -> tuple[str, ...]:
        """Lines of the files that gave no direction, each with its place and why."""
        return self._found.not_used

    @property
    def rivals(self) -> int:
        """Number of other orbits that fit the directions as well as this orbit."""
        return self._orbit.rivals

    @property
    def rms(self) -> "Quantity":
        """Root mean square residual of the used directions, per axis, arcsec."""
        return _quantity(self._orbit.rms_arcsec, "arcsec")

    @property
    def arc(self) -> "Quantity":
        """Time from the first direction to the last."""
        seen = self._found.seen
        return _quantity(float(seen.t_s[-1] - seen.t_s[0]), "s")

    @property
    def parts(self) -> tuple[OrbitArc, ...]:
        """Arcs, each after the first with the probability that it shows the same object."""
        return self._found.parts

    # -- what it is ------------------------------------------------------------------------------

    @property
    def epoch(self) -> "Time":
        """Epoch of state and elements, UTC."""
        return to_astropy_time(np.asarray(self._orbit.epoch_utc_ns))

    @property
    def a(self) -> "Quantity":
        """Semi-major axis."""
        return self._element("a_km")

    @property
    def e(self) -> float:
        """Eccentricity."""
        return self._elements["e"]

    @property
    def i(self) -> "Quantity":
        """Inclination."""
        return self._element("i_deg")

    @property
    def raan(self) -> "Quantity":
        """Right ascension of the ascending node."""
        return self._element("raan_deg")

    @property
    def argp(self) -> "Quantity":
        """Argument of perigee."""
        return self._element("argp_deg")

    @property
    def mean_anomaly(self) -> "Quantity":
        """Mean anomaly at the epoch."""
        return self._element("m_deg")

    @property
    def period(self) -> "Quantity":
        """Period of revolution."""
        return _quantity(period_s(self._elements["a_km"]), "s")

    @property
    def sigma_a(self) -> "Quantity":
        """One sigma of the semi-major axis."""
        return _quantity(self._orbit.sigma_a_km, "km")

    @property
    def sigmas(self) -> "dict[str, Quantity | float | None]":
        """One sigma of each element, by the name that the element has as a property.

        None for an element that the orbit does not define: the node of an equatorial orbit, the
        perigee of a circular orbit.
        """
        return {
            "mean_anomaly" if key == "m_deg" else key.partition("_")[0]: value
            if value is None or key not in _UNITS
            else _quantity(value, _UNITS[key])
            for key, value in element_sigmas(self._orbit).items()
        }

    @property
    def r(self) -> "Quantity":
        """Position at the epoch, (3,), GCRS, geocentric."""
        return _quantity(self._orbit.r_km, "km")

    @property
    def v(self) -> "Quantity":
        """Velocity at the epoch, (3,), GCRS."""
        return _quantity(self._orbit.v_km_s, "km / s")

    @property
    def covariance(self) -> FloatArray:
        """Covariance (6, 6) of ``r`` and ``v``, in km and km/s."""
        return self._orbit.covariance.copy()

    @property
    def site(self) -> Site:
        """Site from which the longest arc was observed."""
        return self._found.observed.site

    # -- where it will be ------------------------------------------------------------------------

    def gcrs(self, times: Instant) -> "SkyCoord":
        """Return geocentric positions in GCRS at these times, with distance and velocity.

        ``times``: a ``Time``, () or (N,). NaN for times after the object has come down.
        """
        from astropy import units
        from astropy.coordinates import (
            GCRS,
            CartesianDifferential,
            CartesianRepresentation,
            SkyCoord,
        )

        t = instants_utc_ns(times, "times")
        r, v = (each.T.reshape(3, *t.shape) for each in self._orbit.states(np.atleast_1d(t)))
        velocity = CartesianDifferential(v * units.km / units.s)
        at = CartesianRepresentation(r * units.km, differentials=velocity)
        return SkyCoord(at, frame=GCRS(obstime=to_astropy_time(t)))

    def predict(self, times: Instant, site: Place | None = None) -> "QTable":
        """Return a table of predicted directions at these times, with errors, a row an instant.

        ``times``: a ``Time``, () or (N,). ``site``: None for the site of the observations.

        ``time``: the instant.
        ``direction``: ``SkyCoord``, ICRS, astrometric, as a plate solution would measure it: light
            time and the Earth's motion are accounted for.
        ``range``: distance from the site.
        ``sigma``: longer half axis of the one-sigma ellipse.
        ``cov_ee``, ``cov_en``, ``cov_nn``: covariance on the sky.
        ``rate_ra``, ``rate_dec``: rates on the sky; ``rate_ra`` is times cos dec.
        ``altitude``, ``azimuth``: without refraction.
        ``lit``: fraction of the Sun's disk that is visible from the object.

        NaN for instants after the object has come down. Raises InputError.
        """
        from astropy import units
        from astropy.coordinates import SkyCoord
        from astropy.table import QTable

        t = np.atleast_1d(instants_utc_ns(times, "times"))
        where = self.site if site is None else site_of(site)
        found = predict(self._orbit, where, t)
        places, cov = found.places, found.cov_sky_arcsec2
        altitude, azimuth = icrs_to_altaz(where, places.ra_icrs_deg, places.dec_icrs_deg, t)
        cos_dec = np.cos(np.radians(places.dec_icrs_deg))
        arcsec_s = units.arcsec / units.s
        table = QTable(meta={"label": self.label, "epoch": self.epoch.isot, "frame": "ICRS"})
        table["time"] = to_astropy_time(t)
        table["direction"] = SkyCoord(
            places.ra_icrs_deg, places.dec_icrs_deg, unit="deg", frame="icrs"
        )
        table["range"] = places.range_km * units.km
        table["sigma"] = found.sigma_arcsec * units.arcsec
        for n, name in enumerate(("cov_ee", "cov_en", "cov_nn")):
            table[name] = cov[:, n] * units.arcsec**2
        table["rate_ra"] = places.ra_rate_deg_s * cos_dec * 3600.0 * arcsec_s
        table["rate_dec"] = places.dec_rate_deg_s * 3600.0 * arcsec_s
        table["altitude"] = altitude * units.deg
        table["azimuth"] = azimuth * units.deg
        table["lit"] = lit_fraction(places.position_gcrs_km, t)
        return table

    # -- for others ------------------------------------------------------------------------------

    def tle(self, *, norad_id: int | None = None, name: str = "UNKNOWN", cospar: str = "") -> str:
        """Return elements for SGP4 as text: a line with ``name``, then two lines; TEME.

        ``norad_id``: catalogue number; None: a number for unknown objects. ``cospar``: as
        ``2009-064A``. Raises OrbitError where the orbit is not known well enough for elements,
        where SGP4 does not reproduce it, and where the number does not fit into the lines.
        """
        fitted = self._fitted(norad_id, name, cospar)
        if fitted.tle is None:
            raise OrbitError(f"no elements: {fitted.reason}")
        return "\n".join((name, *fitted.tle)) + "\n"

    def omm(
        self,
        form: OmmForm = "kvn",
        *,
        norad_id: int | None = None,
        name: str = "UNKNOWN",
        cospar: str = "",
    ) -> str:
        """Return elements for SGP4 as a CCSDS Orbit Mean-Elements Message (OMM).

        ``form``: form of the message; the other arguments are those of ``tle``. All digits are
        written and any number fits. Raises OrbitError where there are no such elements.
        """
        fitted = self._fitted(norad_id, name, cospar)
        if fitted.mean is None:
            raise OrbitError(f"no elements: {fitted.reason}")
        return omm_message(fitted.mean, created_utc_ns=time.time_ns(), form=form)

    def report(self) -> dict[str, Any]:
        """Return the report of ``rsoconsole orbit --json``, without predictions and elements."""
        return orbit_report(self._found, None)

    @property
    def seen(self) -> MeasuredDirections:
        """Directions from which the orbit was found."""
        return self._found.seen

    def __repr__(self) -> str:
        a, sigma = self._elements["a_km"], self._orbit.sigma_a_km
        return (
            f"<Orbit {self.label}: a {a:.1f} ± {sigma:.1f} km, e {self.e:.5f},"
            f" i {self._elements['i_deg']:.3f} deg, {self.observations} directions over"
            f" {self.arc.to_value('min'):.1f} min>"
        )

    def _element(self, key: str) -> "Quantity":
        return _quantity(self._elements[key], _UNITS[key])

    def _fitted(self, norad_id: int | None, name: str, cospar: str) -> FittedElements:
        number = ANALYST_NUMBERS.start if norad_id is None else norad_id
        return orbit_elements(self._found, norad_id=number, name=name, cospar=cospar)


def _quantity(value: Any, unit: str) -> "Quantity":
    from astropy.units import Quantity

    return Quantity(value, unit)


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
    """Find the orbit of an observed object, as ``rsoconsole orbit`` does.

    ``observations``: a track of ``rso.track``; a table of one object, as ``rso.track`` takes it; a
    session (``rso.open_session``) or its path; a file (CCSDS TDM, IOD and UK lines, tables, JSON);
    or a list of these, such as several nights of one object.
    ``prior``: what is assumed of the orbit: ``"auto"`` only what is needed, ``"none"``, ``"slot"``
    (held over the equator), ``"geo"``, ``"meo"``, ``"leo"`` (nearly circular).
    ``method``: ``"gooding"`` for Gooding's orbit through only three of the directions.
    ``track``: number of the only track of a session, as ``night.tracks`` numbers them; None: the
    longest track, and others that the same orbit fits.
    ``sigma``: error of directions that state none, arcsec; None: 1.
    ``site``: site of observations that do not state theirs.
    ``target``: name of the object in a file of several.
    ``radians``: True where a file's angles are in radians and the file does not say so.
    ``config``: gives the site of a table that has none.

    Returns an ``rso.Orbit``: elements as quantities, covariance, label, predicted directions,
    elements for SGP4. Directions are taken as astrometric: aberration and light time are accounted
    for here.

    Raises OrbitError, with the reason, where no orbit is found; InputError, OrbitError, ExportError
    or SessionError for observations that cannot be used.

    >>> found = rso.orbit(tracks[1])
    >>> found.label, found.a, found.sigma_a, found.predict(Time.now() + [1, 2] * u.h)
    """
    if method not in ("least squares", "gooding"):
        raise InputError(f"method: {method!r} is neither 'least squares' nor 'gooding'")
    if prior not in ("auto", "none", "slot", "geo", "meo", "leo"):
        raise InputError(f"prior: {prior!r} is none of auto, none, slot, geo, meo, leo")
    ask = CallerValues(
        sigma=sigma, site=site, track=track, target=target, radians=radians, config=config
    )
    groups = read_observation_groups(observations, ask)
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
