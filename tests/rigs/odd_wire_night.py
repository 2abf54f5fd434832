"""A random night of one odd mount over the wire, with a whole engine's ways to it, in real time."""

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rsoconsole.base import RsoconsoleError
from rsoconsole.instruments import SIDEREAL_ARCSEC_S
from tests.rigs.odd_engine import OddEngine, odd_engine
from tests.rigs.odd_mount import ABORT
from tests.rigs.odd_sequence import (
    disobeys,
    drawn_oddities,
    known_within_s,
    park_room_deg,
    shown_arcsec_s,
    unseen_way_deg,
    way_to_stop_deg,
)

LOOK_S = 0.1
LATE_S = 0.6
"""For the threads of a loaded machine, beside what the mount's reports need."""
ABORT_S = 0.2


@dataclass
class WireNight:
    """What was found wrong; empty: nothing."""

    faults: list[str] = field(default_factory=list)
    stops_s: list[float] = field(default_factory=list)
    """How long each STOP's first ABORT took."""
    rests: int = 0
    lowest_deg: float = 90.0


def run_wire_night(seed: int, folder: Path, acts: int = 10) -> WireNight:
    """Orders, foreign hands and faults of the driver, judged by the mount's own motion."""
    draw = random.Random(seed)
    oddities = drawn_oddities(draw)
    found, is_over = WireNight(), threading.Event()
    is_held_up: list[float] = []
    with odd_engine(oddities, folder) as seat:
        judge = threading.Thread(
            target=_judge, args=(seat, found, is_over, is_held_up), daemon=True
        )
        judge.start()
        for _ in range(acts):
            _act(seat, draw, found, is_held_up)
            time.sleep(draw.choice((0.2, 1.0, 3.0, 6.0)))
        seat.server.thaw()
        time.sleep(5.0)
        is_over.set()
        judge.join()
        room_deg = park_room_deg(seat.server.model)
    if not (disobeys(oddities) or is_held_up):
        way_deg = way_to_stop_deg(oddities) + room_deg
        if found.lowest_deg < -way_deg - 0.1:
            found.faults.append(f"{-found.lowest_deg:.1f} deg below the horizon")
    return found


def _act(seat: OddEngine, draw: random.Random, found: WireNight, is_held_up: list[float]) -> None:
    def goto() -> None:
        seat.goto(draw.uniform(25.0, 75.0), draw.uniform(0.0, 360.0))

    def stop_while_it_waits() -> None:
        waits = threading.Thread(target=goto, daemon=True)
        waits.start()
        time.sleep(draw.uniform(0.0, 1.0))
        stop()
        waits.join()

    def stop() -> None:
        begun_s = time.monotonic()
        model = seat.server.model
        hears = not model.deaf and model.is_driver_there
        seat.ask("stop")
        if model.oddities.noabort or model.deaf or not (hears and model.is_driver_there):
            return
        # It is answered by words that were on their way, too: this ABORT may still be.
        ends_s = begun_s + 2.0 * ABORT_S
        while not (sent := [at_s for at_s, _ in seat.received(ABORT) if at_s >= begun_s]):
            if time.monotonic() > ends_s:
                break
            time.sleep(0.01)
        found.stops_s.append(sent[0] - begun_s if sent else float("inf"))

    def freeze() -> None:
        is_held_up.append(time.monotonic())
        seat.server.freeze()
        thaw = threading.Timer(draw.uniform(1.0, 8.0), seat.server.thaw)
        thaw.daemon = True
        thaw.start()

    def kill() -> None:
        is_held_up.append(time.monotonic())
        seat.server.kill_driver(restart_s=draw.uniform(0.2, 2.0))

    acts: list[tuple[float, Callable[[], object]]] = [
        (4.0, goto),
        (2.0, stop),
        (2.0, stop_while_it_waits),
        (1.0, lambda: seat.ask("park")),
        (1.0, lambda: seat.ask("unpark")),
        (1.0, lambda: seat.ask("track", is_on=draw.random() < 0.5)),
        (1.0, lambda: seat.foreign(draw.uniform(25.0, 75.0), draw.uniform(0.0, 360.0))),
        (1.0, lambda: seat.foreign(draw.uniform(-60.0, -10.0), draw.uniform(0.0, 360.0))),
        (0.7, freeze),
        (0.7, kill),
    ]
    weights, choices = zip(*acts, strict=True)
    draw.choices(choices, weights)[0]()


def _judge(
    seat: OddEngine, found: WireNight, is_over: threading.Event, is_held_up: list[float]
) -> None:
    odd = seat.server.model.oddities
    rested_s = looked_s = time.monotonic()
    rest_altitude_deg = 90.0
    while not is_over.wait(LOOK_S):
        now_s = time.monotonic()
        if now_s - looked_s > LATE_S / 2.0:
            rested_s = now_s  # this judge was held up
        looked_s = now_s
        with seat.server.locked() as model:
            ra, dec = model.ra_rate_arcsec_s, model.dec_rate_arcsec_s
            altitude_deg = model.altitude_deg
        unseen_deg = max(0.0, unseen_way_deg(odd) - max(rest_altitude_deg, 0.0))
        found.lowest_deg = min(found.lowest_deg, altitude_deg + unseen_deg)
        if max(min(abs(ra), abs(ra - SIDEREAL_ARCSEC_S)), abs(dec)) <= shown_arcsec_s(odd):
            rested_s, rest_altitude_deg = time.monotonic(), altitude_deg
        try:
            motion = seat.mount.report(timeout_s=1.0).motion
        except RsoconsoleError:
            continue
        if motion.is_at_rest:
            found.rests += 1
            moved_s = now_s - rested_s
            if moved_s > known_within_s(odd) + LATE_S:
                found.faults.append(f"it {motion.kind}, is said; it moves since {moved_s:.1f} s")
