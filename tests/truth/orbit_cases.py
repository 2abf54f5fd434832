"""Orbits with known answers: published cases, and random ones of every regime.

No code of the product makes their truth.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from rsoconsole.orbits.first.gooding_iteration import SightLines
from rsoconsole.records import FloatArray

MU = 398600.4418
EARTH_TURN_RAD_S = 7.292115e-5
EARTH_KM = 6378.137


def lines(
    t_s: list[float], sites_km: list[list[float]], ra_deg: list[float], dec_deg: list[float]
) -> SightLines:
    """Three lines of sight by their directions."""
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    directions = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], -1)
    return SightLines(t_s=np.array(t_s), sites_km=np.array(sites_km), directions=directions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Published:
    """A case of a textbook or of an independent program."""

    name: str
    lines: SightLines
    mu: float
    ranges_km: tuple[float | None, float | None, float | None]
    r2_km: tuple[float, float, float]
    within_km: float


VALLADO_7_2 = Published(
    name="Vallado, Fundamentals of Astrodynamics, example 7-2; solved by Orekit",
    lines=lines(
        [-480.0, 0.0, 240.0],
        [
            [4054.8801594, 2748.1944767, 4074.2361653],
            [3956.2235179, 2888.2320864, 4074.3634118],
            [3905.0723452, 2956.9345902, 4074.4293009],
        ],
        [0.9399130, 45.025748, 67.886655],
        [18.667717, 35.664741, 36.996583],
    ),
    mu=398600.4415,
    ranges_km=(4241.368616, 4179.876509, 4629.536042),
    r2_km=(6356.414613, 5290.581383, 6511.404281),
    within_km=1e-3,
)
CURTIS_5_11 = Published(
    name="Curtis, Orbital Mechanics for Engineering Students, example 5.11; solved by Orekit",
    lines=lines(
        [0.0, 118.104, 237.577],
        [
            [3489.80846791, 3430.20354741, 4078.53953565],
            [3460.13435573, 3460.13435573, 4078.53953565],
            [3429.85635115, 3490.14970021, 4078.53953565],
        ],
        [43.5365, 54.4196, 64.3178],
        [-8.78334, -12.0739, -15.1054],
    ),
    mu=398600.0,
    ranges_km=(3643.82562, None, 4178.46008),
    r2_km=(5662.04169, 6537.94985, 3269.04703),
    within_km=1e-3,
)
KAZSAT_2 = Published(
    name="KazSat 2, real observations of Orekit's own test; solved by Orekit",
    lines=lines(
        [-351.56, 0.0, 330.43],
        [
            [-2946.06070954, -3614.87720998, 4340.78085987],
            [-2852.42496623, -3689.45801947, 4340.57147800],
            [-2762.70112140, -3757.34664299, 4340.37073753],
        ],
        [241.4633333333, 242.9322083333, 244.3129166667],
        [-6.52895, -6.5312111111, -6.5333416667],
    ),
    mu=MU,
    ranges_km=(37875.381911, None, 37872.175267),
    r2_km=(-19974.7792, -37195.9048, 32.65197),
    within_km=1e-3,
)
ACROSS_RA_0 = Published(
    name="synthetic geostationary satellite across RA 0h",
    lines=lines(
        [0.0, 1800.0, 3600.0],
        [
            [5323.714577, 1646.817901, 3092.307814],
            [5062.382098, 2329.427738, 3092.307814],
            [4713.9566, 2971.962192, 3092.307814],
        ],
        [359.942699212, 7.466466283, 14.989741050],
        [-4.849689783, -4.844889960, -4.839346911],
    ),
    mu=MU,
    ranges_km=(36934.087910, 36934.900610, 36935.832837),
    r2_km=(41553.265, 7111.818, -27.160),
    within_km=1e-3,
)
ISS = Published(
    name="the space station in a minute; the truth is known, the lines are rounded",
    lines=lines(
        [0.0, 30.0, 60.0],
        [
            [-2717.622597, -4793.721946, 3201.023504],
            [-2707.129270, -4799.668823, 3201.003664],
            [-2696.622959, -4805.592729, 3200.983799],
        ],
        [float(np.degrees(x)) for x in (0.5380084720652177, 0.549650227786601, 0.5613500868283529)],
        [
            float(np.degrees(x))
            for x in (-0.09320078788346774, -0.10753788558809535, -0.12182129631017422)
        ],
    ),
    mu=398600.4415,
    ranges_km=(None, None, None),
    r2_km=(6426.033861, 795.618041, 2044.533159),
    within_km=1.0,
)
PUBLISHED = (VALLADO_7_2, CURTIS_5_11, KAZSAT_2, ACROSS_RA_0, ISS)

REGIMES = ("LEO", "MEO", "GEO", "GTO", "Molniya")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Random:
    """An orbit seen three times from a turning Earth, without noise."""

    lines: SightLines
    ranges_km: FloatArray
    r2_km: FloatArray
    v2_km_s: FloatArray


def random_case(regime: str, random: np.random.Generator) -> Random:
    """One that stands 10 degrees high at all three instants; moved by a numerical integrator."""
    while True:
        a, e, i_deg, (shortest, longest) = _orbit(regime, random)
        r, v = state_of(a, e, np.radians(i_deg), tuple(random.uniform(0.0, 2.0 * np.pi, 3)))
        arc = random.uniform(shortest, longest)
        t = np.array([0.0, arc * random.uniform(0.4, 0.6), arc])
        sites = _sites(np.radians(random.uniform(-60.0, 60.0)), random.uniform(0.0, 2 * np.pi), t)
        if not _is_up(r[None] - sites[:1], sites[:1]):
            continue
        states = _moved(r, v, t)
        seen = states[:, :3] - sites
        if _is_up(seen, sites):
            ranges = np.linalg.norm(seen, axis=1)
            return Random(
                lines=SightLines(t_s=t, sites_km=sites, directions=seen / ranges[:, None]),
                ranges_km=ranges,
                r2_km=states[1, :3],
                v2_km_s=states[1, 3:],
            )


def _is_up(seen: FloatArray, sites: FloatArray) -> bool:
    upward = np.sum(seen * sites, axis=1)
    return bool(np.all(upward > np.sin(np.radians(10.0)) * np.linalg.norm(seen, axis=1) * EARTH_KM))


def _orbit(
    regime: str, random: np.random.Generator
) -> tuple[float, float, float, tuple[float, float]]:
    u = random.uniform
    if regime == "LEO":
        return u(6778, 7878), u(0, 0.02), u(30, 110), (60, 300)
    if regime == "MEO":
        return u(20000, 30000), u(0, 0.05), u(40, 70), (600, 1800)
    if regime == "GEO":
        return u(42100, 42240), u(0, 0.003), u(0.01, 12), (600, 3600)
    if regime == "GTO":
        perigee, apogee = EARTH_KM + u(200, 600), u(35000, 42500)
        a = (perigee + apogee) / 2.0
        return a, 1.0 - perigee / a, u(4, 30), (300, 1800)
    return 26560.0, 1.0 - (EARTH_KM + u(500, 1500)) / 26560.0, 63.4, (600, 3600)


def state_of(
    a: float, e: float, i: float, angles: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity by Kepler's equation, elementary; node, perigee, mean anomaly; rad."""
    node, argp, mean = angles
    eccentric = mean
    for _ in range(200):
        eccentric -= (eccentric - e * np.sin(eccentric) - mean) / (1.0 - e * np.cos(eccentric))
    c, s, root = np.cos(eccentric), np.sin(eccentric), np.sqrt(1.0 - e * e)
    speed = np.sqrt(MU / a) / (1.0 - e * c)
    turn = _about_z(node) @ _about_x(i) @ _about_z(argp)
    r = turn @ (a * np.array([c - e, root * s, 0.0]))
    return r, turn @ (speed * np.array([-s, root * c, 0.0]))


def _about_z(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _sites(latitude: float, sidereal: float, t: FloatArray) -> FloatArray:
    angle = sidereal + EARTH_TURN_RAD_S * t
    up = np.full_like(angle, np.sin(latitude))
    flat = np.cos(latitude)
    return EARTH_KM * np.stack([flat * np.cos(angle), flat * np.sin(angle), up], -1)


def _moved(r: FloatArray, v: FloatArray, t: FloatArray) -> FloatArray:
    """States (3, 6) by numerical integration about the point mass."""
    solved = solve_ivp(
        lambda _, y: np.concatenate([y[3:], -MU / np.linalg.norm(y[:3]) ** 3 * y[:3]]),
        (t[0], t[-1]),
        np.concatenate([r, v]),
        method="DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-12,
    )
    return np.asarray(solved.y.T)
