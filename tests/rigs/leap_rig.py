"""An engine that leaps after one low satellite: mount and frames by a known orbit, no pixels."""

import dataclasses

import numpy as np

from rsoconsole.config import Config
from rsoconsole.instruments import MountReport
from rsoconsole.orbits import KnownOrbit
from rsoconsole.orbits.motion.forces import ZonalPropagator
from rsoconsole.pipeline import Glance, Reduction, is_in_earth_shadow
from rsoconsole.pipeline.frame.measurement import measure_detections
from rsoconsole.records import CameraMode, Detection, Detections, Frame
from rsoconsole.sky import (
    astrometric_places,
    line_of_sight_gcrs,
    site_gcrs,
    sky_to_pixel,
    tan_wcs,
    wrap_180,
)
from tests.makers import NS, T0_UTC_NS
from tests.rigs import engine_rig
from tests.rigs.engine_rig import SITE, START_DEG, PlainCamera, PlainMount, Rig, ScriptedReducer

WIDTH_PX, HEIGHT_PX = 1164, 880
SETTINGS = {
    "optics": {"pixel_um": 15.2, "width_px": WIDTH_PX, "height_px": HEIGHT_PX},
    "exposure": {"exposure_s": 0.2, "start_latency_s": 0.1, "readout_s": 0.4},
    "mount": {"type": "fork", "settle_s": 1.0},
    "limits": {"twilight_deg": 80.0, "sun_cone_deg": 0.0, "max_hour_angle_deg": 180.0},
    "search": {"pattern": "stay"},
    # Its frames tell nothing of how much the mount swings.
    "leap": {"enabled": True, "learns_settle": False},
    # Leaps go by an orbit of their own; that of a track on record is as costly as all the rest.
    "orbit": {"online": False},
}
SIGMA_PX = 0.3


def travel_s(distance_deg: float, rate_deg_s: float, acceleration_deg_s2: float) -> float:
    """How long an axis takes that gathers way, keeps its rate and slows down."""
    ramp_deg = rate_deg_s**2 / acceleration_deg_s2
    if abs(distance_deg) < ramp_deg:
        return 2.0 * np.sqrt(abs(distance_deg) / acceleration_deg_s2)
    return (abs(distance_deg) + ramp_deg) / rate_deg_s


def config_with(**sections) -> Config:
    """The rig's, with other settings by section."""
    table = {name: dict(values) for name, values in SETTINGS.items()}
    for name, values in sections.items():
        table.setdefault(name, {}).update(values)
    return Config.model_validate(table)


def orbit_over(
    heading_deg: float,
    height_km: float = 600.0,
    after_s: float = 6.0,
    through_deg: tuple[float, float] = START_DEG,
) -> KnownOrbit:
    """A circle through where the telescope stares, so long after the night's beginning."""
    t = T0_UTC_NS + round(after_s * NS)
    line = line_of_sight_gcrs(
        np.array([through_deg[0]]), np.array([through_deg[1]]), np.array([t])
    )[0]
    place = site_gcrs(SITE, np.array([t]))[0][0]
    up = float(place @ line)
    r = place + (-up + np.sqrt(up * up - place @ place + (6_378.0 + height_km) ** 2)) * line
    outward = r / np.linalg.norm(r)
    north = np.array([0.0, 0.0, 1.0]) - outward[2] * outward
    north = north / np.linalg.norm(north)
    east = np.cross(north, outward)
    turn = np.radians(heading_deg)
    speed = np.sqrt(398_600.4418 / np.linalg.norm(r))
    v = speed * (np.cos(turn) * north + np.sin(turn) * east)
    motion = ZonalPropagator(epoch_utc_ns=t)
    return KnownOrbit(epoch_utc_ns=t, r_km=r, v_km_s=v, covariance=np.eye(6), forces=motion)


