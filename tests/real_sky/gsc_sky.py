"""Stands in for ``gsc``, which INDI's CCD simulator asks for the stars of each exposure.

    gsc -c RA DEC -r ARCMIN -m BRIGHTEST FAINTEST -n LINES

The answer holds the stars of the cone and, as rows of points, the streaks of satellites that
are where their elements put them from the moment of this call on. ``serving`` lays the command into
a folder and answers it: the camera's driver stands still until it is answered, so that the command
itself only notes the time and asks somebody who is awake. Each call adds a line to the truth, in
the words of the simulated observatory's. The points of a streak lie closer than the
seeing disc is wide and share its light. They lie up to half a pixel left or right of the path: the
simulator drops what an exact path has beyond a whole pixel, which would shift all of a streak that
runs along a row of pixels by up to one of them.
"""

import argparse
import dataclasses
import json
import socketserver
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.orbits import Satellite, parse_elements
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import StarCatalogue, Stars, julian_year
from tests.truth.ccd_law import CcdLaw

NS = 1_000_000_000
COMMAND = """#!/bin/bash
called="$EPOCHREALTIME"
exec 3<>/dev/tcp/127.0.0.1/{port} || exit 1
echo "$called $*" >&3
exec cat <&3
"""
"""Two thousandths of a second from the call to the note of it."""
SPACING_FWHM = 0.7
"""Of a streak's points; their sum is even to a few thousandths."""
_GOLDEN = 0.6180339887498949
LINE = "{id:>10s} {ra:.6f} {dec:+.6f} 0.2 {magnitude:.3f} 0.30 0 0 0000 F {apart:.2f} {towards:d}\n"
"""Identifier, RA, Dec, error of place, magnitude, its error, band, class, plate, multiple or not,
distance (arcmin) and position angle (deg) from the centre asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """What is above one telescope, and when a streak is drawn."""

    site: Site
    elements: Path
    """Two-line elements of what is really there."""
    magnitudes: dict[int, float]
    """By catalogue number: fully lit, at 36,000 km."""
    truth: Path
    """JSON lines, one a call."""
    law: CcdLaw = field(default_factory=CcdLaw)
    stars: Path | None = None
    """As ``models.star_catalogue`` writes them; None: those of the product."""
    exposure_s: float = 10.0
    seed: int = 1
    scatter_s: float = 0.0
    """One sigma of the streak's time about that of the call."""

    def save(self, path: Path) -> None:
        """For ``load``."""
        path.write_text(json.dumps(dataclasses.asdict(self), default=str), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "Sky":
        """What ``save`` wrote."""
        told = json.loads(path.read_text(encoding="utf-8"))
        told["site"], told["law"] = Site(**told["site"]), CcdLaw(**told["law"])
        told["elements"], told["truth"] = Path(told["elements"]), Path(told["truth"])
        told["stars"] = None if told["stars"] is None else Path(told["stars"])
        told["magnitudes"] = {int(each): value for each, value in told["magnitudes"].items()}
        return cls(**told)

    def satellites(self) -> list[Satellite]:
        """Those that have a brightness."""
        found = parse_elements(self.elements.read_text(encoding="ascii"), self.elements.name)
        return [
            Satellite(each, self.magnitudes[each.norad_id])
            for each in found
            if each.norad_id in self.magnitudes
        ]

    def scatter_of_call_s(self, call: int) -> float:
        """By how much later than its call the streak of the call is drawn."""
        return float(np.random.default_rng([self.seed, call]).normal(0.0, 1.0)) * self.scatter_s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Streak:
    """One satellite in one exposure: points of equal light, and the truth."""

    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    point_magnitude: float
    truth: dict[str, Any]


def streaks(
    sky: Sky, centre_deg: tuple[float, float], t_call_utc_ns: int, scatter_s: float
) -> list[Streak]:
    """Those with light in the cone that a sensor of this size asks for."""
    radius_deg = sky.law.radius_arcmin / 60.0
    found = []
    for satellite in sky.satellites():
        streak = _streak(sky, satellite, centre_deg, t_call_utc_ns, scatter_s)
        if streak is not None and streak.truth["apart_deg"] <= radius_deg + 0.1:
            found.append(streak)
    return found


def _streak(
    sky: Sky,
    satellite: Satellite,
    centre_deg: tuple[float, float],
    t_call_utc_ns: int,
    scatter_s: float,
) -> Streak | None:
    exposure_ns = round(sky.exposure_s * NS)
    ends_ns = t_call_utc_ns + np.array([0, exposure_ns // 2, exposure_ns], np.int64)
    at = satellite.astrometric_place(sky.site, ends_ns)
    magnitude = float(satellite.magnitude(at)[1])
    if not np.all(np.isfinite([*at.ra_icrs_deg, magnitude])):
        return None
    # The rates of each instant carry it over the scatter; a parabola through three of them is exact
    # to a milliarcsecond over an exposure.
    ra = np.unwrap(at.ra_icrs_deg, period=360.0) + at.ra_rate_deg_s * scatter_s
    dec = at.dec_icrs_deg + at.dec_rate_deg_s * scatter_s
    cos_dec = float(np.cos(np.radians(dec[1])))
    length_arcsec = 3600.0 * float(np.hypot((ra[2] - ra[0]) * cos_dec, dec[2] - dec[0]))
    points = max(1, int(np.ceil(length_arcsec / (SPACING_FWHM * sky.law.seeing_arcsec))))
    share = (np.arange(points) + 0.5) / points
    path_ra, path_dec = (
        np.polyval(np.polyfit([0.0, 0.5, 1.0], each - each[1], 2), share) + each[1]
        for each in (ra, dec)
    )
    across_deg = sky.law.scale_arcsec_px / 3600.0 * (np.arange(points) * _GOLDEN % 1.0 - 0.5)
    along = np.array([(ra[2] - ra[0]) * cos_dec, dec[2] - dec[0]])
    east, north = along / max(float(np.hypot(*along)), 1e-12)
    path_ra = path_ra - across_deg * north / cos_dec
    path_dec = path_dec + across_deg * east
    point_magnitude = sky.law.point_magnitude(magnitude, points)
    truth = {
        "name": satellite.element_set.name,
        "norad_id": satellite.element_set.norad_id,
        "ra_icrs_deg": float(at.ra_icrs_deg[1]),
        "dec_icrs_deg": float(at.dec_icrs_deg[1]),
        "ra_drawn_icrs_deg": float(ra[1] % 360.0),
        "dec_drawn_icrs_deg": float(dec[1]),
        "ra_rate_deg_s": float(at.ra_rate_deg_s[1]),
        "dec_rate_deg_s": float(at.dec_rate_deg_s[1]),
        "magnitude": magnitude,
        "points": points,
        **_on_sensor(
            sky.law,
            sky.law.pixel(path_ra, path_dec, centre_deg),
            sky.law.flux_adu(point_magnitude, sky.exposure_s),
        ),
    }
    return Streak(
        ra_icrs_deg=path_ra % 360.0,
        dec_icrs_deg=path_dec,
        point_magnitude=point_magnitude,
        truth=truth,
    )


def _on_sensor(
    law: CcdLaw, path_px: tuple[FloatArray, FloatArray], flux_adu: float
) -> dict[str, Any]:
    """How much of a streak the sensor sees; half a turn of the camera does not change it."""
    x, y = path_px
    is_on = law.on_sensor(x, y)
    apart_px = float(np.hypot(x.mean() - law.width_px / 2, y.mean() - law.height_px / 2))
    found = {
        "is_in_frame": bool(is_on[len(is_on) // 2]),
        "is_whole": bool(is_on[0] and is_on[-1]),
        "apart_deg": apart_px * law.scale_arcsec_px / 3600.0,
        "snr_matched": 0.0,
        "light_adu": 0.0,
    }
    if is_on.any():
        patch = law.drawn_adu(x[is_on], y[is_on], flux_adu)
        found["snr_matched"] = law.snr_integrated(patch)
        found["light_adu"] = float(patch.sum())
    return found


def answer(
    sky: Sky,
    centre_deg: tuple[float, float],
    radius_arcmin: float,
    asked: tuple[float, float, int],
    t_call_utc_ns: int,
) -> list[str]:
    """The stars' lines where they are on that day, brightest first.

    ``asked``: brightest and faintest magnitude, lines.
    """
    brightest, faintest, lines = asked
    catalogue = StarCatalogue.load(sky.stars)
    now = julian_year(t_call_utc_ns)
    stars = catalogue.cone(*centre_deg, radius_arcmin / 60.0, epoch_jyear=now)
    is_asked = (stars.magnitude >= brightest) & (stars.magnitude <= faintest)
    kept = np.flatnonzero(is_asked)[: max(lines, 0)]
    columns = (stars.ra_icrs_deg, stars.dec_icrs_deg, stars.magnitude)
    return _lines(
        "S", Stars.without_proper_motion(*(column[kept] for column in columns)), centre_deg
    )


def _lines(kind: str, points: Stars, centre_deg: tuple[float, float]) -> list[str]:
    east = (points.ra_icrs_deg - centre_deg[0] + 180.0) % 360.0 - 180.0
    east = east * np.cos(np.radians(centre_deg[1]))
    north = points.dec_icrs_deg - centre_deg[1]
    apart = 60.0 * np.hypot(east, north)
    towards = np.degrees(np.arctan2(east, north)) % 360.0
    rows = zip(
        points.ra_icrs_deg, points.dec_icrs_deg, points.magnitude, apart, towards, strict=True
    )
    return [
        LINE.format(id=f"{kind}{i:08d}", ra=ra, dec=dec, magnitude=mag, apart=d, towards=int(angle))
        for i, (ra, dec, mag, d, angle) in enumerate(rows)
    ]


def tell(sky: Sky, arguments: Sequence[str], t_call_utc_ns: int) -> list[str]:
    """What the command prints; a line of truth for each call."""
    asked = _asked(arguments)
    centre_deg = (asked.c[0], asked.c[1])
    calls = len(sky.truth.read_bytes().splitlines()) if sky.truth.exists() else 0
    scatter_s = sky.scatter_of_call_s(calls)
    drawn = streaks(sky, centre_deg, t_call_utc_ns, scatter_s)
    said = []
    for each in drawn:
        magnitudes = np.full(len(each.ra_icrs_deg), each.point_magnitude)
        said += _lines(
            "P",
            Stars.without_proper_motion(each.ra_icrs_deg, each.dec_icrs_deg, magnitudes),
            centre_deg,
        )
    said += answer(
        sky, centre_deg, asked.r, (asked.m[0], asked.m[1], asked.n - len(said)), t_call_utc_ns
    )
    record = {
        "call": calls,
        "t_start_utc_ns": t_call_utc_ns,
        "exposure_s": sky.exposure_s,
        "scatter_s": scatter_s,
        "boresight_ra_icrs_deg": centre_deg[0],
        "boresight_dec_icrs_deg": centre_deg[1],
        "lines": len(said),
        "satellites": [each.truth for each in drawn],
        "ms": (time.time_ns() - t_call_utc_ns) / 1e6,
    }
    with sky.truth.open("a", encoding="utf-8") as file:
        file.write(json.dumps(record) + "\n")
    return said


def _asked(arguments: Sequence[str]) -> argparse.Namespace:
    """The options of the real command that the simulator gives."""
    parser = argparse.ArgumentParser(prog="gsc")
    parser.add_argument("-c", nargs=2, type=float, required=True)
    parser.add_argument("-r", type=float, required=True)
    parser.add_argument("-m", nargs=2, type=float, default=(0.0, 20.0))
    parser.add_argument("-n", type=int, default=3000)
    return parser.parse_args(arguments)


@contextmanager
def serving(sky: Sky, folder: Path) -> Iterator[Path]:
    """The command ``gsc`` in a folder for the front of PATH, answered while this lasts."""

    class Asked(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            called, *arguments = self.rfile.readline().decode().split()
            seconds, _, fraction = called.replace(",", ".").partition(".")
            t_call_utc_ns = int(seconds) * NS + int(fraction.ljust(9, "0"))
            self.wfile.write("".join(tell(sky, arguments, t_call_utc_ns)).encode())

    with socketserver.TCPServer(("127.0.0.1", 0), Asked) as server:
        command = folder / "gsc"
        port = server.server_address[1]
        command.write_text(COMMAND.format(port=port), encoding="ascii")
        command.chmod(0o755)
        thread = threading.Thread(target=server.serve_forever, daemon=True, name="sky")
        thread.start()
        try:
            yield command
        finally:
            server.shutdown()
            thread.join()
