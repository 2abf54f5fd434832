"""The engine in one line, for scripts, tmux and consoles."""

from dataclasses import dataclass

from rsoconsole.engine.states import Charge
from rsoconsole.engine.watch import Watch
from rsoconsole.records import LoopState


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The engine in one line."""

    state: LoopState
    holder: str
    is_held: bool
    frame: int
    ra: float | None
    dec: float | None
    t_utc_ns: int | None
    """Of the direction."""
    mount_ra: float | None
    """Where the mount itself said to be a second ago."""
    mount_dec: float | None
    is_parked: bool | None
    now_utc_ns: int
    next_limit: str | None
    """What sidereal tracking runs into within hours, and when."""
    lifted: tuple[str, ...]
    """Checks that the operator has overridden by name."""
    faults: tuple[str, ...]
    is_slewing: bool | None = None
    """As the mount said a second ago."""
    is_tracking: bool | None = None
    pier_side: str | None = None
    exposing_until_utc_ns: int | None = None
    """When the shutter closes; None while it is closed."""
    resumes_when_clear: bool = False
    """The hold ends by itself when the stars are back."""
    next_start_utc_ns: int | None = None
    """When the next exposure is to begin; None while that is not planned."""


def status_of(
    charge: Charge,
    watch: Watch,
    *,
    frame: int,
    now_utc_ns: int,
    faults: tuple[str, ...],
    exposing_until_utc_ns: int | None = None,
    next_start_utc_ns: int | None = None,
) -> Status:
    """A snapshot; every part of it is read once, so that any thread may ask."""
    track = charge.following.track
    limit = watch.next_limit
    report = watch.last_report
    ahead = None
    if limit is not None:
        ahead = f"{limit[1].limit} in {(limit[0] - now_utc_ns) / 60e9:.0f} min"
    return Status(
        state=charge.state,
        holder=charge.holder,
        is_held=charge.is_held,
        resumes_when_clear=charge.resumes_when_clear,
        frame=frame,
        ra=None if track is None else track.x[0] % 360.0,
        dec=None if track is None else track.x[2],
        t_utc_ns=None if track is None else track.t_utc_ns,
        mount_ra=None if report is None else report.ra_icrs_deg,
        mount_dec=None if report is None else report.dec_icrs_deg,
        is_parked=None if report is None else report.is_parked,
        now_utc_ns=now_utc_ns,
        next_limit=ahead,
        lifted=tuple(sorted(watch.lifted)),
        faults=faults,
        is_slewing=None if report is None else report.is_slewing,
        is_tracking=None if report is None else report.is_tracking,
        pier_side=None if report is None else report.pier_side,
        exposing_until_utc_ns=exposing_until_utc_ns,
        next_start_utc_ns=next_start_utc_ns,
    )
