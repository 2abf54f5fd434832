"""The engine's status: one record that crosses the wire, and the JSON that scripts read of it.

The engine fills it, consoles, panel and shell read it. In JSON a field has its own name, which
says unit and frame; the names of the first version stand beside them and stay.
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
"""Of all JSON that the program prints and the engine answers; raised where a meaning changes."""
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
"""Field -> its key in the first version, which scripts may still read and older engines say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """The health of one part of machine or instruments."""

    name: str = ""
    ok: bool = False
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """The machine that the engine runs on, as it was seen last; None: it does not say."""

    model: str | None = None
    """Of the board, from its device tree."""
    cpu_temperature_c: float | None = None
    cpu_frequency_mhz: float | None = None
    cpu_frequency_max_mhz: float | None = None
    is_under_voltage: bool | None = None
    is_throttled: bool | None = None
    """The processor is slowed down by force: for heat, or because its supply is too weak."""
    has_been_under_voltage: bool | None = None
    has_been_throttled: bool | None = None
    troubles: tuple[str, ...] = ()
    """What is not well, in words."""
    recording_medium: str | None = None
    """What the session is written to."""
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
    """Of the STOPs of this engine."""
    by: str = ""
    t_utc_ns: int | None = None
    """When it was given, by the engine's clock."""
    ordered_ms: float | None = None
    """Until ABORT was on its way to the mount; None: not yet, or never."""
    answered_ms: float | None = None
    """Until the driver had taken it; None: not yet, or never."""
    measured_ms: float | None = None
    """Until it was known how the mount moves; None: not yet."""
    motion: StopOutcome | None = None
    """How it moves since, as measured: stands, tracks, moves, unknown; None: not yet."""
    rate_deg_s: float | None = None
    """Of the faster axis, where it moves."""
    is_over: bool = False
    """The mount has been measured to be at rest since, or was armed again."""
    is_superseded: bool = False
    """Not measured any longer, because another order came."""
    path: str | None = None
    detail: str = ""
    """Why it is not answered, or not known."""

    @property
    def is_at_rest(self) -> bool:
        """True where the mount was measured to stand or to track."""
        return self.motion in ("stands", "tracks")

    @property
    def text(self) -> str:
        """In a few words."""
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
    """One track as its last frame left it; None: not known, or not measured in that frame."""

    track_id: int = 0
    """Its number in the session."""
    name: str | None = None
    """In the catalogue, once it is identified."""
    is_lead: bool = False
    state: str = ""
    """TRACK, COAST, or "trial" until a third frame shows it."""
    misses: int = 0
    """Exposures since its last measurement."""
    is_kept: bool = False
    """The operator keeps it: no miss ends it while it may be in the field."""
    age_s: float | None = None
    """Since its second measurement, with which it began."""
    residual_east_arcsec: float | None = None
    """Measured minus predicted, of its last frame."""
    residual_north_arcsec: float | None = None
    nis: float | None = None
    snr: float | None = None
    """Integrated, of the streak that it took last."""
    is_in_next_field: bool | None = None
    """Whether its streak and its bounds fit into the field of the next aim."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NextAim:
    """The aim of the exposure after the present or ordered one."""

    ra_icrs_deg: float = 0.0
    dec_icrs_deg: float = 0.0
    t_utc_ns: int = 0
    """Middle of that exposure, as planned now."""
    policy: str = ""
    """lead, most or group."""
    reason: str = ""
    """By what it is predicted, and how many of the tracks stand in its field."""
    moves_arcmin: float | None = None
    """Way of the slew to it; None where the telescope stays where it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The engine at one instant; None or empty: not known, or not so."""

    state: str | None = None
    """Of the loop: IDLE, SEARCH, ACQUIRE, TRACK, COAST, LOST, MANUAL or FAULT."""
    holder: str | None = None
    """Who has the mount: autonomy, operator, nobody."""
    is_held: bool = False
    """Autonomy has the mount and gives it no slews."""
    resumes_when_clear: bool = False
    """The hold ends by itself when the stars are back."""
    frame_id: int | None = None
    """The exposure begun last."""
    markable_frames: tuple[int, ...] | None = None
    """In which frames a mark by hand, or another word on a frame, is still taken."""
    kept: str | None = None
    """Name or number of a track that was ended and can be followed again."""
    kept_until_utc_ns: int | None = None
    is_resumable: bool = False
    """Whether 'resume' gives autonomy the mount; else it has to be armed first."""
    target: str | None = None
    """Name of what is followed, once it is identified."""
    ra_icrs_deg: float | None = None
    """Where what is followed was at ``t_utc_ns``."""
    dec_icrs_deg: float | None = None
    alt_deg: float | None = None
    """The same as seen from the site."""
    az_deg: float | None = None
    t_utc_ns: int | None = None
    mount_ra_icrs_deg: float | None = None
    """Where the mount itself said to be, as a rule a second ago."""
    mount_dec_icrs_deg: float | None = None
    mount_alt_deg: float | None = None
    """The same as seen from the site."""
    mount_az_deg: float | None = None
    mount_t_utc_ns: int | None = None
    """When the mount said so: long ago where it is silent."""
    slew_left_s: float | None = None
    """How long the slew under way still takes; None while the mount does not slew."""
    is_parked: bool | None = None
    is_slewing: bool | None = None
    """As the mount said a second ago."""
    is_tracking: bool | None = None
    """By its driver's word: ``mount_motion`` is what was measured."""
    is_parking: bool | None = None
    """On its way to its park position, by its driver's word."""
    mount_motion: str | None = None
    """Measured from the directions that it reported: stands, tracks, moves or unknown."""
    mount_rate_deg_s: float | None = None
    """Measured against the sky, of the faster axis; None while the motion is unknown."""
    pier_side: str | None = None
    now_utc_ns: int | None = None
    """The engine's clock."""
    simulated_speed: float | None = None
    """How many times as fast as the wall's a simulated night's clock runs; 0: as it goes."""
    exposing_until_utc_ns: int | None = None
    """When the shutter closes; None while it is closed."""
    next_start_utc_ns: int | None = None
    """When the next exposure is to begin; None while that is not planned."""
    tracks: tuple[TrackNow, ...] = ()
    """All that are followed, by their numbers."""
    next_aim: NextAim | None = None
    """None while nothing is followed."""
    pairs: tuple[PairMotion, ...] = ()
    """How they move to each other as of the last frame, the nearest first."""
    unseen: tuple[UnseenMember, ...] = ()
    """Catalogued objects that should be in the field and have no track."""
    uncatalogued: tuple[int, ...] = ()
    """Tracks that no catalogued object explains."""
    next_limit: str | None = None
    """Which one sidereal tracking runs into within hours."""
    next_limit_utc_ns: int | None = None
    lifted: tuple[str, ...] = ()
    """Checks and limits that the operator has overridden, by name."""
    faults: tuple[str, ...] = ()
    last_stop: LastStop | None = None
    temporary: Mapping[str, int] = field(default_factory=dict)
    """Settings that hold for a number of further frames."""
    health: tuple[Health, ...] = ()
    mount_lacks: tuple[str, ...] = ()
    """What the mount's driver does not offer, each with what follows from it."""
    machine: Machine | None = None
    """Heat, power, disk and time source."""
    seat: str | None = None
    """The console in control; None while none is."""
    seat_asked_by: str | None = None
    session: Path | None = None
    pid: int | None = None


def status_json(status: Status) -> dict[str, Any]:
    """A status as JSON carries it: every field by its name, and by the name it had first."""
    data: dict[str, Any] = {"schema": SCHEMA}
    for name, value in as_json(status).items():
        data[name] = value
        if name in FIRST_NAMES:
            data[FIRST_NAMES[name]] = value
    return data


def read_status(data: Mapping[str, Any]) -> Status:
    """The status in an engine's answer; what is missing or odd in it counts as not said."""
    first = {name: data[key] for name, key in FIRST_NAMES.items() if key in data}
    said = {"now_utc_ns": data.get("t_utc_ns"), **first, **data}
    return read_record(Status, said) or Status()