class TravellingMount(PlainMount):
    """Its slews take the time that 4 deg/s and 2 deg/s2 take."""

    def __init__(self, clock) -> None:
        super().__init__(clock)
        self.pier_side = None
        self.ordered_ns: list[int] = []

    def slew(self, ra_icrs_deg, dec_icrs_deg, now_utc_ns) -> None:
        self.slews.append((ra_icrs_deg, dec_icrs_deg))
        self.ordered_ns.append(self.clock.t_utc_ns)
        turn = abs(wrap_180(ra_icrs_deg - self.at_deg[0]))
        takes_s = travel_s(max(turn, abs(dec_icrs_deg - self.at_deg[1])), 4.0, 2.0)
        self.arrives_ns = self.clock.t_utc_ns + round(takes_s * NS)
        self.at_deg = (ra_icrs_deg, dec_icrs_deg)

    arrives_ns = 0

    def report(self, not_before_utc_ns=None, timeout_s=10.0) -> MountReport:
        plain = super().report(not_before_utc_ns, timeout_s)
        return dataclasses.replace(plain, is_slewing=self.clock.t_utc_ns < self.arrives_ns)


class SlowCamera(PlainCamera):
    """Opens its shutter 0.1 s after the order; its header knows."""

    def __init__(
        self, clock, mount: TravellingMount, size_px: tuple[int, int] = (WIDTH_PX, HEIGHT_PX)
    ) -> None:
        super().__init__(clock)
        self.mount, self.size_px = mount, size_px
        self.looked_deg: dict[int, tuple[float, float]] = {}
        """Where the telescope looked while each frame was exposed."""
        self.arrived_ns: dict[int, int] = {}
        """When the mount had arrived before each frame, where it had moved."""
        self.moved: set[int] = set()
        """Frames whose shutter was open while the mount moved."""

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        super().start_exposure(exposure_s, frame_id)
        self.looked_deg[frame_id] = self.mount.at_deg
        if self.mount.arrives_ns:
            self.arrived_ns[frame_id] = self.mount.arrives_ns

    def wait_frame(self, timeout_s) -> Frame:
        frame = super().wait_frame(timeout_s)
        assert frame.t_start_utc_ns is not None
        assert frame.exposure_s is not None
        closed_ns = frame.t_start_utc_ns + round((0.1 + frame.exposure_s) * NS)
        if self.mount.ordered_ns and frame.t_start_utc_ns < self.mount.ordered_ns[-1] < closed_ns:
            self.moved.add(frame.frame_id)
        share = self.shares[-1] if self.shares else 1.0
        width_px, height_px = (round(share * side) for side in self.size_px)
        return dataclasses.replace(
            frame,
            pixels=np.zeros((height_px, width_px), np.uint16),
            t_start_utc_ns=frame.t_start_utc_ns + NS // 10,
            camera=CameraMode(binning="1x1"),
        )


