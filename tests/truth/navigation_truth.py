"""Nights with navigation satellites whose truth comes from elsewhere.

Orbits are integrated here (scipy's DOP853 in the field of a flattened Earth), turned into the
Earth's frame, written as SP3 and seen from the ground by skyfield with the IERS table as skyfield
reads it: neither the files' readers nor the product's frames, times and light times have a part.
"""

import itertools
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator, CubicHermiteSpline

from rsoconsole.config import Config
from rsoconsole.records import (
    CameraMode,
    Detection,
    Detections,
    FloatArray,
    FrameTaken,
    Measurement,
    measurement_id_of,
)
from rsoconsole.session import SessionWriter
from tests.makers import straight_detection

MU, J2, EARTH_KM = 398600.4418, 1.08262668e-3, 6378.1366
AU_KM, DAY_S = 149_597_870.7, 86_400.0
SITE = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
SCALE_ARCSEC, HEIGHT_PX, WIDTH_PX = 1.264, 3520, 4656
GPS_MINUS_UTC_S = 18
"""Since 2017."""


@cache
def timescale() -> Any:
    from skyfield.api import load
    from skyfield.data import iers

    scale = load.timescale(builtin=True)
    table = files("astropy_iers_data") / "data" / "finals2000A.all"
    with table.open("rb") as lines:
        iers.install_polar_motion_table(scale, iers.parse_x_y_dut1_from_finals_all(lines))
    return scale


@cache
def earth() -> Any:
    import skyfield_data
    from skyfield.api import load_file

    return load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))["earth"]


def instants(t_utc_ns: Any) -> Any:
    """Skyfield's times, to the microsecond."""
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    days, in_day = np.divmod(t, int(DAY_S) * 10**9)
    tai_days = (in_day / 1e9 + 37.0 + 32.184) / DAY_S
    return timescale().tt_jd(2_440_587.5 + days, tai_days)


