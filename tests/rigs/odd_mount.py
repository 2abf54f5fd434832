"""A mount as real drivers have it, with their oddities: a model of it that speaks INDI elements.

``Axes`` is what the mount does, ``_Claims`` what its driver says of it; nothing but ``OddMount``
knows both. No clock, no socket, no thread of its own: ``odd_mount_server`` and
``odd_mount_driver`` wrap it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import quoteattr

from rsoconsole.sky import icrs_to_jnow, jnow_to_icrs, lst_deg, wrap_180, wrap_360

DEVICE = "Odd Mount"
SIDEREAL_ARCSEC_S = 15.041067
LATITUDE_DEG, LONGITUDE_DEG = 29.19, 278.95
PARK_HA_DEG, PARK_DEC_DEG = 90.0, 80.0
AT_REST_ARCSEC_S = 1.0
"""Slower than this against the ground, or against its tracking, it does not move by itself."""
_SIDEREAL_DEG_S = SIDEREAL_ARCSEC_S / 3600.0
_DEC_STEPS_ARCSEC = {15.0: 1.0, 90.0: 60.0}
_LST_KEPT_NS = 600_000_000_000
COORDINATES, ON_SET, ABORT = "EQUATORIAL_EOD_COORD", "ON_COORD_SET", "TELESCOPE_ABORT_MOTION"
PARK, TRACKING, SIDE = "TELESCOPE_PARK", "TELESCOPE_TRACK_STATE", "TELESCOPE_PIER_SIDE"
SITE, TIME, PERIOD = "GEOGRAPHIC_COORD", "TIME_UTC", "POLLING_PERIOD"
CONNECTION, DRIVER_INFO = "CONNECTION", "DRIVER_INFO"
_ALWAYS = (CONNECTION, DRIVER_INFO, PERIOD)
MODE, MODES = "TELESCOPE_TRACK_MODE", ("SIDEREAL", "LUNAR", "CUSTOM")
J2000 = "EQUATORIAL_COORD"
_WHEN_CONNECTED = (COORDINATES, ON_SET, PARK, TRACKING, MODE, ABORT, SIDE, SITE, TIME)
_READ_ONLY = (DRIVER_INFO, SIDE)
LUNAR_ARCSEC_S = 0.549
"""By which the Moon's mean rate falls behind the stars'."""
_LEFT_OUT_BY = {"nopark": PARK, "notrackstate": TRACKING, "noabort": ABORT, "noside": SIDE}
_LEFT_OUT_BY |= {"nogeo": SITE, "notime": TIME, "nopollingperiod": PERIOD}


@dataclass(frozen=True, slots=True, kw_only=True)
class Oddities:
    """In what a mount and its driver differ from those that give no trouble."""

    # Of the driver: what it lacks and what it says. As in libindi, coordinates whose state has
    # changed are sent whatever the threshold.
    nopark: bool = False
    notrackstate: bool = False
    noabort: bool = False
    noside: bool = False
    nogeo: bool = False
    notime: bool = False
    nopollingperiod: bool = False
    busyforever: bool = False  # Busy while it tracks and after ABORT
    noidle: bool = False  # Its coordinates are never Busy: Ok while it slews
    abortalert: bool = False  # ABORT is answered with Alert, and nothing comes of it
    lieabort: bool = False  # Says Idle at ABORT, and moves on
    parklies: bool = False  # Says at once that it is parked and Idle, and is on its way
    parkok_instant: bool = False  # Says at once that it is parked, its coordinates Busy until it is
    parkfails: bool = False
    wrongsite: bool = False
    j2000: bool = False  # Its coordinates are of the epoch J2000, as EQUATORIAL_COORD
    reversedside: bool = False  # Names the sides of the pier the other way round
    timeoff: float = 0.0  # Seconds that its clock is fast
    stale_time: bool = False  # Says again and again what its clock said when it was connected
    badutf8: bool = False  # A message at ABORT that is no UTF-8
    getproperties_fresh: bool = False  # Else getProperties is answered with what was last sent
    slowreport: float = 0.0  # Seconds between its looks, instead of ``period_s``
    period_s: float = 0.5  # Between its looks at the mount
    threshold_arcsec: float | None = None  # It sends what changed by more; None: every look
    step_arcsec: float = 0.0  # Of right ascensions: 1.5, 15 (dec: 1), 90 (dec: 60); 0: none
    # Of the mount: what it does.
    abortignored: bool = False  # ABORT is answered with Ok, and nothing comes of it
    aborts_ignored: int = 0  # The same of the first few
    abort_ends_tracking: bool = False  # ABORT of a mount that tracks makes it stand
    trackwhileparked: bool = False
    startparked: bool = False
    returns_moving: bool = False  # When its driver comes back it slews, which nobody has ordered
    speed_deg_s: float = 4.0
    acceleration_deg_s2: float = 2.0
    start_delay_s: float = 0.0  # Between an order, which is answered at once, and the motion
    drift_arcsec_s: tuple[float, float] = (0.0, 0.0)  # Of RA and Dec while it tracks
    mode: str = ""  # In which it tracks at first: SIDEREAL, LUNAR or CUSTOM; none: it has no modes
    custom_arcsec_s: tuple[float, float] = (10.0, 0.0)  # Drift in the mode CUSTOM
    ha_deg: float = 0.0
    dec_deg: float = 60.0

    @classmethod
    def parse(cls, text: str) -> "Oddities":
        """``busyforever slowreport=3 drift_arcsec_s=20,0``. Raises KeyError, ValueError."""
        defaults = {each.name: each.default for each in fields(cls)}
        values: dict[str, Any] = {}
        for word in text.split():
            name, _, value = word.partition("=")
            match defaults[name]:
                case bool():
                    values[name] = True
                case str():
                    values[name] = value
                case tuple():
                    values[name] = tuple(float(each) for each in value.split(","))
                case default:
                    values[name] = int(value) if isinstance(default, int) else float(value)
        return cls(**values)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Path:
    """One axis from an instant on: seconds of constant acceleration each, then its frame's rate."""

    t_s: float
    deg: float
    deg_s: float
    """Against the frame, as the pieces are."""
    frame_deg_s: float
    pieces: tuple[tuple[float, float], ...] = ()

    @property
    def ends_s(self) -> float:
        return self.t_s + sum(seconds for seconds, _ in self.pieces)

    def at(self, t_s: float) -> tuple[float, float]:
        """Degrees, and degrees a second, against the ground."""
        deg, deg_s, left_s = self.deg, self.deg_s, t_s - self.t_s
        for seconds, acceleration in self.pieces:
            part_s = min(seconds, left_s)
            deg += (deg_s + acceleration * part_s / 2.0) * part_s
            deg_s += acceleration * part_s
            left_s -= part_s
        return deg + self.frame_deg_s * (t_s - self.t_s), deg_s + self.frame_deg_s