class LowReducer(ScriptedReducer):
    """Sees the satellite's streak wherever it really crosses the frame."""

    def __init__(self, orbit: KnownOrbit, camera: SlowCamera, config: Config) -> None:
        super().__init__(set(), camera.mount)
        self.camera = camera
        self.orbit, self.config = orbit, config
        self.random = np.random.default_rng(1)
        self.blind: set[int] = set()
        """Frames in which nothing is detected."""
        self.unsolved: set[int] = set()
        self.like_aircraft: set[int] = set()
        """Frames in which its streak is taken for an aircraft's."""
        self.first_shows = 1.0
        """Share of the first streak's light that is there: it flashes."""
        self.first_turned_deg = 0.0
        """By which the first streak is another's."""
        self.is_eclipsed = False
        """Whether the Earth's shadow counts."""
        self.in_frame: list[tuple[int, bool]] = []
        """Each frame, and whether both ends were in it."""
        self.glances: list[int] = []
        """Frames of which the middle was looked at."""
        self.sees_middle = False
        """Whether there is something to be seen in it."""

    def glance(self, frame: Frame, reach_px: float) -> Glance | None:
        self.glances.append(frame.frame_id)
        if not self.sees_middle:
            return None
        seen = self.reduce(frame)
        self.in_frame.pop()
        return Glance(detections=seen.detections, solution=seen.solution)

    def reduce(self, frame: Frame) -> Reduction:
        plain = super().reduce(frame)
        assert frame.t_start_utc_ns is not None
        assert frame.exposure_s is not None
        scale = self.config.optics.scale_arcsec_px
        ra_deg, dec_deg = self.camera.looked_deg[frame.frame_id]
        wcs = tan_wcs(
            ra_deg,
            dec_deg,
            scale_arcsec_px=scale,
            rotation_deg=20.0,
            is_flipped=False,
            width_px=frame.width_px,
            height_px=frame.height_px,
        )
        solution = dataclasses.replace(
            plain.solution,
            wcs=wcs,
            scale_arcsec_px=scale,
            ra_icrs_deg=ra_deg,
            dec_icrs_deg=dec_deg,
        )
        late_ns = round(float(self.random.normal(0.0, 0.015)) * NS)
        t = frame.t_start_utc_ns + late_ns + np.array([0, round(frame.exposure_s * NS)])
        places = astrometric_places(self.orbit.states, SITE, t)
        x, y = sky_to_pixel(wcs, places.ra_icrs_deg, places.dec_icrs_deg)
        x, y = (each + self.random.normal(0.0, SIGMA_PX, 2) for each in (x, y))
        is_in = bool(
            np.all(np.isfinite(x))
            and np.all((x > 0) & (x < frame.width_px - 1) & (y > 0) & (y < frame.height_px - 1))
        )
        if is_in and not any(was for _, was in self.in_frame):
            turn = np.radians(self.first_turned_deg)
            along = self.first_shows * np.array([np.diff(x)[0], np.diff(y)[0]])
            dx, dy = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ along
            x, y = np.array([x[0], x[0] + dx]), np.array([y[0], y[0] + dy])
        self.in_frame.append((frame.frame_id, is_in))
        is_lit = not (self.is_eclipsed and is_in_earth_shadow(self.orbit, int(t[0])))
        found = Detections(
            frame_id=frame.frame_id,
            width_px=frame.width_px,
            height_px=frame.height_px,
            detections=(
                (
                    _detection(
                        frame.frame_id,
                        x,
                        y,
                        "aircraft" if frame.frame_id in self.like_aircraft else "satellite",
                    ),
                )
                if is_in and is_lit and frame.frame_id not in self.blind
                else ()
            ),
        )
        return dataclasses.replace(
            plain,
            detections=found,
            solution=None if frame.frame_id in self.unsolved else solution,
            measurements=measure_detections(found, solution, frame, self.config.exposure),
        )


def _detection(frame_id: int, x, y, object_class) -> Detection:
    order = slice(None, None, 1 if frame_id % 2 else -1)
    (xa, xb), (ya, yb) = x[order], y[order]
    return Detection(
        frame_id=frame_id,
        confidence=0.95,
        x_px=float((xa + xb) / 2.0),
        y_px=float((ya + yb) / 2.0),
        x_a_px=float(xa),
        y_a_px=float(ya),
        x_b_px=float(xb),
        y_b_px=float(yb),
        box_px=(float(min(x)), float(min(y)), float(max(x)), float(max(y))),
        length_px=float(np.hypot(xb - xa, yb - ya)),
        width_px=2.5,
        snr=30.0,
        sigma_along_px=SIGMA_PX / np.sqrt(2.0),
        sigma_across_px=SIGMA_PX / np.sqrt(2.0),
        is_clipped=False,
        method="line",
        object_class=object_class,
    )


def leap_rig(orbit: KnownOrbit, config: Config | None = None) -> Rig:
    """Armed when the test says so."""
    config = config or config_with()
    made = engine_rig.rig(set(), config)
    mount = TravellingMount(made.clock)
    camera = SlowCamera(made.clock, mount, (config.optics.width_px, config.optics.height_px))
    instruments = dataclasses.replace(
        made.engine.instrument_controller.instruments, mount=mount, camera=camera
    )
    reducer = LowReducer(orbit, camera, config)
    engine = engine_rig.Engine(
        config=config,
        instrument_controller=engine_rig.InstrumentController(
            instruments, config, lambda: made.queue.is_interrupt_wanted
        ),
        reducer=reducer,
        record=made.memory,
        queue=made.queue,
    )
    return Rig(engine, mount, camera, made.clock, made.memory, made.queue, reducer)
