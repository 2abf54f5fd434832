"""The tracks of the field and the next aim in plain lines, for shell and console alike."""

from rsoconsole.control import NextAim, Status, TrackNow, one_line
from rsoconsole.words import clock, direction, span

NAME_COLUMNS = 22
_HEAD = (
    f"track {'name':<{NAME_COLUMNS}} {'state':<9} {'age':>6} {'residual/arcsec':>15}"
    f" {'NIS':>5} {'SNR':>5} next"
)


def track_table(status: Status) -> list[str]:
    """A head and a line for each track, of at most 80 columns; empty where nothing is followed."""
    if not status.tracks:
        return []
    return [_HEAD, *map(_row, status.tracks)]


def aim_parts(aim: NextAim) -> list[str]:
    """Policy with reason, place and time of the exposure after the next one, and its slew."""
    return [
        f"next aim, {aim.policy}: {aim.reason}",
        direction(aim.ra_icrs_deg, aim.dec_icrs_deg),
        clock(aim.t_utc_ns, zone=""),
        "no slew" if aim.moves_arcmin is None else f"slew {aim.moves_arcmin:.1f}′",
    ]


def state_words(state: str, misses: int, *, is_kept: bool) -> str:
    """What became of it in the last frame; "+": the operator keeps it."""
    return f"{state} {misses or ''}".rstrip() + ("+" if is_kept else "")


def _row(track: TrackNow) -> str:
    name = one_line(track.name or "-")
    if len(name) > NAME_COLUMNS:
        name = f"{name[: NAME_COLUMNS - 1]}…"
    state = state_words(track.state, track.misses, is_kept=track.is_kept)
    east, north = track.residual_east_arcsec, track.residual_north_arcsec
    age = "-" if track.age_s is None else span(track.age_s)
    off = "-" if east is None or north is None else f"{east:+.2f} {north:+.2f}"
    age = "-" if track.age_s is None else span(track.age_s)
    is_in = {True: "in", False: "out", None: "-"}[track.is_in_next_field]
    return (
        f"{track.track_id:>4}{'*' if track.is_lead else ' '} {name:<{NAME_COLUMNS}}"
        f" {state:<9} {age:>6} {off:>15}"
        f" {_figure(track.nis, 1):>5} {_figure(track.snr, 0):>5} {is_in}"
    )


def _figure(value: float | None, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if value < 1000.0 else f"{value:.0f}" if value < 1e5 else ">99999"
