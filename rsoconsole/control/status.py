"""The engine's status: one record that crosses the wire, and its JSON for scripts.

The engine fills in the record; consoles, panel and shell read it. In JSON each field appears by its
own name, which says unit and frame, and also by the name that the first version gave it.
"""

import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.control.fields import read_record, to_json_types
from rsoconsole.records import Band, PairMotion, StopOutcome, UnseenMember
from rsoconsole.words import measured_text, stop_order_text

SCHEMA = 1
"""Version of the program's JSON, printed or answered; raised when a key changes its meaning."""
FIRST_NAMES: Mapping[str, str] = types.MappingProxyType(
    {
        "frame_id": "frame",
        "ra_icrs_deg": "ra",
        "dec_icrs_deg": "dec",
        "alt_deg": "alt",
        "az_deg": "az",
        "mount_ra_icrs_deg": "mount_ra",
        "mount_dec_icrs_deg": "mount_dec",
    }
)
"""First version's key of each field; scripts may still read it, and older engines send it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartHealth:
    """Health of one part of the machine or the instruments; ``text`` says what was found."""

    name: str = ""
    ok: bool = False
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """The machine that the engine runs on, when last read; None: the machine does not report it."""

    model: str | None = None
    """Model of the board, from its device tree."""
    cpu_temperature_c: float | None = None
    cpu_frequency_mhz: float | None = None
    cpu_frequency_max_mhz: float | None = None
    is_under_voltage: bool | None = None
    is_throttled: bool | None = None
    """True where the processor is slowed down, because of heat or a weak power supply."""
    has_been_under_voltage: bool | None = None
    has_been_throttled: bool | None = None
    troubles: tuple[str, ...] = ()
    recording_medium: str | None = None
    recording_device: str | None = None
    recording_life_used_percent: int | None = None
    time_source: str | None = None
    time_source_detail: str | None = None
    real_time_clock: str | None = None

    @property
    def is_pi(self) -> bool:
        """True for a Raspberry Pi, by the board's name."""
        return self.model is not None and self.model.startswith("Raspberry Pi")


