"""The pane of figures: position, motion, coming events, last cycle, machine.

How much is shown depends on the room: three lines in a small terminal, a line for each group in a
larger one, a block for each group in a column of its own.
"""

from collections.abc import Mapping
from statistics import median_high
from typing import TYPE_CHECKING

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.leaving import coast_words, leaving_words
from rsoconsole.console.words.words import Item, cos_deg, frame_clock_utc_ns, items_in_rows
from rsoconsole.control import (
    is_mount_silent,
    limit_words,
    motion_words,
    mount_words,
    shutter_words,
    time_to_limit_s,
)
from rsoconsole.night import NightView, predicted_sigma_arcsec
from rsoconsole.records import TrackState
from rsoconsole.sky import separation_deg
from rsoconsole.words import (
    NS_PER_S,
    altaz,
    angle,
    direction,
    due_words,
    format_dec,
    format_ra,
    magnitude_words,
    short_figure,
    utc_text,
)

if TYPE_CHECKING:
    from rsoconsole.pipeline import SkyOutlook

OLD_S = 120.0
"""Age in seconds from which on a direction is shown with its time."""
LIMIT_SOON_S = 3600.0
"""Seconds ahead within which a coming limit is shown."""
SOON_S = 900.0
"""Seconds ahead within which a coming event is shown as a warning."""
NEAR_DEG = 5.0
"""Degrees to a limit within which the distance is shown as a warning."""
WIDE_COLUMNS = 72
GROUPS_ROWS, BLOCKS_ROWS = 5, 10
STAGES = {
    "read": "read",
    "process": "proc",
    "detect": "det",
    "solve": "solve",
    "filter": "filt",
    "order": "slew cmd",
}
"""Stages of a cycle that are shown, with their short names."""
SOLVER_FRAMES = 10
FOCUS_WINDOW, FOCUS_FRAMES = 300, 5
MACHINE = {"power", "CPU"}
"""Parts of the machine whose fault is shown as an alarm."""
FOCUS_WORSE = 1.15
"""Factor on the night's best FWHM above which the focus is shown as a warning."""


def figure_lines(
    night: NightView,
    engine: EngineView,
    outlook: "SkyOutlook | None",
    width: int,
    rows: int,
    *,
    keymap: Mapping[str, str] | None = None,
) -> list[Line]:
    """Build the lines of the pane of figures, the most important first.

    ``outlook``: None where it is not computed. ``keymap``: other keys for commands.
    """
    now = frame_clock_utc_ns(night, engine)
    leaving = leaving_words(night, engine, now, keymap)
    place, motion = _place_items(night, engine, now), _motion_items(night, engine, now, leaving)
    mount, plate = _mount_items(engine), _plate_items(night, engine)
    is_mounts = bool(mount) and place[0] == mount[0]
    schedule, cycle = _schedule_items(engine), _cycle_items(night, engine)
    ahead = _ahead_items(outlook, now)
    health = _health_items(night, engine)
    if is_mounts:
        mount = []  # where the telescope looks is told by the mount itself
    # A slew is said once: with the mount's own place where that is shown.
    placed = [*place, *mount] if rows >= BLOCKS_ROWS else place
    schedule = [item for item in schedule if item not in placed]
    if rows >= BLOCKS_ROWS:
        titled = {
            "where": place,
            "mount": [*mount, *plate],
            "motion": motion,
            "next": [*schedule, *ahead],
            "limits": _margin_items(outlook),
            "cycle": cycle,
            "machine": health,
        }
        return _blocks(titled, width, rows)
    if rows >= GROUPS_ROWS and width >= WIDE_COLUMNS:
        groups = [
            [*place, *_margin_items(outlook, "to the limits: ")],
            [*motion, *schedule, *mount, *plate],
            ahead or _margin_items(outlook),
            cycle,
            health,
        ]
        return [line for group in groups for line in items_in_rows(group, width, 1) or [[("", "")]]]
    worst = [item for item in health if item[1]]
    if rows >= 3 and width >= WIDE_COLUMNS:
        # The cycle's stages are for the larger screens: what the mount may not do weighs more.
        margins = _margin_items(outlook, "to the limits: ")[:2]
        coming = [*worst, *ahead[:2], *margins] if ahead or margins else [*worst, *cycle]
        groups = [place, [*motion, *(plate if is_mounts else ()), *schedule[:1]], coming]
        return [line for group in groups for line in items_in_rows(group, width, 1)]
    return items_in_rows([*place, *worst, *motion, *schedule[:1], *cycle], width, rows)


