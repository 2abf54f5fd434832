"""The limits a second time, from the rules in words: places by astropy, ways sampled again.

Nothing here comes from ``rsoconsole.sky``. For every request it is said how many degrees are left
to each limit (negative: violated), and whether the request lies on the edge of a choice that the
mount makes (which side, which way round), where either answer is right.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

NS_PER_S = 1_000_000_000
EDGE_DEG = 0.01
SIDEREAL_DEG_S = 15.0410686 / 3600.0
PACES = (-1.0, -0.5, 0.0, 0.5, 1.0)


@dataclass(frozen=True)
class Request:
    """One slew that somebody wants."""

    now_ns: int
    start: tuple[float, float]
    side: str | None
    target: tuple[float, float]
    aim_ns: int
    until_ns: int
    lifted: tuple[str, ...]
    kind: str


@dataclass(frozen=True)
class Margins:
    """Degrees left to each limit, (N,) each; inf where a limit is lifted or does not apply."""

    left_deg: dict[str, np.ndarray]
    is_edge: np.ndarray


def broken_before_the_sky(request: Request) -> str | None:
    """The two refusals that need no astronomy."""
    year_2000, year_2100 = 946_684_800 * NS_PER_S, 4_102_444_800 * NS_PER_S
    times = (request.now_ns, request.aim_ns, request.until_ns)
    if any(not year_2000 <= t < year_2100 for t in times):
        return "time"
    aim_s = (request.aim_ns - request.now_ns) / NS_PER_S
    until_s = (request.until_ns - request.now_ns) / NS_PER_S
    if not (-300 <= aim_s <= 7200 and 0 <= until_s <= 14400 and aim_s <= until_s):
        return "time"
    for ra, dec in (request.start, request.target):
        if not (np.isfinite(ra) and np.isfinite(dec) and 0 <= ra < 360 and abs(dec) <= 90):
            return "direction"
    return None


def margins(requests: list[Request], site, limits, mount) -> Margins:
    """Degrees left to every limit for requests whose times and directions are sound."""
    sky = _Sky(site)
    now = np.array([r.now_ns for r in requests])
    start_ha, start_dec = sky.hour_angle_dec([r.start for r in requests], now)
    ha, dec = sky.hour_angle_dec([r.target for r in requests], now)
    sun_ha, sun_dec = sky.sun(now)
    ways = _Ways(
        site.latitude_deg, limits, mount, requests, start=(start_ha, start_dec), target=(ha, dec)
    )
    arrival_s = ways.duration_deg / mount.slew_rate_deg_s
    end_s = np.maximum(arrival_s, [(r.until_ns - r.now_ns) / NS_PER_S for r in requests])
    end = now + np.round(end_s * NS_PER_S).astype(np.int64)
    sun_end = sky.sun(end)
    left = _track_margins(site, limits, (ha, dec), (arrival_s, end_s), ways.sides)
    altitude_end, azimuth_end = sky.altitude_azimuth([r.target for r in requests], end)
    left["altitude"] = np.minimum(left["altitude"], altitude_end - limits.min_altitude_deg)
    if limits.horizon:
        over = altitude_end - _mask(limits.horizon, azimuth_end)
        left["horizon"] = np.minimum(left["horizon"], over)
    at_end = _apart(ha + SIDEREAL_DEG_S * end_s, dec, *sun_end)
    at_arrival = _apart(ha, dec, sun_ha, sun_dec)  # The Sun goes a degree a day: good enough
    # A Sun lower than 6 deg below the horizon is nobody's danger.
    sun_alt = _horizontal(site.latitude_deg, sun_ha, sun_dec)[0]
    sun_alt_end = _horizontal(site.latitude_deg, *sun_end)[0]
    on_the_way = ways.sun_margins((sun_ha, sun_dec), limits.sun_cone_deg)
    first = np.minimum(at_arrival - limits.sun_cone_deg, on_the_way)
    left["Sun"] = np.minimum(
        np.where(sun_alt > -6.0, first, np.inf),
        np.where(sun_alt_end > -6.0, at_end - limits.sun_cone_deg, np.inf),
    )
    sun_is_setting = np.minimum(np.abs(sun_alt + 6.0), np.abs(sun_alt_end + 6.0)) < 0.2
    left["twilight"] = limits.twilight_deg - _highest(site, (sun_ha, sun_dec), sun_end)
    for name, values in left.items():
        values[[name in r.lifted for r in requests]] = np.inf
    is_edge = (
        ways.is_edge
        | sun_is_setting
        | (np.abs(_apart(start_ha, start_dec, sun_ha, sun_dec) - limits.sun_cone_deg) < EDGE_DEG)
    )
    return Margins(left_deg=left, is_edge=is_edge)


class _Sky:
    def __init__(self, site):
        from astropy import units
        from astropy.coordinates import EarthLocation

        self.deg = units.deg
        self.location = EarthLocation.from_geodetic(
            site.longitude_deg * units.deg,
            site.latitude_deg * units.deg,
            site.elevation_m * units.m,
        )

    def time(self, t_ns):
        from astropy.time import Time

        days, rest = np.divmod(t_ns, 86_400 * NS_PER_S)
        return Time(2_440_587.5 + days, rest / (86_400 * NS_PER_S), format="jd", scale="utc")

    def hour_angle_dec(self, directions, t_ns):
        from astropy.coordinates import HADec, SkyCoord

        ra, dec = np.array(directions).T
        there = SkyCoord(ra * self.deg, dec * self.deg, frame="icrs").transform_to(
            HADec(obstime=self.time(t_ns), location=self.location)
        )
        return there.ha.wrap_at(180 * self.deg).deg, there.dec.deg

    def altitude_azimuth(self, directions, t_ns):
        from astropy.coordinates import AltAz, SkyCoord

        ra, dec = np.array(directions).T
        there = SkyCoord(ra * self.deg, dec * self.deg, frame="icrs").transform_to(
            AltAz(obstime=self.time(t_ns), location=self.location)
        )
        return there.alt.deg, there.az.deg

    def sun(self, t_ns):
        from astropy.coordinates import HADec, get_sun

        time = self.time(t_ns)
        there = get_sun(time).transform_to(HADec(obstime=time, location=self.location))
        return there.ha.wrap_at(180 * self.deg).deg, there.dec.deg


class _Ways:
    """Every way that the axes may go, as flat arrays with the request each belongs to."""

    def __init__(self, latitude_deg, limits, mount, requests, *, start, target):
        self.limits, self.mount = limits, mount
        self.owner, self.polar, self.declination = [], [], []
        self.sides: list[set] = []
        self.is_edge = np.zeros(len(requests), bool)
        for i, request in enumerate(requests):
            here, there = (start[0][i], start[1][i]), (target[0][i], target[1][i])
            find = self._fork if mount.type == "fork" else self._german
            found = find(i, request.side, here, there, latitude_deg >= 0)
            self.sides.append({side for *_, side in found})
            for polar_from, polar_to, dec_from, dec_to, _ in found:
                self.owner.append(i)
                self.polar.append((polar_from, polar_to))
                self.declination.append((dec_from, dec_to))
            for dec in (here[1], there[1]):
                self.is_edge[i] |= abs(abs(dec) - 89.5) < EDGE_DEG
            # An arcsecond between the two computations is a degree of hour angle so near to a pole.
            self.is_edge[i] |= 0.01 < 90 - abs(here[1]) < 0.1
        self.owner = np.array(self.owner)
        self.polar, self.declination = np.array(self.polar), np.array(self.declination)
        self.travel = np.abs(np.stack([np.diff(self.polar)[:, 0], np.diff(self.declination)[:, 0]]))
        self.duration_deg = np.full(len(requests), np.inf)
        np.minimum.at(self.duration_deg, self.owner, self.travel.max(axis=0))

    @staticmethod
    def _starts(place, angle, parked):
        """At a pole also where it would be parked; nearer than 0.02 deg only there."""
        from_pole = 90 - abs(place[1])
        if from_pole > 0.5:
            return [angle]
        return [parked, angle] if from_pole > 0.02 else [parked]

    @staticmethod
    def _ends(at_pole, angle, lowest, highest):
        """To a pole the polar axis may go to any of nine places from end to end."""
        return np.linspace(lowest, highest, 9) if at_pole else [angle]

    def _fork(self, i, side, here, there, is_north):
        found = []
        reach = self.limits.max_hour_angle_deg
        poles = [abs(dec) > 89.5 for _, dec in (here, there)]
        for a in self._starts(here, here[0], 0.0):
            ends = self._ends(poles[1], there[0], -reach, reach)
            for b in [a] if all(poles) and here[1] * there[1] > 0 else ends:
                found.append((a, b, here[1], there[1], None))
                self.is_edge[i] |= abs(abs(b - a) - 180) < EDGE_DEG and not any(poles)
                if b - a > 180:
                    found.append((a, b - 360, here[1], there[1], None))
                if b - a < -180:
                    found.append((a, b + 360, here[1], there[1], None))
        for angle, pole in zip((here[0], there[0]), poles, strict=True):
            self.is_edge[i] |= abs(abs(angle) - 180) < EDGE_DEG and not pole
        return found

    def _german(self, i, side, here, there, is_north):
        """The counterweight stays low: the axis is between 270 deg east and 90 deg west."""
        found = []
        hysteresis = self.mount.flip_hysteresis_deg
        past = self.limits.past_meridian_deg
        poles = [abs(dec) > 89.5 for _, dec in (here, there)]
        if not poles[1]:
            self.is_edge[i] |= abs(abs(there[0]) - hysteresis) < EDGE_DEG
            self.is_edge[i] |= abs(abs(there[0]) - 180) < EDGE_DEG
        for now in ["west", "east"] if side is None else [side]:
            then = now
            if there[0] >= hysteresis:
                then = "east"
            elif there[0] <= -hysteresis:
                then = "west"
            for arrival in ["west", "east"] if poles[1] else [then]:
                p0, d0 = self._axes(here, now, is_north)
                p1, d1 = self._axes(there, arrival, is_north)
                for angle, pole in ((p0, poles[0]), (p1, poles[1])):
                    near_the_end = min(abs(angle - 90), abs(angle + 270)) < EDGE_DEG
                    self.is_edge[i] |= near_the_end and not pole
                for a in self._starts(here, p0, -90.0):
                    ends = self._ends(poles[1], p1, -180 - past, past)
                    for b in [a] if poles[0] and abs(d1 - d0) < 1 else ends:
                        found.append((a, b, d0, d1, arrival))
        return found

    @staticmethod
    def _axes(place, side, is_north):
        hour_angle, dec = place
        if side == "east":
            hour_angle, dec = hour_angle - 180, (180 if is_north else -180) - dec
        while hour_angle >= 90:
            hour_angle -= 360
        while hour_angle < -270:
            hour_angle += 360
        return hour_angle, dec

    def sun_margins(self, sun, cone_deg):
        """Degrees left to the cone along every way; the worst of a request's ways."""
        worst = np.full(len(self.sides), np.inf)
        if cone_deg <= 0:
            return worst
        sun_of_way = [part[self.owner] for part in sun]
        starts = _apart(self.polar[:, 0], self.declination[:, 0], *sun_of_way)
        everything = np.arange(self.owner.size)
        rough = self._left(everything, sun_of_way, starts, cone_deg, 24)
        # No way is further from its samples than a piece is long, so the rest is clear.
        pieces = (self.travel.sum(axis=0) + 4) / 23
        near = everything[rough < pieces + 0.1]
        for part in np.array_split(near, max(1, near.size // 200)):
            left = self._left(part, [s[part] for s in sun_of_way], starts[part], cone_deg, 500)
            np.minimum.at(worst, self.owner[part], left)
        return worst

    def _left(self, which, sun, starts, cone_deg, samples):
        """Least of what is left over; a way out is held against where it has been so far."""
        left = np.full(which.size, np.inf)
        is_inside = starts < cone_deg
        for pace in PACES:
            polar, dec = self._walk(which, pace, samples)
            apart = _apart(polar, dec, sun[0][:, None], sun[1][:, None])
            outside = apart.min(axis=1) - cone_deg
            kept = np.minimum(cone_deg, np.maximum.accumulate(apart, axis=1) - 0.05)
            inside = (apart - kept).min(axis=1) if pace == 0.0 else np.full(which.size, np.inf)
            if samples < 100:
                inside = outside
            left = np.minimum(left, np.where(is_inside, inside, outside))
        return left

    def _walk(self, which, pace, samples):
        """Axis angles (ways, samples) in time, each stretch between two events sampled evenly."""
        rate = self.mount.slew_rate_deg_s
        polar_late, dec_late = max(0.0, -pace), max(0.0, pace)
        delays = np.array([polar_late, dec_late]) * 0.5
        rates = rate * (1 - 0.05 * np.array([polar_late, dec_late]))
        ends = delays[:, None] + self.travel[:, which] / rates[:, None]
        events = np.sort(
            np.stack([np.zeros(which.size), np.full(which.size, 0.5 * abs(pace)), *ends]), axis=0
        )
        share = np.linspace(0, 1, samples)
        t = np.concatenate(
            [a[:, None] + (b - a)[:, None] * share for a, b in pairwise(events)],
            axis=1,
        )
        angles = []
        for axis, (angle, delay, speed) in enumerate(
            zip((self.polar, self.declination), delays, rates, strict=True)
        ):
            gone = np.clip((t - delay) * speed, 0, self.travel[axis, which][:, None])
            direction = np.sign(angle[which, 1] - angle[which, 0])
            angles.append(angle[which, 0][:, None] + direction[:, None] * gone)
        return angles


def _apart(a_ha, a_dec, b_ha, b_dec):
    """Angle between directions, by their chord; a declination may be beyond the pole."""

    def vector(ha, dec):
        ha, dec = np.radians(ha), np.radians(dec)
        return np.cos(dec) * np.cos(ha), np.cos(dec) * np.sin(ha), np.sin(dec)

    chord_2 = sum(
        (p - q) ** 2 for p, q in zip(vector(a_ha, a_dec), vector(b_ha, b_dec), strict=True)
    )
    return np.degrees(2 * np.arcsin(np.clip(np.sqrt(chord_2) / 2, 0, 1)))


def _mask(points, azimuth):
    """Straight lines from point to point, round through north."""
    azimuths = [a for a, _ in points]
    altitudes = [h for _, h in points]
    azimuths = [azimuths[-1] - 360, *azimuths, azimuths[0] + 360]
    altitudes = [altitudes[-1], *altitudes, altitudes[0]]
    return np.interp(azimuth, azimuths, altitudes)


def _horizontal(latitude_deg, ha, dec):
    ha, dec, lat = np.radians(ha), np.radians(dec), np.radians(latitude_deg)
    north = np.sin(dec) * np.cos(lat) - np.cos(dec) * np.sin(lat) * np.cos(ha)
    west = np.cos(dec) * np.sin(ha)
    up = np.sin(dec) * np.sin(lat) + np.cos(dec) * np.cos(lat) * np.cos(ha)
    return np.degrees(np.arcsin(np.clip(up, -1, 1))), np.degrees(np.arctan2(-west, north)) % 360


def _track_margins(site, limits, target, span_s, sides):
    """Altitude, horizon, hour angle and pier while the target is followed, every few seconds."""
    count = target[0].size
    names = ("altitude", "horizon", "hour angle", "pier")
    left = {name: np.full(count, np.inf) for name in names}
    for part in np.array_split(np.arange(count), max(1, count // 1000)):
        seconds = np.linspace(span_s[0][part], span_s[1][part], 601, axis=1)
        ha = target[0][part][:, None] + SIDEREAL_DEG_S * seconds
        ha = (ha + 180) % 360 - 180
        dec = np.broadcast_to(target[1][part][:, None], ha.shape)
        altitude, azimuth = _horizontal(site.latitude_deg, ha, dec)
        left["altitude"][part] = (altitude - limits.min_altitude_deg).min(axis=1)
        if limits.horizon:
            left["horizon"][part] = (altitude - _mask(limits.horizon, azimuth)).min(axis=1)
        if limits.max_hour_angle_deg < 180:
            left["hour angle"][part] = limits.max_hour_angle_deg - np.abs(ha).max(axis=1)
        for i, angles in zip(part, ha, strict=True):
            if "west" in sides[i]:
                left["pier"][i] = (limits.past_meridian_deg - angles).min()
            if "east" in sides[i]:
                left["pier"][i] = min(left["pier"][i], (angles + limits.past_meridian_deg).min())
    at_pole = np.abs(target[1]) > 89.5
    left["hour angle"][at_pole] = left["pier"][at_pole] = np.inf
    return left


def _highest(site, sun_start, sun_end):
    """Highest altitude of the Sun between two of its places less than 180 deg apart."""
    turned = (sun_end[0] - sun_start[0] + 180) % 360 - 180
    share = np.linspace(0, 1, 101)[:, None]
    altitude, _ = _horizontal(
        site.latitude_deg,
        sun_start[0] + turned * share,
        sun_start[1] + (sun_end[1] - sun_start[1]) * share,
    )
    return altitude.max(axis=0)