class Axes:
    """What the mount does: it slews to a place of the sky or of the ground, tracks or stands."""

    def __init__(self, oddities: Oddities, t_s: float, ha_deg: float, dec_deg: float) -> None:
        """It stands."""
        self._oddities = oddities
        self._ha = _Path(t_s=t_s, deg=ha_deg, deg_s=0.0, frame_deg_s=0.0)
        self._dec = _Path(t_s=t_s, deg=dec_deg, deg_s=0.0, frame_deg_s=0.0)
        self.tracks = False
        """When it does not slew, or no longer."""
        self.drift_arcsec_s = oddities.drift_arcsec_s
        self.arrives_s = math.inf

    @property
    def is_slewing(self) -> bool:
        """It has not yet come to its goal, nor was it told to give it up."""
        return math.isfinite(self.arrives_s)

    def slew(
        self, t_s: float, ha_deg: float, dec_deg: float, *, is_of_sky: bool, tracks: bool
    ) -> None:
        """Go where that hour angle is now; a place of the sky moves on."""
        ha_now_deg, _ = self._ha.at(t_s)
        goal_deg = ha_now_deg + wrap_180(ha_deg - ha_now_deg)
        self._ha = self._path(self._ha, t_s, _SIDEREAL_DEG_S if is_of_sky else 0.0, goal_deg)
        self._dec = self._path(self._dec, t_s, 0.0, dec_deg)
        self.tracks, self.arrives_s = tracks, max(self._ha.ends_s, self._dec.ends_s)

    def rest(self, t_s: float, *, tracks: bool) -> None:
        """Slow down until it tracks or stands."""
        ra_drift, dec_drift = self.drift_arcsec_s
        frame = (SIDEREAL_ARCSEC_S - ra_drift, dec_drift) if tracks else (0.0, 0.0)
        self._ha = self._path(self._ha, t_s, frame[0] / 3600.0)
        self._dec = self._path(self._dec, t_s, frame[1] / 3600.0)
        self.tracks, self.arrives_s = tracks, math.inf

    def at(self, t_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Hour angle and declination, each with its rate: degrees, degrees a second."""
        if self.arrives_s <= t_s:
            self.rest(self.arrives_s, tracks=self.tracks)
        return self._ha.at(t_s), self._dec.at(t_s)

    def _path(
        self, before: _Path, t_s: float, frame_deg_s: float, goal_deg: float | None = None
    ) -> _Path:
        """Trapezium of rates from what it does at ``t_s``."""
        speed, a = self._oddities.speed_deg_s, self._oddities.acceleration_deg_s2
        deg, deg_s = before.at(t_s)
        v = deg_s - frame_deg_s
        pieces: tuple[tuple[float, float], ...] = ((abs(v) / a, -math.copysign(a, v)),)
        if goal_deg is not None:
            delay_s = self._oddities.start_delay_s
            way = goal_deg - deg - v * delay_s
            sign = math.copysign(1.0, way - v * abs(v) / (2.0 * a))
            top = sign * min(speed, math.sqrt(max(0.0, sign * way * a + v * v / 2.0)))
            turn_s, stop_s = abs(top - v) / a, abs(top) / a
            left = way - (v + top) / 2.0 * turn_s - top / 2.0 * stop_s
            pieces = (
                (delay_s, 0.0),
                (turn_s, math.copysign(a, top - v)),
                (max(0.0, left / top) if top else 0.0, 0.0),
                (stop_s, -math.copysign(a, top)),
            )
        return _Path(t_s=t_s, deg=deg, deg_s=v, frame_deg_s=frame_deg_s, pieces=pieces)


@dataclass(slots=True, kw_only=True)
class _Claims:
    """What the driver says, true or not."""

    is_connected: bool = False
    state: str = "Idle"
    """Of the coordinates."""
    awaits: str = ""
    """The order whose end it looks for: "slew" or "park"."""
    ra_deg: float = math.nan
    dec_deg: float = math.nan
    sent_state: str = ""
    tracks: bool = False
    is_parked: bool = False
    is_parking: bool = False
    tracks_after_slew: bool = True
    is_east: bool = False
    site: dict[str, Any] = field(default_factory=dict)


class OddMount:
    """A mount and its driver. Not safe for several threads."""

    def __init__(
        self,
        oddities: Oddities | Mapping[str, Any],
        *,
        monotonic_s: Callable[[], float],
        utc_ns: Callable[[], int],
        emit: Callable[[str], None],
    ) -> None:
        """It moves in the clock ``monotonic_s``; ``emit`` is given one INDI element a call.

        What is no UTF-8 comes as surrogates: encode with "surrogateescape".
        """
        o = self.oddities = oddities if isinstance(oddities, Oddities) else Oddities(**oddities)
        self._monotonic_s, self._utc_ns, self._emit = monotonic_s, utc_ns, emit
        self._now_s, self._now_utc_ns = monotonic_s(), utc_ns()
        self._lst = self._now_utc_ns, lst_deg(LONGITUDE_DEG, self._now_utc_ns)
        place = (PARK_HA_DEG, PARK_DEC_DEG) if o.startparked else (o.ha_deg, o.dec_deg)
        self.axes = Axes(o, self._now_s, *place)
        north, east = (47.0, 8.0) if o.wrongsite else (LATITUDE_DEG, LONGITUDE_DEG)
        site = {"LAT": north, "LONG": east, "ELEV": 10.0}
        self._claims = _Claims(is_parked=o.startparked, site=site, is_east=place[0] > 0.0)
        self.period_s = o.slowreport or o.period_s
        self._look_s = self._now_s + self.period_s
        self._aborts_ignored = math.inf if o.abortignored else o.aborts_ignored
        self._left_out = {gone for name, gone in _LEFT_OUT_BY.items() if getattr(o, name)}
        self._left_out |= set() if o.mode else {MODE}
        self._set_mode(o.mode)
        self._connected_utc_ns = self._now_utc_ns
        self.deaf = False
        """Its driver neither answers nor obeys nor looks; may be set at any time."""
        self.is_driver_there = True
        self.received: list[tuple[float, str, dict[str, str]]] = []
        """What was ordered by new...Vector, done or not: time, property, members."""

    # The truth, as of the last ``advance``.

    @property
    def ha_deg(self) -> float:
        """Hour angle, -180 to 180."""
        return float(wrap_180(self.axes.at(self._now_s)[0][0]))

    @property
    def dec_deg(self) -> float:
        """Declination."""
        return self.axes.at(self._now_s)[1][0]

    @property
    def ra_deg(self) -> float:
        """Right ascension of date."""
        anchor_ns, anchor_deg = self._lst
        if abs(self._now_utc_ns - anchor_ns) > _LST_KEPT_NS:
            anchor_ns, anchor_deg = self._now_utc_ns, lst_deg(LONGITUDE_DEG, self._now_utc_ns)
            self._lst = anchor_ns, anchor_deg
        run_deg = (self._now_utc_ns - anchor_ns) * 1e-9 * _SIDEREAL_DEG_S
        return float(wrap_360(anchor_deg + run_deg - self.ha_deg))

    @property
    def altitude_deg(self) -> float:
        """Above the true site's horizon."""
        lat, ha, dec = map(math.radians, (LATITUDE_DEG, self.ha_deg, self.dec_deg))
        sine = math.sin(lat) * math.sin(dec) + math.cos(lat) * math.cos(dec) * math.cos(ha)
        return math.degrees(math.asin(max(-1.0, min(1.0, sine))))

    @property
    def axis_rates_arcsec_s(self) -> tuple[float, float]:
        """Of hour angle and declination; a mount that stands has (0, 0)."""
        (_, ha_deg_s), (_, dec_deg_s) = self.axes.at(self._now_s)
        return ha_deg_s * 3600.0, dec_deg_s * 3600.0

    @property
    def ra_rate_arcsec_s(self) -> float:
        """Of the right ascension (not times cos declination): 0 tracking, 15.04 standing."""
        return SIDEREAL_ARCSEC_S - self.axis_rates_arcsec_s[0]

    @property
    def dec_rate_arcsec_s(self) -> float:
        """Of the declination."""
        return self.axis_rates_arcsec_s[1]

    @property
    def is_moving_by_itself(self) -> bool:
        """It neither stands nor tracks (at the rates that its tracking has)."""
        ra, dec = self.ra_rate_arcsec_s, self.dec_rate_arcsec_s
        rests = ((SIDEREAL_ARCSEC_S, 0.0), self.axes.drift_arcsec_s)
        return min(max(abs(ra - r), abs(dec - d)) for r, d in rests) > AT_REST_ARCSEC_S

    @property
    def stopping_deg(self) -> float:
        """How far the faster axis still goes where it is told now to stand."""
        fastest_deg_s = max(map(abs, self.axis_rates_arcsec_s)) / 3600.0
        return fastest_deg_s**2 / (2.0 * self.oddities.acceleration_deg_s2)

    # Time, clients, and what becomes of the driver.

    @property
    def next_event_s(self) -> float:
        """When ``advance`` must be called next, by the clock ``monotonic_s``."""
        return self._look_s if self._is_listening and self._claims.is_connected else math.inf

    @property
    def _is_listening(self) -> bool:
        return self.is_driver_there and not self.deaf

    def advance(self) -> None:
        """Bring the motion to the present; the driver looks, where it is time."""
        self._now_s, self._now_utc_ns = self._monotonic_s(), self._utc_ns()
        if self._now_s >= self._look_s:
            # One look, however late: a driver that was held up does not make up for others.
            self._look_s += self.period_s
            if self._look_s <= self._now_s:
                self._look_s = self._now_s + self.period_s
            if self._is_listening and self._claims.is_connected:
                self._look()

    def receive(self, element: ET.Element) -> None:
        """What a client sends."""
        self.advance()
        if element.get("device") not in (None, DEVICE):
            return
        name = element.get("name", "")
        values = {each.get("name", ""): (each.text or "").strip() for each in element}
        if element.tag.startswith("new"):
            self.received.append((self._now_s, name, values))
        if not self._is_listening:
            return
        if element.tag == "getProperties":
            if self.oddities.getproperties_fresh and self._claims.is_connected:
                self._read_place()
            self._define(name)
        elif element.tag.startswith("new") and name in map(self._name, self._offered()):
            self._obey(COORDINATES if name == self._name(COORDINATES) else name, values)

    def go_to(self, ra_deg: float, dec_deg: float) -> None:
        """As any client orders it."""
        self.advance()
        claims = self._claims
        if not (self._is_listening and claims.is_connected):
            return
        if claims.is_parked:
            self._say("[WARNING] Please unpark the mount before issuing any motion commands.")
            self._set(COORDINATES, "Alert")
            return
        ha_deg = self.ha_deg + self.ra_deg - ra_deg
        tracks = claims.tracks_after_slew
        self.axes.slew(self._now_s, ha_deg, dec_deg, is_of_sky=True, tracks=tracks)
        claims.state, claims.awaits = "Busy", "slew"
        claims.tracks = claims.is_parking = False
        self._set(COORDINATES)
        self._set(TRACKING)
        is_east = bool(wrap_180(ha_deg) >= 0.0)
        if is_east != claims.is_east:
            claims.is_east = is_east
            self._set(SIDE)

    def end_driver(self) -> None:
        """It dies, as the server tells it; the mount does what it did."""
        self.advance()
        self.is_driver_there = False
        self._emit(f'<delProperty device="{DEVICE}"/>')

    def start_driver(self) -> None:
        """It is back, not connected and knows of no order; what is parked it has kept."""
        self.advance()
        self.is_driver_there = True
        old = self._claims
        self._claims = _Claims(is_parked=old.is_parked, is_east=old.is_east, site=old.site)
        if self.oddities.returns_moving:
            goal_ha_deg = self.ha_deg - 60.0
            self.axes.slew(self._now_s, goal_ha_deg, 0.0, is_of_sky=False, tracks=False)
        self._define()

    # What the driver does.

    def _read_place(self, *, is_sent_anyway: bool = True) -> bool:
        """Where the mount says that it is; whether that is to be sent."""
        step_arcsec, claims = self.oddities.step_arcsec, self._claims
        ra_deg = _rounded(self.ra_deg, step_arcsec) % 360.0
        dec_deg = _rounded(self.dec_deg, _DEC_STEPS_ARCSEC.get(step_arcsec, step_arcsec))
        off_deg = max(abs(wrap_180(ra_deg - claims.ra_deg)), abs(dec_deg - claims.dec_deg))
        threshold_arcsec = self.oddities.threshold_arcsec
        is_off = threshold_arcsec is None or off_deg * 3600.0 > threshold_arcsec
        if is_off or is_sent_anyway:
            claims.ra_deg, claims.dec_deg = ra_deg, dec_deg
        return is_off or is_sent_anyway

    def _look(self) -> None:
        """As libindi's base class: what changed too little is neither sent nor kept."""
        claims = self._claims
        if claims.awaits and not self.axes.is_slewing:
            self._note_end(claims.awaits)
        elif not claims.awaits and claims.tracks != self.axes.tracks and not self.axes.is_slewing:
            claims.tracks = self.axes.tracks
            self._set(TRACKING)
        if self._read_place(is_sent_anyway=self._shown_state() != claims.sent_state):
            self._set(COORDINATES)

    def _note_end(self, order: str) -> None:
        claims = self._claims
        claims.awaits, claims.tracks = "", self.axes.tracks
        if order == "park":
            claims.is_parked, claims.is_parking, claims.state = True, False, "Idle"
            self._set(PARK)
        else:
            claims.state = self._state_at_rest()
        self._set(TRACKING)

    def _state_at_rest(self) -> str:
        if self.oddities.busyforever:
            return "Busy"
        return "Ok" if self._claims.tracks else "Idle"

    def _shown_state(self) -> str:
        is_hidden = self.oddities.noidle and self._claims.state == "Busy"
        return "Ok" if is_hidden else self._claims.state

    def _obey(self, name: str, values: Mapping[str, str]) -> None:
        claims, on = self._claims, [key for key, value in values.items() if value == "On"]
        match name:
            case "CONNECTION":
                self._connect("CONNECT" in on)
            case "EQUATORIAL_EOD_COORD":
                ra_deg, dec_deg = float(values["RA"]) * 15.0, float(values["DEC"])
                if self.oddities.j2000:
                    of_date = icrs_to_jnow(ra_deg, dec_deg, self._now_utc_ns)
                    ra_deg, dec_deg = (float(each) for each in of_date)
                self.go_to(ra_deg, dec_deg)
            case "TELESCOPE_TRACK_MODE":
                self._set_mode(next(iter(on)).removeprefix("TRACK_"))
                if self.axes.tracks and not self.axes.is_slewing:
                    self.axes.rest(self._now_s, tracks=True)
                self._set(MODE)
            case "TELESCOPE_ABORT_MOTION":
                self._set(ABORT, self._abort())
            case "TELESCOPE_PARK":
                self._park_or_unpark("PARK" in on)
            case "TELESCOPE_TRACK_STATE":
                self._track("TRACK_ON" in on)
            case "ON_COORD_SET":
                claims.tracks_after_slew = "SLEW" not in on
                self._set(ON_SET)
            case "GEOGRAPHIC_COORD":
                claims.site |= {key: float(value) for key, value in values.items()}
                self._set(SITE)
            case "POLLING_PERIOD":
                self.period_s = max(0.01, float(values["PERIOD_MS"]) / 1e3)
                self._look_s = min(self._look_s, self._now_s + self.period_s)
                self._set(PERIOD)
            case _:
                self._set(name)

    def _connect(self, is_on: bool) -> None:
        was_on, self._claims.is_connected = self._claims.is_connected, is_on
        if is_on:
            self._connected_utc_ns = self._now_utc_ns
            self._look_s = self._now_s + self.period_s
            self._read_place()
        self._set(CONNECTION)
        for name in _WHEN_CONNECTED if was_on != is_on else ():
            if is_on:
                self._define(self._name(name))
            elif name not in self._left_out:
                self._emit(f'<delProperty device="{DEVICE}" name="{self._name(name)}"/>')

    def _abort(self) -> str:
        """The state with which ABORT is answered."""
        o, claims = self.oddities, self._claims
        if o.abortalert or o.noabort:
            self._say("[ERROR] Abort failed: serial timeout.")
            return "Alert"
        if self._aborts_ignored > 0:
            self._aborts_ignored -= 1
            return "Ok"
        if o.badutf8:
            self._say("[ERROR] ===CMD==> Track On P>\udccf\udcfe")
        if o.lieabort:
            claims.state = "Idle"
        else:
            tracks = self.axes.tracks and not self.axes.is_slewing and not o.abort_ends_tracking
            self.axes.rest(self._now_s, tracks=tracks)
            if claims.awaits == "park":
                claims.is_parked = claims.is_parking = False
                self._set(PARK)
            claims.awaits, claims.tracks = "", tracks
            claims.state = self._state_at_rest()
            self._set(TRACKING)
        self._set(COORDINATES)
        return "Ok"

    def _park_or_unpark(self, is_to_park: bool) -> None:
        o, claims = self.oddities, self._claims
        if claims.is_parking:
            # libindi takes either order for the end of a parking under way.
            self._say("[INFO] Parking/Unparking aborted.")
            self._abort()
            self._set(PARK, "Alert")
        elif is_to_park == claims.is_parked:
            self._set(PARK, "Idle")
        elif is_to_park and o.parkfails:
            self._say("[ERROR] Parking failed, home first.")
            self._set(PARK, "Alert")
        elif is_to_park:
            place = (PARK_HA_DEG, PARK_DEC_DEG)
            self.axes.slew(self._now_s, *place, is_of_sky=False, tracks=o.trackwhileparked)
            claims.is_parked = o.parklies or o.parkok_instant
            claims.is_parking, claims.awaits = not claims.is_parked, "park"
            claims.state, claims.tracks = "Idle" if o.parklies else "Busy", False
            for name in (PARK, COORDINATES, TRACKING):
                self._set(name)
        else:
            claims.is_parked, claims.awaits, claims.state = False, "", "Idle"
            self._set(PARK)
            self._set(COORDINATES)

    def _track(self, is_on: bool) -> None:
        claims = self._claims
        if is_on and (claims.is_parked or claims.is_parking):
            self._say("[WARNING] Telescope is parked, unpark before tracking.")
            self._set(TRACKING, "Alert")
            return
        if self.axes.is_slewing:
            self.axes.tracks = is_on
        else:
            self.axes.rest(self._now_s, tracks=is_on)
        claims.tracks = is_on
        if not (claims.awaits and claims.state == "Busy"):
            claims.state = self._state_at_rest()
        self._set(TRACKING)
        self._set(COORDINATES)

    def _set_mode(self, mode: str) -> None:
        """Drift as the mode has it."""
        self._mode = mode
        rates = {"CUSTOM": self.oddities.custom_arcsec_s, "LUNAR": (LUNAR_ARCSEC_S, 0.0)}
        self.axes.drift_arcsec_s = rates.get(mode, self.oddities.drift_arcsec_s)

    # How it says it.

    def _name(self, name: str) -> str:
        """Name of a property in its driver."""
        return J2000 if name == COORDINATES and self.oddities.j2000 else name

    def _offered(self) -> list[str]:
        names = (*_ALWAYS, *(_WHEN_CONNECTED if self._claims.is_connected else ()))
        return [each for each in names if each not in self._left_out]

    def _vector(self, name: str) -> tuple[str, str, Mapping[str, Any]]:
        """Kind, state and members of a property."""
        c, is_east = self._claims, self._claims.is_east is not self.oddities.reversedside
        ra_deg, dec_deg = c.ra_deg, c.dec_deg
        if self.oddities.j2000 and math.isfinite(ra_deg):
            ra_deg, dec_deg = (
                float(each) for each in jnow_to_icrs(ra_deg, dec_deg, self._now_utc_ns)
            )
        is_park_on, place = c.is_parked or c.is_parking, {"RA": ra_deg / 15.0, "DEC": dec_deg}
        modes = {f"TRACK_{each}": each == self._mode for each in MODES}
        info = {"DRIVER_NAME": DEVICE, "DRIVER_EXEC": "odd_mount_driver"}
        info |= {"DRIVER_VERSION": "1", "DRIVER_INTERFACE": "1"}
        clock = {"UTC": self._clock(), "OFFSET": "0"}
        return {
            CONNECTION: _pair("CONNECT", "DISCONNECT", c.is_connected, "Ok", "Idle"),
            DRIVER_INFO: ("Text", "Idle", info),
            PERIOD: ("Number", "Ok", {"PERIOD_MS": self.period_s * 1e3}),
            COORDINATES: ("Number", self._shown_state(), place),
            ON_SET: _pair("TRACK", "SLEW", c.tracks_after_slew),
            PARK: _pair("PARK", "UNPARK", is_park_on, "Busy" if c.is_parking else "Ok"),
            TRACKING: _pair("TRACK_ON", "TRACK_OFF", c.tracks, "Busy", "Idle"),
            MODE: ("Switch", "Ok", modes),
            ABORT: ("Switch", "Idle", {"ABORT": False}),
            SIDE: _pair("PIER_EAST", "PIER_WEST", is_east),
            SITE: ("Number", "Ok", c.site),
            TIME: ("Text", "Ok", clock),
        }[name]

    def _define(self, name: str = "") -> None:
        for each in self._offered():
            if name in ("", self._name(each)):
                if each == COORDINATES:
                    self._claims.sent_state = self._shown_state()
                self._emit(self._element("def", each))

    def _set(self, name: str, state: str | None = None) -> None:
        if name not in self._left_out:
            if name == COORDINATES:
                self._claims.sent_state = state or self._shown_state()
            self._emit(self._element("set", name, state))

    def _element(self, verb: str, name: str, other_state: str | None = None) -> str:
        kind, state, values = self._vector(name)
        one, head, each = f"one{kind}", "", ""
        if verb == "def":
            rule = "AtMostOne" if name == ABORT else "OneOfMany"
            perm = "ro" if name in _READ_ONLY else "rw"
            head = f' label="{name}" group="Main" perm="{perm}"'
            head += f' rule="{rule}"' if kind == "Switch" else ""
            each = ' format="%g" min="0" max="0" step="0"' if kind == "Number" else ""
            one = f"def{kind}"
        inner = "".join(
            f'<{one} name="{key}" label="{key}"{each}>{_text(value)}</{one}>'
            for key, value in values.items()
        )
        head = f'name="{self._name(name)}" state="{other_state or state}"{head}'
        head += f' timeout="60" timestamp="{self._stamp()}"'
        return f'<{verb}{kind}Vector device="{DEVICE}" {head}>{inner}</{verb}{kind}Vector>'

    def _say(self, words: str) -> None:
        stamp = self._stamp()
        self._emit(f'<message device="{DEVICE}" timestamp="{stamp}" message={quoteattr(words)}/>')

    def _clock(self) -> str:
        """What its clock says, or said when it was connected."""
        o = self.oddities
        at_ns = self._connected_utc_ns if o.stale_time else self._now_utc_ns
        at = datetime.fromtimestamp(at_ns / 1e9 + o.timeoff, UTC)
        return f"{at:%Y-%m-%dT%H:%M:%S}"

    def _stamp(self) -> str:
        at = datetime.fromtimestamp(self._now_utc_ns // 1_000_000_000, UTC)
        return f"{at:%Y-%m-%dT%H:%M:%S}"


def _pair(
    first: str, second: str, is_first: bool, state: str = "Ok", off_state: str = ""
) -> tuple[str, str, dict[str, bool]]:
    return (
        "Switch",
        state if is_first else off_state or state,
        {first: is_first, second: not is_first},
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "On" if value else "Off"
    return f"{value:.9f}" if isinstance(value, float) else str(value)


def _rounded(deg: float, step_arcsec: float) -> float:
    return round(deg * 3600.0 / step_arcsec) * step_arcsec / 3600.0 if step_arcsec else deg
