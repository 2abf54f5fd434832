"""The status of engine and mount in words."""

from typing import Literal

from rsoconsole.control.fields import MovePreview
from rsoconsole.control.status import NextAim, Status, TrackStatus
from rsoconsole.control.wire import one_line
from rsoconsole.records import Band
from rsoconsole.words import (
    NS_PER_S,
    altaz,
    column_band,
    column_head,
    column_words,
    direction,
    duration_words,
    format_dec,
    format_ra,
    light_words,
    rate_text,
    utc_text,
)

HOLDERS = {
    "autonomy": ("AUTO has the mount", "autonomy has the mount", "AUTO had the mount"),
    "operator": ("YOU have the mount", "the operator has the mount", "the operator had it"),
    "nobody": ("nobody has the mount", "nobody has the mount", "nobody had the mount"),
}
"""Words for each holder of control: shown to the console in control, to others, and in the past."""

OLD_S = 10.0
"""Age above which a mount's report is shown with its time, s."""
STANDS, NOT_KNOWN = "stands, measured", "how it moves is not known"


def mount_holder_words(holder: str | None, form: Literal["seat", "plain", "past"]) -> str:
    """Return the holder of the mount in words.

    ``form``: "seat" for the console in control, "plain" for others, "past" for a past event.
    """
    if holder in HOLDERS:
        return HOLDERS[holder][("seat", "plain", "past").index(form)]
    return "" if form == "past" else "who has the mount is not known"


def fault_words(status: Status) -> list[str]:
    """Return a line for each fault of the engine and one for the overridden checks.

    In the state FAULT without a fault, a line says that its cause is over.
    """
    words = [f"FAULT {fault}" for fault in dict.fromkeys(status.faults)]
    if status.state == "FAULT" and not words:
        words = ["the cause of the FAULT is over: arm it to go on"]
    return [*words, f"overridden: {', '.join(status.lifted)}"] if status.lifted else words


def hold_words(status: Status) -> str:
    """Return that autonomy is on hold, and until when, in words; empty without a hold."""
    if not status.is_held:
        return ""
    return "HELD until it clears" if status.resumes_when_clear else "HELD"


def time_to_limit_s(status: Status) -> float | None:
    """Return the time until sidereal tracking reaches a limit, s; None: not within hours."""
    return _left_s(status, status.next_limit_utc_ns)


def limit_words(status: Status) -> str:
    """Return the next limit and the time until it is reached, in words; empty: there is none."""
    left_s = time_to_limit_s(status)
    return "" if left_s is None else f"{status.next_limit} in {left_s / 60.0:.0f} min"


def shutter_words(status: Status) -> str:
    """Return the time left of the exposure, or until the next one begins; empty where not known."""
    left_s = _left_s(status, status.exposing_until_utc_ns)
    wait_s = _left_s(status, status.next_start_utc_ns)
    if left_s is not None:
        return f"exposing, {max(left_s, 0.0):.0f} s left"
    return "" if wait_s is None else f"next exposure in {max(wait_s, 0.0):.0f} s"


def _left_s(status: Status, until_utc_ns: int | None) -> float | None:
    if status.now_utc_ns is None or until_utc_ns is None:
        return None
    return (until_utc_ns - status.now_utc_ns) / NS_PER_S


def mount_words(status: Status, name: str = "mount ") -> tuple[str, ...]:
    """Return the mount's position (ICRS), its altitude and azimuth, and its motion in words.

    Empty where the mount never reported.
    """
    ra, dec = status.mount_ra_icrs_deg, status.mount_dec_icrs_deg
    if ra is None or dec is None:
        return ()
    words = [f"{name}RA {format_ra(ra, 1)} Dec {format_dec(dec, 0)}"]
    if high := altaz(status.mount_alt_deg, status.mount_az_deg):
        words.append(high)
    does = motion_words(status)
    if is_mount_silent(status):
        does = f"silent since {utc_text(status.mount_t_utc_ns)}"
    return *words, does


def motion_words(status: Status) -> str:
    """Return the mount's motion in words: as measured, else marked as the driver's word.

    For a slewing or parked mount, return what the driver reports, and what was measured where that
    contradicts it.
    """
    measured, claimed = _measured(status), _claimed(status)
    if status.is_parked:
        return "parked" if measured in ("", STANDS) else f"parked, but it {measured}"
    if status.is_slewing:
        is_at_rest = status.mount_motion in ("stands", "tracks")
        return f"{claimed}, but it {measured}" if is_at_rest else claimed
    if not measured and status.is_tracking is None:
        return NOT_KNOWN
    return measured or f"{claimed} by its driver's word"


def _measured(status: Status) -> str:
    """Return the measured motion in words; empty: not known."""
    match status.mount_motion:
        case "stands":
            return STANDS
        case "tracks":
            return "tracks, measured"
        case "moves":
            rate_deg_s = status.mount_rate_deg_s
            at = "" if rate_deg_s is None else f" at {rate_text(rate_deg_s)}"
            return f"moves{at}, measured"
    return ""