@dataclass(frozen=True, slots=True, kw_only=True)
class LastStop:
    """The last STOP of this engine and its stages: ordered, answered by the driver, measured."""

    number: int = 0
    """Count of this engine's STOPs up to this one; 0: none."""
    by: str = ""
    t_utc_ns: int | None = None
    """Time at which STOP was given, by the engine's clock, UTC ns."""
    ordered_ms: float | None = None
    """Time from the STOP until ABORT was on its way to the mount, ms; None: not yet, or never."""
    answered_ms: float | None = None
    """Time from the STOP until the driver had accepted ABORT, ms; None: not yet, or never."""
    measured_ms: float | None = None
    """Time from the STOP until the mount's motion was known, ms; None: not yet."""
    motion: StopOutcome | None = None
    """Motion measured after the STOP: stands, tracks, moves or unknown; None: not yet."""
    rate_deg_s: float | None = None
    """Rate of the faster axis, deg/s, where the mount still moves."""
    is_over: bool = False
    """True where the mount was measured to be at rest after the STOP, or was armed again."""
    is_superseded: bool = False
    """True where another order came and the motion is no longer measured for this STOP."""
    path: str | None = None
    detail: str = ""
    """Reason why ABORT was not answered, or why the motion is not known."""

    @property
    def is_at_rest(self) -> bool:
        """True where the mount was measured to stand or to track after the STOP."""
        return self.motion in ("stands", "tracks")

    @property
    def text(self) -> str:
        """The last STOP in a few words: times of ABORT and its answer, measured motion."""
        ordered = stop_order_text(self.ordered_ms, "{}", unknown="not ordered")
        answered = (
            "NOT ANSWERED" if self.answered_ms is None else f"answered in {self.answered_ms:.0f} ms"
        )
        came_of, seconds = "measuring", (self.measured_ms or 0.0) / 1e3
        if self.motion is not None:
            came_of = measured_text(self.motion, self.rate_deg_s, seconds, why=self.detail)
        return f"{ordered}, {answered}: {came_of}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackStatus:
    """State of one track after its last frame; None: not known, or not measured in that frame."""

    track_id: int = 0
    name: str | None = None
    """Name of the identified catalogue object; None: not identified."""
    is_lead: bool = False
    state: str = ""
    """TRACK, COAST, or "trial" for a new track that too few frames have confirmed."""
    misses: int = 0
    """Number of exposures in a row without a measurement of the track."""
    is_kept: bool = False
    """True where the operator keeps the track: no miss ends it while it may be in the field."""
    age_s: float | None = None
    """Time since the track's second measurement, with which it began, s."""
    residual_east_arcsec: float | None = None
    """Innovation in the last frame, eastward: measured minus predicted, arcsec."""
    residual_north_arcsec: float | None = None
    nis: float | None = None
    snr: float | None = None
    """Integrated SNR of the track's last streak."""
    mag: float | None = None
    """Apparent magnitude of that streak in ``band``."""
    mag_sigma: float | None = None
    """One sigma of ``mag`` by noise and zero point, without the object's unknown colour."""
    band: Band | None = None
    """V, or instrumental where no zero point is known: 0 mag is then 1 ADU a second."""
    is_saturated: bool = False
    """True where that streak is saturated: it is brighter than ``mag``."""
    is_in_next_field: bool | None = None
    """True where the streak and its 3-sigma bounds fit into the field of the next aim."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NextAim:
    """Where the telescope looks in the exposure after the present or ordered one."""

    ra_icrs_deg: float = 0.0
    dec_icrs_deg: float = 0.0
    t_utc_ns: int = 0
    """Time of mid-exposure as now planned, UTC ns."""
    policy: str = ""
    """Policy of the aim among several tracks: lead, most or group."""
    reason: str = ""
    """Source of the predicted direction, and how many of the tracks are in the field."""
    moves_arcmin: float | None = None
    """Length of the slew to this aim, arcmin; None where the telescope stays where it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """State of the engine at one instant; None or empty: not known, or there is none."""

    state: str | None = None
    """State of the loop: IDLE, SEARCH, ACQUIRE, TRACK, COAST, LOST, MANUAL or FAULT."""
    holder: str | None = None
    """Holder of control of the mount: autonomy, operator or nobody."""
    is_held: bool = False
    """True where autonomy has control but the operator's hold stops its slews."""
    resumes_when_clear: bool = False
    """True where the hold ends by itself when stars are seen again."""
    frame_id: int | None = None
    """Number of the exposure begun last."""
    markable_frames: tuple[int, ...] | None = None
    """Numbers of the frames that still accept a mark by hand or another decision."""
    kept: str | None = None
    """Name or number of the ended track that can still be followed again."""
    kept_until_utc_ns: int | None = None
    is_resumable: bool = False
    """True where 'resume' gives autonomy the mount; False: it has to be armed first."""
    target: str | None = None
    ra_icrs_deg: float | None = None
    """Right ascension of the lead track at ``t_utc_ns``, ICRS."""
    dec_icrs_deg: float | None = None
    alt_deg: float | None = None
    """Altitude of the lead track, as seen from the site."""
    az_deg: float | None = None
    t_utc_ns: int | None = None
    mount_ra_icrs_deg: float | None = None
    """Right ascension last reported by the mount, ICRS; as a rule a second old."""
    mount_dec_icrs_deg: float | None = None
    mount_alt_deg: float | None = None
    """Altitude of the mount's reported direction, as seen from the site."""
    mount_az_deg: float | None = None
    mount_t_utc_ns: int | None = None
    """Time of the mount's last report, UTC ns; long ago where the mount is silent."""
    slew_left_s: float | None = None
    """Time left of the slew under way, s; None while the mount does not slew."""
    is_parked: bool | None = None
    is_slewing: bool | None = None
    """True where the mount's last report says that it slews."""
    is_tracking: bool | None = None
    """True where the mount's driver reports tracking; ``mount_motion`` is what was measured."""
    is_parking: bool | None = None
    """True where the mount's driver reports that it moves to its park position."""
    mount_motion: str | None = None
    """Motion measured from the mount's reported directions: stands, tracks, moves or unknown."""
    mount_rate_deg_s: float | None = None
    """Rate of the faster axis measured against the sky, deg/s; None while the motion is unknown."""
    pier_side: str | None = None
    now_utc_ns: int | None = None
    """The engine's clock now, UTC ns."""
    simulated_speed: float | None = None
    """Speed of a simulated night in times real time; 0: as fast as the machine can."""
    exposing_until_utc_ns: int | None = None
    """Time at which the shutter closes, UTC ns; None while it is closed."""
    next_start_utc_ns: int | None = None
    """Time at which the next exposure is to begin, UTC ns; None while that is not planned."""
    zero_point_mag: float | None = None
    """Magnitude that gives 1 ADU a second in the last frame; None: no plate, or too few stars."""
    limiting_mag: float | None = None
    """Magnitude of a star with an SNR of 5 in the last frame; None without a zero point."""
    tracks: tuple[TrackStatus, ...] = ()
    next_aim: NextAim | None = None
    """Where the exposure after the present one looks; None without a track."""
    pairs: tuple[PairMotion, ...] = ()
    """Relative motion of the tracks, two by two, as of the last frame, the nearest pair first."""
    unseen: tuple[UnseenMember, ...] = ()
    """Catalogued objects that should be in the field and have no track."""
    uncatalogued: tuple[int, ...] = ()
    next_limit: str | None = None
    """Name of the limit that sidereal tracking meets next; None: none within hours."""
    next_limit_utc_ns: int | None = None
    lifted: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    last_stop: LastStop | None = None
    temporary: Mapping[str, int] = field(default_factory=dict)
    """Settings changed for a number of frames, by name, with the number of frames left."""
    health: tuple[PartHealth, ...] = ()
    mount_lacks: tuple[str, ...] = ()
    """Functions that the mount's driver does not offer, each with the effect on the night."""
    machine: Machine | None = None
    """Heat, power, disk and time source of the machine; None: not read yet."""
    seat: str | None = None
    """The console in control; None: no console is."""
    seat_asked_by: str | None = None
    session: Path | None = None
    pid: int | None = None


def status_json(status: Status) -> dict[str, Any]:
    """Return a status for JSON: every field by its own name, and by the first version's."""
    data: dict[str, Any] = {"schema": SCHEMA}
    for name, value in to_json_types(status).items():
        data[name] = value
        if name in FIRST_NAMES:
            data[FIRST_NAMES[name]] = value
    return data


def read_status(data: Mapping[str, Any]) -> Status:
    """Return the status in an engine's answer; missing or invalid fields count as not reported."""
    first = {name: data[key] for name, key in FIRST_NAMES.items() if key in data}
    said = {"now_utc_ns": data.get("t_utc_ns"), **first, **data}
    return read_record(Status, said) or Status()