def _place_items(night: NightView, engine: EngineView, now: int | None) -> list[Item]:
    """Return the direction of telescope or track, limits that are near, altitude, pier side."""
    ra, dec = engine.ra_icrs_deg, engine.dec_icrs_deg
    alt, az = engine.alt_deg, engine.az_deg
    word, age = "", ""
    track = night.track
    seen_ns = engine.t_utc_ns
    if ra is None and track is not None:
        ra, dec, seen_ns = track.x[0] % 360.0, track.x[2], track.t_utc_ns
    limit = _limit_item(engine)
    if ra is None and (mount := _mount_items(engine)):
        # Nothing is followed: where the telescope really looks, by the mount's own word.
        return [*mount, *limit]
    if ra is None and night.pointing is not None:
        pointing = night.pointing
        word = "sent to " if pointing.is_ordered else "pointing "
        ra, dec = pointing.ra_icrs_deg, pointing.dec_icrs_deg
        alt, az = pointing.alt_deg, pointing.az_deg
        if (now or 0) - pointing.t_utc_ns > OLD_S * NS_PER_S:
            word, age = f"last {word}", f"as of {utc_text(pointing.t_utc_ns, zone='')}"
    elif ra is not None and dec is not None:
        word, age, (ra, dec) = _followed(track, (ra, dec), seen_ns, now)
    first = (
        f"{word}{direction(ra, dec)}" if ra is not None and dec is not None else "no direction yet"
    )
    pier = f"{engine.pier_side} of the pier" if engine.pier_side in {"east", "west"} else ""
    # What comes last has no room in a narrow terminal: never its age, nor a limit that is near.
    plain: list[Item] = [(item, "") for item in (first, age) if item]
    return [*plain, *limit, *((item, "") for item in (altaz(alt, az), pier) if item)]


def _followed(
    track: TrackState | None, at: tuple[float, float], seen_ns: int | None, now: int | None
) -> tuple[str, str, tuple[float, float]]:
    """Return words before and behind a direction, and the direction now, unless it is too old.

    ``at``: RA and Dec in degrees at ``seen_ns``, extrapolated to now by the track's rates.
    """
    if seen_ns is None or now is None:
        return "predicted ", "", at
    since_s = (now - seen_ns) / NS_PER_S
    if since_s > OLD_S:
        return "last ", f"as of {utc_text(seen_ns, zone='')}", at
    if track is None or track.t_utc_ns != seen_ns:
        return f"at {utc_text(seen_ns, zone='')} ", "", at
    ra, dec = at[0] + track.x[1] * since_s, at[1] + track.x[3] * since_s
    return "now ", "", (ra % 360.0, min(max(dec, -90.0), 90.0))


def _mount_items(engine: EngineView) -> list[Item]:
    """Return the mount's direction and motion, as it reports them; an old report is a warning."""
    if not engine.is_attached:
        return []
    ink: Ink = "warn" if is_mount_silent(engine) else ""
    return [(words, ink) for words in mount_words(engine)]


def _plate_items(night: NightView, engine: EngineView) -> list[Item]:
    """Return the last frame's centre by its plate, and its offset from the mount's report."""
    row = next((each for each in reversed(night.rows) if each.is_solved is not None), None)
    if row is None or row.plate_icrs_deg is None or engine.is_slewing:
        return []
    ra, dec = row.plate_icrs_deg
    items: list[Item] = [
        (f"solved RA {format_ra(ra, 1)} Dec {format_dec(dec, 0)} ({row.frame_id:04d})", "")
    ]
    if row.mount_icrs_deg is not None:
        off_deg = separation_deg(ra, dec, *row.mount_icrs_deg)
        items.append((f"the mount reports a place {60.0 * off_deg:.1f}′ off", ""))
    return items


