"""Grants what the operator wishes, on the loop's own thread: one function a verb."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rsoconsole.config import AimConfig
from rsoconsole.engine import verdicts
from rsoconsole.engine.hands import NS
from rsoconsole.engine.intentions import Wish, change_record, changed
from rsoconsole.engine.seek import seek
from rsoconsole.engine.states import Disarmed, Held, Resumed, Taken
from rsoconsole.engine.watch import LIFTS
from rsoconsole.pipeline.aim import follow_direction, slew_to
from rsoconsole.sky.angles import separation_deg, wrap_360
from rsoconsole.sky.frames import icrs_to_altaz, icrs_to_jnow
from rsoconsole.sky.limits import Pose

if TYPE_CHECKING:
    from rsoconsole.engine.loop import Engine

DONE = "done"


@dataclass(frozen=True, slots=True, kw_only=True)
class HandMove:
    """A move by hand under way, ICRS degrees."""

    direction: tuple[float, float]
    """Where the telescope is to look."""
    command: tuple[float, float]
    """What the mount was told for that."""


LARGEST_NUDGE_ARCMIN = 600.0
AIMS = tuple(AimConfig.model_fields)
"""By which an intention to look beside the prediction is known."""


def grant(engine: "Engine", wish: Wish) -> str:
    """Carry out one wish; returns its outcome in words.

    Raises ValueError with the reason where it cannot be, InstrumentError where the mount fails.
    """
    granters: dict[str, Callable[[Engine, Wish], str]] = {
        "arm": _arm,
        "disarm": lambda e, w: _pass(e, Disarmed(by=w.by)),
        "hold": _hold,
        "resume": lambda e, w: _pass(e, Resumed(by=w.by)),
        "goto": _goto,
        "nudge": _goto,
        "abort": lambda _e, _w: "the exposure was given up",
        "track": _track,
        "seek": lambda e, w: seek(e, w.by),
        "park": _park,
        "unpark": _unpark,
        "set": _set,
        "shutdown": lambda _e, _w: DONE,
        **dict.fromkeys(verdicts.VERBS, _rule),
    }
    granter = granters.get(wish.verb)
    if granter is None:
        raise ValueError(f"the engine knows no '{wish.verb}'")
    return granter(engine, wish)


def overridden(arguments: Mapping[str, Any]) -> frozenset[str]:
    """The checks that an intention overrides by name. Raises ValueError for anything else."""
    names = arguments.get("override", [])
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise ValueError("override takes a list of names")
    return frozenset(names)


def wanted_direction(engine: "Engine", wish: Wish) -> tuple[float, float]:
    """Where a goto, a nudge or an aim beside the prediction wants the telescope, ICRS degrees.

    Raises ValueError when it names no direction, InstrumentError when the mount is silent.
    """
    if wish.verb == "goto":
        ra_deg = verdicts.number(wish.arguments, "ra_icrs_deg")
        dec_deg = verdicts.number(wish.arguments, "dec_icrs_deg")
        if not -90.0 <= dec_deg <= 90.0:
            raise ValueError(f"declination {dec_deg:g} is outside -90 to 90")
        return float(wrap_360(ra_deg)), dec_deg
    if wish.verb == "aim":
        return _beside(engine, wish.arguments)
    east = verdicts.number(wish.arguments, "east_arcmin")
    north = verdicts.number(wish.arguments, "north_arcmin")
    if math.hypot(east, north) > LARGEST_NUDGE_ARCMIN:
        raise ValueError(f"a nudge goes at most {LARGEST_NUDGE_ARCMIN:g} arcmin: use goto")
    ra_deg, dec_deg = _looks_at(engine)
    dec_after_deg = min(max(dec_deg + north / 60.0, -90.0), 90.0)
    cos_dec = max(math.cos(math.radians(dec_after_deg)), 1e-3)
    return float(wrap_360(ra_deg + east / 60.0 / cos_dec)), dec_after_deg


def _beside(engine: "Engine", arguments: Mapping[str, Any]) -> tuple[float, float]:
    """Beside what is followed, as it is at this moment."""
    track = engine.following.track
    if track is None:
        raise ValueError("nothing is followed: there is no prediction to look beside")
    given = {name: verdicts.number(arguments, name) for name in AIMS if name in arguments}
    config = engine.config
    for name, value in given.items():
        config = changed(config, f"aim.{name}", value)
    now_ns = engine.hands.now_utc_ns()
    by_orbit = engine.guide.of_track(now_ns, config.aim)
    return by_orbit or follow_direction(track, now_ns, config.filter, config.aim)


def preview_of_move(engine: "Engine", wish: Wish) -> dict[str, Any]:
    """What a goto or a nudge would do: target, way, time and limits; nothing moves."""
    direction = wanted_direction(engine, wish)
    now_ns = engine.hands.now_utc_ns()
    site = engine.config.site.to_site()
    here = _looks_at(engine)
    report = engine.hands.mount_report()
    alt_deg, az_deg = icrs_to_altaz(site, *direction, now_ns)
    ra_date_deg, dec_date_deg = icrs_to_jnow(*direction, now_ns)
    pose = Pose(
        t_utc_ns=now_ns, ra_icrs_deg=direction[0], dec_icrs_deg=direction[1], pier_side=None
    )
    margins = engine.watch.limits.margins_deg(pose)
    return {
        "ra_icrs_deg": direction[0],
        "dec_icrs_deg": direction[1],
        "ra_date_deg": ra_date_deg,
        "dec_date_deg": dec_date_deg,
        "alt_deg": alt_deg,
        "az_deg": az_deg,
        "way_deg": separation_deg(*here, *direction),
        "slew_s": engine.planner.slew_s(direction, now_ns),
        "pier_side": report.pier_side,
        "pier_side_after": engine.planner.side_at(direction, now_ns),
        "margins_deg": [[name, value] for name, value in margins if math.isfinite(value)],
        "refused": refuse_by_hand(engine, wish, direction),
    }


def refuse_by_hand(engine: "Engine", wish: Wish, direction: tuple[float, float]) -> str | None:
    """Why this move by hand cannot be: a parked mount, a limit; None when it can."""
    if engine.hands.mount_report().is_parked:
        return "the mount is parked: unpark it first"
    now_ns = engine.hands.now_utc_ns()
    exposure = engine.config.exposure
    until_ns = now_ns + round((exposure.cadence_s + exposure.exposure_s) * NS)
    lifted = frozenset(LIFTS[name] for name in overridden(wish.arguments) if name in LIFTS)
    return engine.slews.refusal(_command(engine, direction), now_ns, until_ns, lifted)


def _arm(engine: "Engine", wish: Wish) -> str:
    engine.arm(wish.by, overridden(wish.arguments))
    return DONE


def _hold(engine: "Engine", wish: Wish) -> str:
    return _pass(engine, Held(by=wish.by, until_clear=wish.arguments.get("until") == "clear"))


def _track(engine: "Engine", wish: Wish) -> str:
    """Sidereal tracking on or off, by the operator's hand."""
    if engine.charge.is_autonomous:
        raise ValueError("autonomy has the mount: disarm it first")
    if engine.hands.mount_report().is_parked:
        raise ValueError("the mount is parked: unpark it first")
    is_on = wish.arguments.get("on") is not False
    engine.hands.instruments.mount.set_tracking(is_on)
    return "the mount tracks" if is_on else "tracking is off: the mount stands"


