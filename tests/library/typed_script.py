"""A script as a user writes it: ``test_types.py`` gives it to a type checker.

A line that is right ends in ``# is TYPE``; one that is wrong, on purpose, in ``# error: CODE``.
"""

# mypy: disable-error-code="used-before-def"
from pathlib import Path

import numpy as np

import rsoconsole as rso

pixels = np.zeros((100, 100), np.uint16)
streaks = rso.detect([Path("a.fits"), pixels], tau=0.2)
plate = rso.solve("a.fits", ra=10.0, dec=2.0, scale=(2.0, 3.0))
measured = rso.measure("a.fits", site=(47.1, 8.5, 620.0))
tracks = rso.track(measured, preset="adaptive")
found = rso.orbit(tracks[1], prior="slot")
name = rso.identify(found, tle="catalogue.tle")
night = rso.open_session("night")
curve = rso.lightcurve(night, track=2)

reveal_type(plate)  # is rsoconsole.library.plate.PlateWCS
reveal_type(plate.matched)  # is int
reveal_type(rso.solve(["a.fits", pixels]))  # is list[rsoconsole.library.plate.PlateWCS]
reveal_type(tracks)  # is rsoconsole.library.tracking.Tracks
reveal_type(tracks[1].nis_mean)  # is float | None
reveal_type(found)  # is rsoconsole.library.known_orbit.Orbit
reveal_type(found.e)  # is float
reveal_type(found.tle(norad_id=36097))  # is str
reveal_type(name)  # is rsoconsole.library.identification.Identification
reveal_type(name.norad_id)  # is int | None
reveal_type(rso.identify(tracks))  # is dict[int, rsoconsole.library.identification.Identification]
reveal_type(rso.identify(night))  # is dict[int, rsoconsole.library.identification.Identification]
reveal_type(night)  # is rsoconsole.library.notebook.session.Session
reveal_type(night.tracks[2].orbit)  # is rsoconsole.records.steps.OrbitEstimate | None
reveal_type(curve)  # is rsoconsole.library.light_curve.LightCurve
reveal_type(curve.period)  # is rsoconsole.night.light_period.LightPeriod | None
reveal_type(rso.__version__)  # is str
reveal_type(rso.to_udl(night, norad=36097))  # is str
a, b = "a@b.org", "0000-0002-1825-0097"
table = rso.to_score(
    "night", norad=1, observer_email=a, observer_orcid=b, detector="CCD", filter="V"
)
reveal_type(table)  # is str

rso.detect(3)  # error: arg-type
rso.detect("a.fits", tau="high")  # error: arg-type
rso.detect("a.fits", threshold=0.2)  # error: call-arg
rso.solve("a.fits", scale="2.5")  # error: call-overload
rso.measure("a.fits", t_start="2026-01-01T00:00:00")  # error: arg-type
rso.measure("a.fits", site="Daytona")  # error: arg-type
rso.track(measured, preset="kalman")  # error: arg-type
rso.orbit(tracks)  # error: arg-type
rso.orbit(tracks[1], prior="low")  # error: arg-type
rso.identify(found, gate="wide")  # error: call-overload
found.omm("yaml")  # error: arg-type
found.sigma  # error: attr-defined
name.name.upper()  # error: union-attr
rso.lightcurve(3)  # error: arg-type
rso.tracks  # error: attr-defined
rso.to_udl(night, norad="36097")  # error: arg-type
rso.to_score(night, norad=1, observer_email=a)  # error: call-arg
