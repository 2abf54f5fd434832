"""The engine's status: one record that crosses the wire, and its JSON for scripts.

The engine fills it, consoles, panel and shell read it. In JSON a field has its own name, which says
unit and frame; the names of the first version stand beside them and stay.
"""

import types
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.control.fields import as_json, read_record
from rsoconsole.records import PairMotion, StopOutcome, UnseenMember
from rsoconsole.words import measured_text, ordered_text

SCHEMA = 1
"""Version of all JSON that the program prints and the engine answers; raised where a meaning
changes."""
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
"""First version's key of each field, which scripts may still read and older engines send."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Health of one part of machine or instruments."""

    name: str = ""
    ok: bool = False
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """The machine that the engine runs on, at the last reading; None: not reported."""

    model: str | None = None
    """Model of the board, from its device tree."""
    cpu_temperature_c: float | None = None
    cpu_frequency_mhz: float | None = None
    cpu_frequency_max_mhz: float | None = None
    is_under_voltage: bool | None = None
    is_throttled: bool | None = None
    """True where the processor is forced to slow down: for heat, or a weak power supply."""
    has_been_under_voltage: bool | None = None
    has_been_throttled: bool | None = None
    troubles: tuple[str, ...] = ()
    """Present troubles, in words."""
    recording_medium: str | None = None
    """Medium that the session is written to."""
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
    """The last STOP of this engine: ordered, answered by the driver, measured."""

    number: int = 0
    """Number among the STOPs of this engine."""
    by: str = ""
    t_utc_ns: int | None = None
    """Time at which it was given, by the engine's clock, UTC ns."""
    ordered_ms: float | None = None
    """Time until ABORT was on its way to the mount, ms; None: not yet, or never."""
    answered_ms: float | None = None
    """Time until the driver had taken it, ms; None: not yet, or never."""
    measured_ms: float | None = None
    """Time until the mount's motion was known, ms; None: not yet."""
    motion: StopOutcome | None = None
    """Measured motion since: stands, tracks, moves, unknown; None: not yet."""
    rate_deg_s: float | None = None
    """Rate of the faster axis while it moves, deg/s."""
    is_over: bool = False
    """True where the mount has been measured to be at rest since, or was armed again."""
    is_superseded: bool = False
    """True where it is no longer measured, because another order came."""
    path: str | None = None
    detail: str = ""
    """Reason why it is not answered, or not known."""

    @property
    def is_at_rest(self) -> bool:
        """True where the mount was measured to stand or to track."""
        return self.motion in ("stands", "tracks")

    @property
    def text(self) -> str:
        """The last STOP in a few words."""
        ordered = ordered_text(self.ordered_ms, "{}", unknown="not ordered")
        answered = (
            "NOT ANSWERED" if self.answered_ms is None else f"answered in {self.answered_ms:.0f} ms"
        )
        came_of, seconds = "measuring", (self.measured_ms or 0.0) / 1e3
        if self.motion is not None:
            came_of = measured_text(self.motion, self.rate_deg_s, seconds, why=self.detail)
        return f"{ordered}, {answered}: {came_of}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackNow:
    """One track after its last frame; None: not known, or not measured in that frame."""

    track_id: int = 0
    """Number in the session."""
    name: str | None = None
    """Catalogue name, once it is identified."""
    is_lead: bool = False
    state: str = ""
    """State: TRACK, COAST, or "trial" until a third frame shows it."""
    misses: int = 0
    """Number of exposures since its last measurement."""
    is_kept: bool = False
    """True where the operator keeps it: no miss ends it while it may be in the field."""
    age_s: float | None = None
    """Time since its second measurement, with which it began, s."""
    residual_east_arcsec: float | None = None
    """Innovation in its last frame: measured minus predicted, arcsec."""
    residual_north_arcsec: float | None = None
    nis: float | None = None
    snr: float | None = None
    """Integrated SNR of its last streak."""
    is_in_next_field: bool | None = None
    """True where its streak and its bounds fit into the field of the next aim."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NextAim:
    """The aim of the exposure after the present or ordered one."""

    ra_icrs_deg: float = 0.0
    dec_icrs_deg: float = 0.0
    t_utc_ns: int = 0
    """Mid-exposure as planned now, UTC ns."""
    policy: str = ""
    """Policy: lead, most or group."""
    reason: str = ""
    """Source of the prediction, and how many of the tracks are in its field."""
    moves_arcmin: float | None = None
    """Length of the slew to it, arcmin; None where the telescope stays where it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The engine at one instant; None or empty: not known, or not so."""

    state: str | None = None
    """State of the loop: IDLE, SEARCH, ACQUIRE, TRACK, COAST, LOST, MANUAL or FAULT."""
    holder: str | None = None
    """Holder of control: autonomy, operator, nobody."""
    is_held: bool = False
    """True where autonomy has control and gives no slews."""
    resumes_when_clear: bool = False
    """True where the hold ends by itself when the stars are back."""
    frame_id: int | None = None
    """Number of the exposure begun last."""
    markable_frames: tuple[int, ...] | None = None
    """Frames that still accept a mark by hand or another decision."""
    kept: str | None = None
    """Name or number of a track that was ended and can be followed again."""
    kept_until_utc_ns: int | None = None
    is_resumable: bool = False
    """True where 'resume' gives autonomy the mount; else it has to be armed first."""
    target: str | None = None
    """Name of the lead track, once it is identified."""
    ra_icrs_deg: float | None = None
    """Right ascension of the lead track at ``t_utc_ns``."""
    dec_icrs_deg: float | None = None
    alt_deg: float | None = None
    """Altitude of the lead track, as seen from the site."""
    az_deg: float | None = None
    t_utc_ns: int | None = None
    mount_ra_icrs_deg: float | None = None
    """Right ascension reported by the mount, as a rule a second ago."""
    mount_dec_icrs_deg: float | None = None
    mount_alt_deg: float | None = None
    """Altitude of the mount's reported direction, as seen from the site."""
    mount_az_deg: float | None = None
    mount_t_utc_ns: int | None = None
    """Time of the mount's report, UTC ns: long ago where it is silent."""
    slew_left_s: float | None = None
    """Time left of the slew under way, s; None while the mount does not slew."""
    is_parked: bool | None = None
    is_slewing: bool | None = None
    """True where the mount reported a slew, a second ago."""
    is_tracking: bool | None = None
    """True where its driver reports tracking: ``mount_motion`` is the measured motion."""
    is_parking: bool | None = None
    """True on its way to its park position, as its driver reports."""
    mount_motion: str | None = None
    """Motion measured from its reported directions: stands, tracks, moves or unknown."""
    mount_rate_deg_s: float | None = None
    """Rate of the faster axis measured against the sky, deg/s; None while the motion is unknown."""
    pier_side: str | None = None
    now_utc_ns: int | None = None
    """Present of the engine's clock, UTC ns."""
    simulated_speed: float | None = None
    """Speed of a simulated night's clock, in units of the wall's; 0: as fast as it goes."""
    exposing_until_utc_ns: int | None = None
    """Time at which the shutter closes, UTC ns; None while it is closed."""
    next_start_utc_ns: int | None = None
    """Time at which the next exposure is to begin, UTC ns; None while that is not planned."""
    tracks: tuple[TrackNow, ...] = ()
    """All tracks, by number."""
    next_aim: NextAim | None = None
    """The next aim; None without a track."""
    pairs: tuple[PairMotion, ...] = ()
    """Relative motion of the tracks as of the last frame, the nearest first."""
    unseen: tuple[UnseenMember, ...] = ()
    """Catalogued objects that should be in the field and have no track."""
    uncatalogued: tuple[int, ...] = ()
    """Tracks that no catalogued object explains."""
    next_limit: str | None = None
    """The limit that sidereal tracking meets within hours."""
    next_limit_utc_ns: int | None = None
    lifted: tuple[str, ...] = ()
    """Checks and limits that the operator has overridden, by name."""
    faults: tuple[str, ...] = ()
    last_stop: LastStop | None = None
    temporary: Mapping[str, int] = field(default_factory=dict)
    """Settings that hold for a number of frames, with the frames left."""
    health: tuple[Health, ...] = ()
    mount_lacks: tuple[str, ...] = ()
    """Abilities that the mount's driver lacks, each with its effect."""
    machine: Machine | None = None
    """Heat, power, disk and time source of the machine."""
    seat: str | None = None
    """The console in control; None while none is."""
    seat_asked_by: str | None = None
    session: Path | None = None
    pid: int | None = None


def status_json(status: Status) -> dict[str, Any]:
    """Return a status as JSON carries it: every field by its name, and by the first version's."""
    data: dict[str, Any] = {"schema": SCHEMA}
    for name, value in as_json(status).items():
        data[name] = value
        if name in FIRST_NAMES:
            data[FIRST_NAMES[name]] = value
    return data


def read_status(data: Mapping[str, Any]) -> Status:
    """Return the status in an engine's answer; missing or invalid fields count as not reported."""
    first = {name: data[key] for name, key in FIRST_NAMES.items() if key in data}
    said = {"now_utc_ns": data.get("t_utc_ns"), **first, **data}
    return read_record(Status, said) or Status()
