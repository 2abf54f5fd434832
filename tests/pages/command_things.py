"""What the names on the pages refer to: frames, nights, elements, each made once."""

import math
import shutil
import time
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from astropy.io import fits
from sgp4.api import WGS72, Satrec
from sgp4.exporter import export_tle

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator import DAYTONA_BEACH, Scene, elements_path, scenario_named
from rsoconsole.sky import StarCatalogue, iso_to_utc_ns
from rsoconsole.words import NS_PER_DAY, utc_ns_to_iso
from tests.cli.test_calibrate_elements import SLOTS
from tests.cli.test_calibrate_elements import night as night_of_slots
from tests.nights.samples import SAMPLE, SESSIONS
from tests.pipeline.test_navigation_files import BROADCAST_2, PRECISE, epochs_of
from tests.truth.navigation_truth import (
    GPS_MINUS_UTC_S,
    Constellation,
    Plan,
    Shutter,
    flight_of_file,
)
from tests.truth.navigation_truth import night as navigation_night
from tests.truth.seen_satellites import geostationary
from tests.truth.sidereal import gmst_deg

FRAMES = tuple(sorted((SESSIONS / "frames").glob("*.fits.fz")))
"""Six of a simulated night; Intelsat 14 is in all but the last."""
TARGET, TARGET_NAME = 36097, "INTELSAT 14"
BELT = elements_path()
WIDE = OpticsConfig(width_px=960, height_px=720, pixel_um=6.75, focal_length_mm=135.0)
"""Such as the page's example of ``solve`` has: 10.3 arcsec a pixel."""


def site_toml(longitude_deg: float = DAYTONA_BEACH.longitude_deg) -> str:
    """A configured site, the demo's or at another longitude."""
    return (
        "[site]\n"
        'name = "beach"\n'
        f"latitude_deg = {DAYTONA_BEACH.latitude_deg}\n"
        f"longitude_deg = {longitude_deg}\n"
        f"elevation_m = {DAYTONA_BEACH.elevation_m}\n"
    )


def noon_deg() -> float:
    """The longitude where it is noon now: a whole night lies ahead of it."""
    hours = time.time() % 86_400.0 / 3600.0
    return 15.0 * (12.0 - hours)


class Things:
    """Made in a folder of their own when first wanted; houses get copies."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @cached_property
    def frames(self) -> tuple[Path, ...]:
        """The six frames as plain FITS files."""
        folder = self._folder / "frames"
        folder.mkdir()
        return tuple(unpacked(each, folder / each.name.removesuffix(".fz")) for each in FRAMES)

    @cached_property
    def fonts(self) -> Path:
        """Where matplotlib notes what fonts there are, for all houses."""
        folder = self._folder / "fonts"
        folder.mkdir()
        return folder

    @cached_property
    def navigation_night(self) -> Path:
        """Streaks of satellites that go by published precise orbits, a shutter 137 ms late."""
        t0 = iso_to_utc_ns("2021-04-28T18:00:00Z")
        flights = []
        told = epochs_of(PRECISE)
        for rows in told.values():
            t_gps_s = np.array([t for t, _ in rows]) / 1e9 + GPS_MINUS_UTC_S
            flights.append(flight_of_file(t_gps_s, np.array([p for _, p in rows]), t0))
        sky = Constellation(t0_utc_ns=t0, hours=4.4, names=list(told), flights=flights)
        plan = Plan(tracks=8, least_altitude_deg=10.0)
        return navigation_night(
            self._folder / "navigation", sky, Shutter(), plan, np.random.default_rng(6)
        )

    @cached_property
    def wide_frame(self) -> Path:
        """A field of the sky at the page's RA and Dec, of stars alone."""
        night = scenario_named("intelsat-14")
        scene = Scene(night, 1, optics=WIDE, catalogue=StarCatalogue.load_whole_sky())
        pixels, truth = scene.expose(303.2, 46.0, 0.0, False, night.t_start_utc_ns, 2.0)
        path = self._folder / "wide.fits"
        header = fits.Header()
        header["DATE-OBS"] = utc_ns_to_iso(truth.t_start_utc_ns, 6).removesuffix("Z")
        header["EXPTIME"] = 2.0
        fits.PrimaryHDU(pixels, header).writeto(path)
        return path

    def put_session(self, place: Path) -> Path:
        """The sample session, in which Intelsat 14 is followed."""
        shutil.copytree(SAMPLE, place)
        return place

    def put_night(self, place: Path, frames: Sequence[int] = range(6)) -> Path:
        """A folder of frames."""
        place.mkdir(parents=True)
        for n in frames:
            shutil.copy(self.frames[n], place)
        return place

    def put_mosaic(self, path: Path) -> Path:
        """Two chips, a streak on each."""
        units = [fits.PrimaryHDU(header=camera_cards(fits.getheader(self.frames[1])))]
        for version, n in enumerate((1, 2), start=1):
            units.append(fits.ImageHDU(fits.getdata(self.frames[n]), name="SCI"))
            units[-1].ver = version
        fits.HDUList(units).writeto(path)
        return path

    def put_navigation(self, here: Path, night: str) -> None:
        """The night, and the broadcast ephemerides of its day."""
        shutil.copytree(self.navigation_night, here / night)
        shutil.copy(BROADCAST_2, here / "BRDC00IGS.rnx")