def _claimed(status: Status) -> str:
    if status.is_slewing:
        what, left_s = "parking" if status.is_parking else "slewing", status.slew_left_s
        return what if left_s is None else f"{what}, {left_s:.0f} s left"
    return "tracks" if status.is_tracking else "stands"


def is_mount_silent(status: Status) -> bool:
    """True where the mount's last report is older than ``OLD_S``."""
    said_s = _left_s(status, status.mount_t_utc_ns)
    return said_s is not None and said_s < -OLD_S


UNREADABLE = "the engine's answer cannot be read: are both of one version?"


def preview_lines(preview: MovePreview | None, ending: str = "") -> list[str]:
    """Return the engine's preview of a move in lines.

    ``ending``: last line where the move is allowed; a refused move ends with its reason.
    """
    if preview is None:
        return [UNREADABLE]
    after = preview.pier_side_after
    side = f", to the {after} of the pier" if after and after != preview.pier_side else ""
    margins = "  ".join(f"{name} {value:+.0f}°" for name, value in preview.margins_deg)
    of_date = direction(preview.ra_date_deg, preview.dec_date_deg)
    rows = (
        ("ICRS", direction(preview.ra_icrs_deg, preview.dec_icrs_deg)),
        ("of date", f"{of_date}   {altaz(preview.alt_deg, preview.az_deg)}"),
        ("way", f"{preview.way_deg:.1f}°, {duration_words(preview.slew_s)}{side}"),
        ("limits", margins),
        ("REFUSED", preview.refused),
    )
    lines = [f"{label:<8} {words}" for label, words in rows if words]
    return [*lines, ending] if ending and not preview.refused else lines


NAME_COLUMNS = 22
MAG_COLUMNS = 6


def track_table(status: Status) -> list[str]:
    """Return a heading and a line for each track, of at most 80 columns; empty without tracks.

    Magnitudes have a column where one is known, headed "inst" where all are instrumental.
    """
    tracks = status.tracks
    if not tracks:
        return []
    is_lit = any(each.mag is not None for each in tracks)
    band = column_band(each.band for each in tracks) if is_lit else None
    mag = "" if band is None else f" {column_head(band):>{MAG_COLUMNS}}"
    head = (
        f"track {'name':<{_name_columns(band)}} {'state':<9} {'age':>6} {'residual/arcsec':>15}"
        f" {'NIS':>5} {'SNR':>5}{mag} next"
    )
    return [head, *(_row(each, band) for each in tracks)]


def _name_columns(band: Band | None) -> int:
    """Return the columns of a name, ``band`` being that of the column of magnitudes, if any."""
    return NAME_COLUMNS if band is None else NAME_COLUMNS - MAG_COLUMNS + 1


def track_magnitude_words(track: TrackStatus) -> str:
    """Format a track's magnitude with its sigma and band: mag 12.41±.03 V; empty: not known."""
    is_saturated = track.is_saturated
    return light_words(track.mag, track.mag_sigma, track.band, is_saturated=is_saturated)


def next_aim_parts(aim: NextAim) -> list[str]:
    """Return the next aim in four parts: policy and reason, position, time, slew."""
    return [
        f"next aim, {aim.policy}: {aim.reason}",
        direction(aim.ra_icrs_deg, aim.dec_icrs_deg),
        utc_text(aim.t_utc_ns, zone=""),
        "no slew" if aim.moves_arcmin is None else f"slew {aim.moves_arcmin:.1f}′",
    ]


def track_state_words(state: str, misses: int, *, is_kept: bool) -> str:
    """Return a track's state after its last frame, with "+" where the operator keeps the track.

    ``misses``: number of exposures in a row without a measurement.
    """
    return f"{state} {misses or ''}".rstrip() + ("+" if is_kept else "")


def _row(track: TrackStatus, band: Band | None) -> str:
    name, columns = one_line(track.name or "-"), _name_columns(band)
    if len(name) > columns:
        name = f"{name[: columns - 1]}…"
    state = track_state_words(track.state, track.misses, is_kept=track.is_kept)
    east, north = track.residual_east_arcsec, track.residual_north_arcsec
    off = "-" if east is None or north is None else f"{east:+.2f} {north:+.2f}"
    age = "-" if track.age_s is None else duration_words(track.age_s)
    is_in = {True: "in", False: "out", None: "-"}[track.is_in_next_field]
    mag = "" if band is None else column_words(track.mag, track.band, band)
    return (
        f"{track.track_id:>4}{'*' if track.is_lead else ' '} {name:<{columns}}"
        f" {state:<9} {age:>6} {off:>15}"
        f" {_figure(track.nis, 1):>5} {_figure(track.snr, 0):>5}"
        f"{mag and f' {mag:>{MAG_COLUMNS}}'} {is_in}"
    )


def _figure(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if value < 1000.0 else f"{value:.0f}" if value < 1e5 else ">99999"