@dataclass
class Constellation:
    """Satellites from an instant on: names, and GCRS positions (M, 3) km at any time after it."""

    t0_utc_ns: int
    hours: float
    names: list[str]
    flights: list[CubicHermiteSpline]

    def observed(self, number: int, t_utc_ns: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        """RA, Dec (deg) and altitude of one satellite among the stars, from the site."""
        from skyfield.api import wgs84
        from skyfield.vectorlib import VectorFunction

        flight, t0 = self.flights[number], self.t0_utc_ns
        tt0 = instants(t0).tt[0]

        class Moving(VectorFunction):
            center, target = 399, -200_000 - number

            def _at(self, t: Any) -> Any:
                # Differences of two parts: a day number alone is good to 40 microseconds.
                since_s = ((t.whole - np.floor(tt0)) + (t.tt_fraction - (tt0 % 1.0))) * DAY_S
                since_s = since_s + (t.whole * 0.0)
                r, v = flight(since_s).T, flight(since_s, 1).T
                return r / AU_KM, v / AU_KM * DAY_S, None, None

        ground = wgs84.latlon(SITE["latitude_deg"], SITE["longitude_deg"], SITE["elevation_m"])
        at = instants(t_utc_ns)
        ra, dec, _ = (earth() + ground).at(at).observe(earth() + Moving()).radec()
        altitude, _, _ = (Moving() - ground).at(at).altaz()
        return ra._degrees, dec.degrees, altitude.degrees

    def sp3(self, *, step_s: int = 900, version: str = "d") -> str:
        """The file of it, epochs in GPS time."""
        epochs = np.arange(0, int(self.hours * 3600) + 1, step_s)
        # Whole seconds of GPS time, so that the file's epochs are round.
        t_utc_ns = self.t0_utc_ns + epochs * 10**9
        turns = _itrf_rotations(t_utc_ns)
        rows = [np.einsum("tij,tj->ti", turns, f(epochs.astype(float))) for f in self.flights]
        lines = [
            f"#{version}P2023  6 22  0  0  0.00000000 {len(epochs):7d} d+D   IGS20 FIT TEST",
            "## 2267 345600.00000000   900.00000000 60117 0.0000000000000",
            f"+  {len(self.names):3d}   " + "".join(self.names[:17]),
            "%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
            "/* MADE BY A TEST",
        ]
        for k, t in enumerate(t_utc_ns):
            gps_s = int(t) // 10**9 + GPS_MINUS_UTC_S
            when = np.datetime64(gps_s, "s").astype(object)
            lines.append(
                f"*  {when.year:4d} {when.month:2d} {when.day:2d} {when.hour:2d} {when.minute:2d}"
                f" {when.second:11.8f}"
            )
            for name, row in zip(self.names, rows, strict=True):
                x, y, z = row[k]
                lines.append(f"P{name}{x:14.6f}{y:14.6f}{z:14.6f} 999999.999999")
        return "\n".join([*lines, "EOF"]) + "\n"


def _itrf_rotations(t_utc_ns: Any) -> FloatArray:
    """(T, 3, 3) from GCRS to the Earth's frame, by skyfield."""
    from skyfield.framelib import itrs

    return np.moveaxis(np.asarray(itrs.rotation_at(instants(t_utc_ns))), -1, 0)


def constellation(t0_utc_ns: int, hours: float = 12.0) -> Constellation:
    """24 of GPS and 18 of Galileo."""
    names, flights = [], []
    plan = [("G", 26_560.0, 55.0, 6, 4), ("E", 29_600.0, 56.0, 3, 6)]
    for system, a_km, i_deg, planes, each in plan:
        for number, (plane, slot) in enumerate(itertools.product(range(planes), range(each)), 1):
            node = np.radians(360.0 / planes * plane + 17.0)
            u = np.radians(360.0 / each * slot + 33.0 * plane)
            i, speed = np.radians(i_deg), np.sqrt(MU / a_km)
            p = np.array([np.cos(node), np.sin(node), 0.0])
            q = np.array([-np.sin(node) * np.cos(i), np.cos(node) * np.cos(i), np.sin(i)])
            r = a_km * (np.cos(u) * p + np.sin(u) * q)
            v = speed * (-np.sin(u) * p + np.cos(u) * q)
            knots = np.arange(-600.0, hours * 3600 + 601.0, 60.0)
            solved = solve_ivp(
                _slope,
                (knots[0], knots[-1]),
                np.concatenate([r, v]),
                method="DOP853",
                t_eval=knots,
                rtol=1e-12,
                atol=1e-9,
            )
            names.append(f"{system}{number:02d}")
            flights.append(CubicHermiteSpline(knots, solved.y[:3].T, solved.y[3:].T))
    return Constellation(t0_utc_ns=t0_utc_ns, hours=hours, names=names, flights=flights)


def of_elements(
    path: Path, t0_utc_ns: int, hours: float, late_s: float, rng: np.random.Generator
) -> Constellation:
    """The navigation satellites of a file by skyfield's SGP4, each late by an error of its own.

    ``late_s``: one sigma of by how much element sets are off along their orbits.
    """
    from skyfield.api import EarthSatellite

    lines, names, flights = path.read_text().splitlines(), [], []
    knots = np.arange(-600.0, hours * 3600 + 601.0, 60.0)
    for name, first, second in zip(lines, lines[1:], lines[2:], strict=False):
        if not (first.startswith("1 ") and second.startswith("2 ")):
            continue
        is_medium = 1.6 < float(second[52:63]) < 2.4 and float(f"0.{second[26:33]}") < 0.05
        if not is_medium or not name.strip().startswith(("NAVSTAR", "GSAT", "GPS")):
            continue
        satellite = EarthSatellite(first, second, name, timescale())
        t = t0_utc_ns + np.rint((knots + rng.normal(0.0, late_s)) * 1e9).astype(np.int64)
        at = satellite.at(instants(t))
        names.append(name.strip())
        flights.append(CubicHermiteSpline(knots, at.position.km.T, at.velocity.km_per_s.T))
    return Constellation(t0_utc_ns=t0_utc_ns, hours=hours, names=names, flights=flights)


def _slope(_t: float, state: FloatArray) -> FloatArray:
    r = state[:3]
    distance = np.linalg.norm(r)
    z2 = (r[2] / distance) ** 2
    bulge = 1.5 * J2 * MU * EARTH_KM**2 / distance**5
    pull = -MU * r / distance**3 + bulge * r * (5.0 * z2 - np.array([1.0, 1.0, 3.0]))
    return np.concatenate([state[3:], pull])


@dataclass
class Shutter:
    """What is true of the camera and of the star catalogue."""

    bias_s: float = 0.137
    scatter_s: float = 0.008
    line_time_s: float = 15e-6
    drift_arcsec: tuple[float, float] = (0.16, -0.12)
    """What measured places are off, east and north."""
    along_arcsec: float = 0.25
    across_arcsec: float = 0.12
    wind_arcsec: float = 0.0
    """What each end is off beside that, unsaid."""
    light_arcsec: float | None = None
    """What a middle is off by ends and light together, as said; None: that is not on record."""


@dataclass
class Plan:
    """What is observed."""

    tracks: int = 20
    frames: int = 6
    cadence_s: float = 12.0
    exposure_s: float = 2.0
    heading_deg: float | None = None
    """Only satellites that go this way (position angle); None: any."""
    spread_deg: float = 40.0
    """Either side of it."""
    least_altitude_deg: float = 25.0
    camera: CameraMode = field(default_factory=lambda: CameraMode(binning="1x1", gain=139.0))
    strays: int = 3
    """Frames with another streak beside the satellite's."""
    outliers: int = 2
    rows: tuple[float, float] = (200.0, 3300.0)
    has_ends: bool = True
    """Whether the streaks' ends are on record."""


def night(
    folder: Path,
    sky: Constellation,
    shutter: Shutter,
    plan: Plan,
    rng: np.random.Generator,
    *,
    about: dict[str, Any] | None = None,
    **config: Any,
) -> Path:
    """A recorded session: frames with header times, and what was measured of them."""
    settings = Config.model_validate({"site": SITE, **config})
    rows = plan.rows
    writer = SessionWriter.create(
        folder, settings, {"title": "navigation satellites", **(about or {})}
    )
    frame_id, done = 0, 0
    for _ in range(4000):
        if done == plan.tracks:
            break
        number = int(rng.integers(len(sky.names)))
        span_s = plan.frames * plan.cadence_s
        begin_s = rng.uniform(1800.0, sky.hours * 3600.0 - 1800.0 - span_s)
        header_ns = sky.t0_utc_ns + np.rint(
            (begin_s + plan.cadence_s * np.arange(plan.frames)) * 1e9
        ).astype(np.int64)
        ra, dec, altitude = sky.observed(number, header_ns)
        east = (ra - ra[0]) * 3600.0 * np.cos(np.radians(dec))
        north = (dec - dec[0]) * 3600.0
        heading = np.degrees(np.arctan2(east[-1], north[-1])) % 360.0
        turned = abs((heading - (plan.heading_deg or heading) + 180.0) % 360.0 - 180.0)
        if (
            np.min(altitude) < plan.least_altitude_deg
            or turned > plan.spread_deg
            or np.ptp(ra) > 90.0
        ):
            continue
        # The camera stands turned by 33 deg; its y axis is along this direction.
        y_px = (east * np.sin(0.576) + north * np.cos(0.576)) / SCALE_ARCSEC
        low, high = rows[0] - np.min(y_px), rows[1] - np.max(y_px)
        y_px = y_px + rng.uniform(min(low, high), max(low, high))
        late_s = shutter.bias_s + rng.normal(0.0, shutter.scatter_s, plan.frames)
        late_s = late_s + y_px * shutter.line_time_s
        true_ns = header_ns + np.rint(late_s * 1e9).astype(np.int64)
        half_ns = round(plan.exposure_s * 5e8)
        places = [sky.observed(number, true_ns + at)[:2] for at in (-half_ns, 0, half_ns)]
        for k in range(plan.frames):
            frame_id += 1
            is_outlier = done < plan.outliers and k == 2
            _write_frame(
                writer, frame_id, int(header_ns[k]), plan,
                [(float(r[k]), float(d[k])) for r, d in places],
                float(y_px[k]), shutter, rng, is_outlier=is_outlier,
                is_strayed=frame_id <= plan.strays,
            )  # fmt: skip
        done += 1
    assert done == plan.tracks, "too few satellites are up"
    writer.close()
    return folder


def _write_frame(  # noqa: PLR0917 -- all that a frame has
    writer: SessionWriter,
    frame_id: int,
    header_mid_ns: int,
    plan: Plan,
    places: list[tuple[float, float]],
    y_px: float,
    shutter: Shutter,
    rng: np.random.Generator,
    *,
    is_outlier: bool,
    is_strayed: bool,
) -> None:
    (ra_a, dec_a), (ra, dec), (ra_b, dec_b) = places
    cos_dec = np.cos(np.radians(dec))
    way = np.array([(ra_b - ra_a) * cos_dec, dec_b - dec_a]) * 3600.0
    rate = way / plan.exposure_s
    ahead = rate / np.hypot(*rate)
    aside = np.array([-ahead[1], ahead[0]])
    # Each end is found by itself: their mean is the middle, their difference is in the length.
    one, other = rng.normal(
        0.0, np.hypot(shutter.along_arcsec * np.sqrt(2.0), shutter.wind_arcsec), 2
    )
    longer = (other - one) * ahead
    noise = (one + other) / 2.0 * ahead
    noise = noise + rng.normal(0.0, shutter.across_arcsec) * aside
    if is_outlier:
        noise = noise + 15.0 * ahead
    off = noise + shutter.drift_arcsec
    ra, dec = ra + off[0] / 3600.0 / cos_dec, dec + off[1] / 3600.0
    own = shutter.along_arcsec**2 * np.outer(ahead, ahead)
    own = own + shutter.across_arcsec**2 * np.outer(aside, aside)
    told = own + np.outer(rate, rate) * 0.015**2  # by the default exposure.timing_sigma_s
    half = (way + longer) / 2.0 / 3600.0
    ends = tuple(
        (float((ra + s * half[0] / cos_dec) % 360.0), float(dec + s * half[1])) for s in (-1, 1)
    )
    taken = FrameTaken(
        frame_id=frame_id,
        name=f"{frame_id}.fits",
        t_start_utc_ns=header_mid_ns - round(plan.exposure_s * 5e8),
        exposure_s=plan.exposure_s,
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
        camera=plan.camera,
    )
    measured = Measurement(
        measurement_id=measurement_id_of(frame_id, 0),
        frame_id=frame_id,
        t_mid_utc_ns=header_mid_ns,
        ra_icrs_deg=float(ra % 360.0),
        dec_icrs_deg=float(dec),
        cov_sky_arcsec2=(float(told[0, 0]), float(told[0, 1]), float(told[1, 1])),
        x_px=2000.0,
        y_px=y_px,
        confidence=0.9,
        source="network",
        ends_icrs_deg=ends if plan.has_ends else None,  # type: ignore[arg-type]
    )
    writer.append(taken, header_mid_ns)
    if shutter.light_arcsec is not None:
        found = Detections(
            frame_id=frame_id,
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
            detections=(_seen(shutter, rng, frame_id, way, float(noise @ ahead), other - one),),
        )
        writer.append(found, header_mid_ns)
    writer.append(measured, header_mid_ns)
    if is_strayed:
        from dataclasses import replace

        stray = replace(
            measured,
            measurement_id=measurement_id_of(frame_id, 1),
            dec_icrs_deg=measured.dec_icrs_deg + 0.1,
        )
        writer.append(stray, header_mid_ns)


def _seen(  # noqa: PLR0917 -- all that a streak has
    shutter: Shutter,
    rng: np.random.Generator,
    frame_id: int,
    way: FloatArray,
    off_arcsec: float,
    longer_arcsec: float,
) -> Detection:
    """The streak of a middle that is so far off by its ends."""
    sigma = shutter.light_arcsec or 0.0
    offset, length = rng.normal(-off_arcsec, sigma), rng.normal(np.hypot(*way), 4.0 * sigma)
    return straight_detection(
        frame_id=frame_id,
        length_px=float(np.hypot(*way) + longer_arcsec) / SCALE_ARCSEC,
        sigma_along_px=shutter.along_arcsec / SCALE_ARCSEC,
        light_offset_px=float(offset) / SCALE_ARCSEC,
        light_sigma_px=sigma / SCALE_ARCSEC,
        light_length_px=float(length) / SCALE_ARCSEC,
        light_length_sigma_px=4.0 * sigma / SCALE_ARCSEC,
    )


def flight_of_file(t_gps_s: FloatArray, fixed_km: FloatArray, t0_utc_ns: int) -> CubicHermiteSpline:
    """A flight through Earth-fixed positions (T, 3) of a real file, by polynomials of our own."""
    t_utc_ns = np.rint((t_gps_s - GPS_MINUS_UTC_S) * 1e9).astype(np.int64)
    inertial = np.einsum("tji,tj->ti", _itrf_rotations(t_utc_ns), fixed_km)
    since_s = (t_utc_ns - t0_utc_ns) / 1e9
    whole = BarycentricInterpolator(since_s, inertial)
    fine = np.arange(since_s[0], since_s[-1] + 1.0, 30.0)
    slope = (whole(fine + 1.0) - whole(fine - 1.0)) / 2.0
    return CubicHermiteSpline(fine, whole(fine), slope)