def put_slots(here: Path, *nights: str) -> None:
    """Nights of three satellites 7 km ahead of their elements, and those in ``all.tle``."""
    for n, name in enumerate(nights):
        night_of_slots(here / name, 2.0 + n, *SLOTS)
    sets = [geostationary(number, slot) for number, slot in SLOTS.items()]
    lines = "".join(f"{each.line_1}\n{each.line_2}\n" for each in sets)
    (here / "all.tle").write_text(lines, encoding="ascii")


def unpacked(packed: Path, path: Path) -> Path:
    """The same image as an uncompressed file."""
    with fits.open(packed) as units:
        (image,) = [each for each in units if each.data is not None]
        fits.PrimaryHDU(image.data, camera_cards(image.header)).writeto(path)
    return path


def camera_cards(header: fits.Header) -> fits.Header:
    """What the camera's driver has written, without what describes a unit of a file."""
    return fits.Header([card for card in header.cards if card.keyword not in _OF_THE_UNIT])


_OF_THE_UNIT = {
    *("SIMPLE", "XTENSION", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "PCOUNT", "GCOUNT"),
    *("BSCALE", "BZERO", "EXTNAME"),
}


def low_elements() -> str:
    """Two dozen satellites 1,400 km up in six planes over the poles, of today."""
    now_utc_ns, lines = time.time_ns(), []
    for n in range(24):
        plane, place = divmod(n, 4)
        lines += elements(70001 + n, now_utc_ns, 30.0 * plane, 90.0 * place + 15.0 * plane)
    return "\n".join(lines) + "\n"


def pass_over(t_utc_ns: int) -> str:
    """25544, raised above the Earth's shadow, 10 deg north of the site at that time."""
    site = DAYTONA_BEACH
    overhead_deg = float(gmst_deg(t_utc_ns)) + site.longitude_deg
    orbit = through(overhead_deg, site.latitude_deg + 10.0, 51.6)
    return "\n".join(elements(25544, t_utc_ns, *orbit, name="ISS (ZARYA)", i_deg=51.6)) + "\n"


def gps_over_warsaw() -> str:
    """Four of a plane; 26407 is in the southeast of Warsaw, near the equator, on a winter night."""
    t = iso_to_utc_ns("2023-12-10T22:00:00Z")
    east_deg = float(gmst_deg(t)) + 21.0 + 25.0
    node_deg, anomaly_deg = through(east_deg, 7.0, 55.0)
    lines = []
    for n, number in enumerate((26407, 26690, 27663, 28129)):
        lines += elements(
            number,
            t,
            node_deg,
            anomaly_deg + 90.0 * n,
            name=f"GPS {number}",
            revolutions=2.0056,
            i_deg=55.0,
        )
    return "\n".join(lines) + "\n"


def through(ra_deg: float, dec_deg: float, i_deg: float) -> tuple[float, float]:
    """Node and argument of latitude (deg) of a circular orbit that goes north there."""
    u = math.asin(math.sin(math.radians(dec_deg)) / math.sin(math.radians(i_deg)))
    along = math.atan2(math.cos(math.radians(i_deg)) * math.sin(u), math.cos(u))
    return ra_deg - math.degrees(along), math.degrees(u)


def elements(
    number: int,
    epoch_utc_ns: int,
    node_deg: float,
    anomaly_deg: float,
    *,
    name: str = "",
    revolutions: float = 12.6,
    i_deg: float = 82.0,
) -> list[str]:
    """Name and two lines of a nearly circular orbit."""
    record = Satrec()
    record.sgp4init(
        WGS72,
        "i",
        number,
        epoch_utc_ns / NS_PER_DAY + 7306,  # days since 1949-12-31
        0.0,
        0.0,
        0.0,
        1e-3,
        0.0,
        math.radians(i_deg),
        math.radians(anomaly_deg % 360.0),
        revolutions * 2.0 * math.pi / 1440.0,
        math.radians(node_deg % 360.0),
    )
    record.intldesg = "23001A"
    return [name or f"LOW {number}", *export_tle(record)]
