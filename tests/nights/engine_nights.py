"""Nights of an engine among instruments that live in the test, with whatever may happen in one.

``busy``: all that may come between two frames, in a night of 60. ``ruled``: the operator marks,
accepts, rejects and chooses streaks, and looks for what was followed again.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.aim.states import LimitMet
from rsoconsole.pipeline import Reduction
from rsoconsole.records import BelowTau, Frame, Rejection, measurement_id_of
from rsoconsole.session import SessionWriter, decode, encode
from rsoconsole.tracking import Following
from tests.makers import straight_detection
from tests.rigs.engine_rig import Rig, ScriptedReducer, asked, command_handler_of, rig, told

CONFIG = Config.model_validate(
    {"search": {"recentre": "every"}, "filter": {"preset": "tuned", "max_coast_s": 3600}}
)
"""With it every frame orders a slew."""
AN_ARCSEC = 1.0 / 3600.0
CLOUDS = {9, 10}
FAR_OFF_ARCSEC = 120.0


@dataclasses.dataclass
class Night:
    """What was recorded, and what the engine followed after each cycle."""

    log: list[tuple[int, Any]]
    """(t_utc_ns, record)."""
    followed: dict[int, Following]

    @property
    def records(self) -> list[Any]:
        return [record for _, record in self.log]

    def of(self, kind: type[Any]) -> list[Any]:
        return [record for record in self.records if isinstance(record, kind)]

    def written(self, folder: Path, config: Config = CONFIG) -> Path:
        """As a closed session."""
        writer = SessionWriter.create(folder, config, {"title": folder.name})
        for t_utc_ns, record in self.log:
            writer.append(record, t_utc_ns)
        writer.close()
        assert writer.faults == ()
        return folder


class BusyReducer(ScriptedReducer):
    """Counts stars, sees a neighbour beside the satellite, and breaks where it is told to."""

    breaks: frozenset[int] = frozenset()

    def reduce(self, frame: Frame) -> Reduction:
        if frame.frame_id in self.breaks:
            raise InstrumentError("the reduction broke")
        plain = super().reduce(frame)
        measured = plain.measurements
        beside = tuple(
            dataclasses.replace(
                m,
                measurement_id=measurement_id_of(m.frame_id, 1),
                ra_icrs_deg=m.ra_icrs_deg + 90.0 * AN_ARCSEC,
                confidence=0.7,
                cov_sky_arcsec2=(0.09, 0.01, 0.05),
                ends_icrs_deg=tuple((ra + 90.0 * AN_ARCSEC, dec) for ra, dec in m.ends_icrs_deg),
            )
            for m in measured
        )
        # A little off its place in every frame: the innovations are not nothing.
        shaken = tuple(
            dataclasses.replace(m, dec_icrs_deg=m.dec_icrs_deg + frame.frame_id % 3 * AN_ARCSEC / 3)
            for m in measured
        )
        is_cloudy = frame.frame_id in CLOUDS
        detections = dataclasses.replace(
            plain.detections,
            detections=tuple(
                straight_detection(frame_id=frame.frame_id) for _ in (*shaken, *beside)
            ),
            star_count=12 if is_cloudy else 200 + frame.frame_id,
            star_flux_adu=1000.0 + frame.frame_id / 7.0,
        )
        return dataclasses.replace(plain, detections=detections, measurements=(*shaken, *beside))


class Misleading(ScriptedReducer):
    """In some frames the only measurement is a stranger, well beside the satellite."""

    misled: frozenset[int] = frozenset()

    def reduce(self, frame: Frame) -> Reduction:
        plain = super().reduce(frame)
        found = tuple(straight_detection(frame_id=frame.frame_id) for _ in plain.measurements)
        below = Rejection(
            detection=straight_detection(
                frame_id=frame.frame_id, x_px=2.0, y_px=1.0, length_px=20.0, confidence=0.05
            ),
            reason=BelowTau(confidence=0.05, tau=0.1),
        )
        detections = dataclasses.replace(plain.detections, detections=found, rejected=(below,))
        measured = plain.measurements
        if frame.frame_id in self.misled:
            measured = tuple(
                dataclasses.replace(m, dec_icrs_deg=m.dec_icrs_deg + FAR_OFF_ARCSEC / 3600.0)
                for m in measured
            )
        return dataclasses.replace(plain, detections=detections, measurements=measured)


def _rig(
    frames: set[int], config: Config, reducer: type[ScriptedReducer]
) -> tuple[Rig, dict[int, Following]]:
    r = rig(frames, config)
    r.reducer.__class__ = reducer
    followed: dict[int, Following] = {}
    r.engine.frames._on_cycle = lambda _: followed.__setitem__(
        r.engine.frame_id, r.engine.following
    )
    return r, followed


def _night(r: Rig, followed: dict[int, Following]) -> Night:
    """As a session would give it back."""
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    return Night(list(zip(r.memory.t_utc_ns, records, strict=True)), followed)


def _at_frame(r: Rig, frame_id: int, act: Callable[[], object]) -> None:
    """Do something while the camera reads out this frame."""
    wait = r.camera.wait_frame

    def acting(timeout_s: float) -> Frame:
        frame = wait(timeout_s)
        if frame.frame_id == frame_id:
            act()
        return frame

    r.camera.wait_frame = acting  # type: ignore[method-assign]


def _refuse_one_slew(r: Rig) -> None:
    slew = r.mount.slew

    def fail_once(*_: float) -> None:
        r.mount.slew = slew  # type: ignore[method-assign]
        raise InstrumentError("the mount did not take the order")

    r.mount.slew = fail_once  # type: ignore[method-assign]


def busy(config: Config = CONFIG) -> Night:
    """Everything that may come between two frames, in one night of 60."""
    r, followed = _rig(set(range(1, 61)) - {7, *CLOUDS, *range(48, 54)}, config, BusyReducer)
    command_handler, engine = command_handler_of(r), r.engine
    r.reducer.breaks = frozenset({13})
    _at_frame(r, 15, lambda: command_handler.handle(asked("hold")))
    engine.arm()
    engine.run(frames=11)  # lock, a miss, two frames of cloud
    r.camera.broken_for = 1
    engine.run(frames=16)  # a lost frame, one whose reduction breaks, one cut short by 'hold'
    command_handler.handle(asked("resume"))
    r.queue.put(asked("set", arguments={"name": "filter.r_multiplier", "value": 3.0}))
    r.queue.put(asked("set", arguments={"name": "detector.tau", "value": 0.2}))
    engine.run(frames=20)
    _refuse_one_slew(r)
    engine.run(frames=22)
    away = {"ra_icrs_deg": r.mount.at_deg[0] + 5.0, "dec_icrs_deg": r.mount.at_deg[1]}
    command_handler.handle(asked("goto", arguments=away))
    engine.run(frames=24)
    command_handler.handle(asked("nudge", arguments={"east_arcmin": 10.0, "north_arcmin": 0.0}))
    engine.run(frames=26)
    command_handler.handle(asked("resume"))
    engine.run(frames=30)
    r.queue.interrupt(LimitMet(words="altitude 14.9 deg, 15 at least"))
    engine.run(frames=35)
    command_handler.handle(asked("stop"))
    r.queue.put(asked("arm"))
    r.queue.put(asked("set", arguments={"name": "search.follow", "value": "nearest"}))
    engine.run(frames=40)
    r.camera.broken_for = 3
    with pytest.raises(InstrumentError, match="FAULT"):
        engine.run(frames=45)
    r.queue.put(asked("arm"))
    r.queue.put(asked("set", arguments={"name": "filter.max_coast_s", "value": 80.0}))
    engine.run(frames=60)  # and lost, and found
    return _night(r, followed)


def ruled(config: Config = CONFIG) -> Night:
    """The operator's word on frames, again and again, in a night of 24."""
    r, followed = _rig(set(range(1, 25)) - {9, 17}, config, Misleading)
    r.reducer.misled = frozenset({12})
    r.engine.arm()

    def say(verb: str, **arguments: Any) -> None:
        outcome = told(command_handler_of(r), verb, arguments)
        assert outcome.ok, outcome
        r.engine.commands.execute_waiting()

    r.engine.run(frames=9)
    say("mark", x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0)
    r.engine.run(frames=11)
    say("reject")
    r.engine.run(frames=12)
    say("accept")
    r.engine.run(frames=15)
    say("choose", x=2.0, y=1.0)
    say("reject")
    r.engine.run(frames=17)
    say("mark", x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0)
    r.engine.run(frames=19)
    command_handler_of(r).handle(asked("stop"))
    r.queue.put(asked("arm"))
    r.engine.run(frames=21)
    say("seek")
    r.engine.run(frames=24)
    return _night(r, followed)