def _limit_item(engine: EngineView) -> list[Item]:
    """Return the limit that the mount reaches by tracking, where that is soon."""
    left_s = time_to_limit_s(engine)
    if left_s is None or left_s >= LIMIT_SOON_S:
        return []
    return [(f"limit if tracking: {limit_words(engine)}", "warn" if left_s < SOON_S else "")]


def _motion_items(
    night: NightView, engine: EngineView, now_utc_ns: int | None, leaving: str
) -> list[Item]:
    track = night.track
    if track is None:
        is_looking = night.slew is not None and night.state in {"SEARCH", "ACQUIRE"}
        reason = f": {night.slew.reason}" if is_looking and night.slew is not None else ""
        if engine.is_attached and engine.state in {"TRACK", "COAST"}:
            return [("followed again: its first frame is to come", "")]
        if leaving:
            return [("nothing is followed", ""), (leaving, "warn")]
        return [(f"looking{reason}" if is_looking else "nothing is followed", "")]
    _, ra_rate, dec, dec_rate = track.x
    east, north = predicted_sigma_arcsec(track)
    is_old = now_utc_ns is not None and now_utc_ns - track.t_utc_ns > OLD_S * NS_PER_S
    age = f" as of {utc_text(track.t_utc_ns, zone='')}" if is_old else ""
    items: list[Item] = [
        (f"rate {ra_rate * cos_deg(dec) * 3600:+.2f} {dec_rate * 3600:+.2f} ″/s", ""),
        (f"prediction 3σ {angle(3 * max(east, north))}{age}", "warn" if age else ""),
    ]
    lead = next((each for each in night.tracks if each.is_lead), None)
    if lead is not None and (magnitude := magnitude_words(lead.light)):
        items.append((magnitude, ""))
    if coasts := coast_words(night, now_utc_ns):
        items[:0] = [(part, "warn") for part in coasts.split(" · ")]
    if leaving:
        items.insert(0, (leaving, "warn"))
    if reason := aim_reason(night, engine):
        items.append((f"aim: {reason}", ""))
    return items


def aim_reason(night: NightView, engine: EngineView) -> str:
    """Return what predicts the next aim, in the log's words; empty where there is none."""
    if engine.is_attached and engine.next_aim is not None:
        return engine.next_aim.reason
    # What led nowhere yet says nothing once something is followed.
    if night.slew is None or night.slew.track_id is None:
        return ""
    return night.slew.reason


def _schedule_items(engine: EngineView) -> list[Item]:
    """Return the slew or the exposure under way, and its end."""
    if not engine.is_attached:
        return []
    is_closed = engine.exposing_until_utc_ns is None
    moves = motion_words(engine) if engine.is_slewing and is_closed else ""
    return [(words, "") for words in (moves, shutter_words(engine)) if words]


def _ahead_items(outlook: "SkyOutlook | None", now: int | None) -> list[Item]:
    """Return coming events, the soonest first, then Moon and Sun."""
    if outlook is None or now is None:
        return []
    coming: list[tuple[int, str]] = []
    if outlook.target_limit is not None:
        at, refusal = outlook.target_limit
        coming.append((at, f"target meets its {refusal.limit} limit"))
    if outlook.eclipse_utc_ns is not None:
        is_now = outlook.eclipse_utc_ns <= outlook.t_utc_ns
        coming.append((outlook.eclipse_utc_ns, "in eclipse" if is_now else "eclipse"))
    if outlook.dark_utc_ns is None:
        coming.append((now, "it does not get dark"))
    else:
        dusk, dawn = outlook.dark_utc_ns
        coming.append((dawn, "dawn") if dusk <= now else (dusk, "dark"))
    items: list[Item] = []
    for at, what in sorted(coming):
        left_s = (at - now) / NS_PER_S
        words = what if left_s <= 0 else due_words(what, at, now)
        items.append((words, "warn" if left_s < SOON_S else ""))
    height = f"{outlook.moon_altitude_deg:+.0f}°"
    away = "" if outlook.moon_away_deg is None else f", {outlook.moon_away_deg:.0f}° away"
    is_up = outlook.moon_altitude_deg > 0.0
    moon = f"Moon {outlook.moon_lit:.0%} {height}{away}" if is_up else "Moon down"
    return [*items, (moon, ""), (f"Sun {outlook.sun_altitude_deg:+.0f}°", "")]