def _pass(engine: "Engine", happening: Disarmed | Held | Resumed) -> str:
    engine.happen(happening)
    return DONE


def _goto(engine: "Engine", wish: Wish) -> str:
    direction = wanted_direction(engine, wish)
    refused = refuse_by_hand(engine, wish, direction)
    if refused is not None:
        raise ValueError(refused)
    if engine.hands.mount_report().is_slewing:
        # Some drivers take no new target while they move.
        engine.hands.instruments.mount.abort()
        engine.hands.wait_for_rest()
    command = _command(engine, direction)
    engine.hands.order_slew(*command)
    engine.happen(Taken(by=wish.by))
    engine.hand_move = HandMove(direction=direction, command=command)
    reason = f"{wish.verb} by {wish.by}"
    now_ns = engine.hands.now_utc_ns()
    engine.chronicle.append(slew_to(engine.frame_id, direction, now_ns, reason))
    return "on its way"


def _looks_at(engine: "Engine") -> tuple[float, float]:
    """Where the telescope looks; on its way by hand: where it will look, so that nudges add up."""
    if engine.hand_move is not None:
        return engine.hand_move.direction
    return engine.planner.looking_at(engine.hands.mount_report())


def _command(engine: "Engine", direction: tuple[float, float]) -> tuple[float, float]:
    now_ns = engine.hands.now_utc_ns()
    return engine.planner.command(slew_to(engine.frame_id, direction, now_ns, "by hand"))


def _park(engine: "Engine", wish: Wish) -> str:
    engine.park(wish.by)
    return "parking"


def _unpark(engine: "Engine", _wish: Wish) -> str:
    engine.hands.instruments.mount.unpark()
    return DONE


def _rule(engine: "Engine", wish: Wish) -> str:
    return verdicts.rule(engine, wish.verb, wish.arguments, wish.by)


def _set(engine: "Engine", wish: Wish) -> str:
    name, value = str(wish.arguments.get("name", "")), wish.arguments.get("value", "")
    after = changed(engine.config, name, value)
    frames = wish.arguments.get("frames")
    if frames is None:
        engine.temporary.keep(name)
    else:
        engine.temporary.lend(engine.config, name, frames)
    engine.chronicle.append(change_record(engine.config, after, name, wish.by))
    engine.configure(after)
    return DONE