def _margin_items(outlook: "SkyOutlook | None", before: str = "") -> list[Item]:
    """Return how far the telescope is from each limit, degrees; ``before``: words before them."""
    items: list[Item] = []
    for name, margin in () if outlook is None else outlook.margins_deg:
        words = f"{name} {margin:.0f}°" if margin >= 0.0 else f"{-margin:.0f}° beyond {name}"
        items.append((words if items else before + words, "warn" if margin < NEAR_DEG else ""))
    return items


def _cycle_items(night: NightView, engine: EngineView) -> list[Item]:
    items: list[Item] = []
    if night.timing is not None:
        stages = night.timing.stage_ms
        if "total" in stages:
            items.append((f"cycle {short_figure(stages['total'] / 1000)} s", ""))
        items += [
            (f"{STAGES[stage]} {short_figure(stages[stage] / 1000)}", "")
            for stage in STAGES
            if stage in stages
        ]
    if not items:
        items.append(("no cycle yet", ""))
    if engine.reach == "recorded" and night.folder is not None:
        items.append((night.folder.name, ""))
    return items


def _health_items(night: NightView, engine: EngineView) -> list[Item]:
    """Return focus, solver, machine and instruments, faults first."""
    items = [*_focus_items(night), *_solver_items(night)]
    detect_ms = None if night.timing is None else night.timing.stage_ms.get("detect")
    if detect_ms is not None:
        items.append((f"detector {detect_ms:.0f} ms", ""))
    if engine.is_attached and engine.resumes_when_clear:
        items.append(("held until the stars are back", "warn"))
    if engine.is_attached:
        lent = engine.temporary.items()
        items += [(f"{name} for {n} more frame{'s' if n > 1 else ''}", "warn") for name, n in lent]
        for each in engine.health:
            # A weak supply or a slowed processor spoils the frames meanwhile.
            ink: Ink = "" if each.ok else "alarm" if each.name in MACHINE else "warn"
            items.append((f"{each.name} {each.text}", ink))
    # What has no room is left out: what is well before what is not.
    return sorted(items, key=lambda item: {"alarm": 0, "warn": 1}.get(item[1], 2))


def _solver_items(night: NightView) -> list[Item]:
    """Return how many of the last frames were plate-solved."""
    known = [row.is_solved for row in night.rows[-SOLVER_FRAMES:] if row.is_solved is not None]
    if not known:
        return []
    solved = sum(known)
    return [(f"solver {solved} of {len(known)}", "warn" if 2 * solved < len(known) else "")]


def _focus_items(night: NightView) -> list[Item]:
    """Return the FWHM of the stars, and whether it has grown since the night's best."""
    widths = [row.fwhm_px for row in night.rows[-FOCUS_WINDOW:] if row.fwhm_px is not None]
    if not widths:
        return []
    n = min(FOCUS_FRAMES, len(widths))
    medians = [median_high(widths[at : at + n]) for at in range(len(widths) - n + 1)]
    now_px, best_px = medians[-1], min(medians)
    if now_px > FOCUS_WORSE * best_px:
        return [(f"FWHM {now_px:.1f} px, was {best_px:.1f}: focus or seeing", "warn")]
    return [(f"FWHM {now_px:.1f} px", "")]


def _blocks(titled: dict[str, list[Item]], width: int, rows: int) -> list[Line]:
    """Return each group behind its title, in as many lines as it takes and there is room for."""
    label_columns = max(len(title) for title in titled) + 2
    lines: list[Line] = []
    for title, items in titled.items():
        for number, line in enumerate(items_in_rows(items, width - label_columns, rows)):
            label = f" {title}" if number == 0 else ""
            lines.append([(label.ljust(label_columns), "dim"), *line])
    return lines[:rows]
