"""The loop's pointing against the simulated mount with all its errors: true place against frame.

The observatory runs as a process and speaks INDI; polar axis, cone, flexure, the jump at the flip
and 15 arcsec drawn again for every slew are in it. Frames are drawn without a sky: the reducer of
this test is told by the observatory's truth where the telescope really looked, as a plate
solution would tell it.
"""

import dataclasses
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.config import Config
from rsoconsole.engine import Engine
from rsoconsole.engine.aim.instrument_controller import InstrumentController
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.instruments import connect_instruments
from rsoconsole.pipeline import Reduction
from rsoconsole.records import Detections, Event, Frame, Measurement, Miss, SlewCommand
from rsoconsole.simulator import start_observatory
from rsoconsole.sky import hour_angle_icrs_deg, separation_deg, wrap_360
from rsoconsole.words import text
from tests.rigs.engine_rig import Memory, solution_at
from tests.rigs.stub_stage import SITE, T_START_UTC_NS

NS = 1_000_000_000
TWO_ARCMIN = 2.0
SIDEREAL_DEG_S = 360.98564736629 / 86_400.0
OPTICS = {"width_px": 256, "height_px": 192, "pixel_um": 70.0}
"""The stub's small frames with the paper's field of view."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Mover:
    """Something that moves at constant rates."""

    ra_icrs_deg: float
    """At the night's start."""
    ra_rate_deg_s: float
    dec_icrs_deg: float = -5.0

    def at(self, t_utc_ns: float) -> tuple[float, float]:
        since_s = (t_utc_ns - T_START_UTC_NS) / NS
        return wrap_360(self.ra_icrs_deg + self.ra_rate_deg_s * since_s), self.dec_icrs_deg


class TruthReducer:
    """Solves every frame by what the observatory knows; measures what lies in the field."""

    def __init__(self, truth_path: Path, mover: Mover | None) -> None:
        self.truth_path, self.mover = truth_path, mover
        self.looked: list[tuple[int, tuple[float, float]]] = []
        """(middle of the exposure, true centre of the frame) of every frame."""

    def configure(self, config: Config) -> None:
        pass

    def forget_plate(self) -> None:
        pass

    def reduce(self, frame: Frame) -> Reduction:
        truth = json.loads(self.truth_path.read_text().splitlines()[-1])
        assert truth["t_start_utc_ns"] == frame.t_start_utc_ns
        assert frame.t_mid_utc_ns is not None
        centre = (truth["ra_icrs_deg"], truth["dec_icrs_deg"])
        self.looked.append((frame.t_mid_utc_ns, centre))
        return Reduction(
            detections=Detections(
                frame_id=frame.frame_id, width_px=256, height_px=192, detections=()
            ),
            solution=dataclasses.replace(solution_at(*centre), frame_id=frame.frame_id),
            measurements=self._measured(frame, centre),
            star_count=100,
            fwhm_px=2.5,
            absence="no detection",
        )

    def _measured(self, frame: Frame, centre: tuple[float, float]) -> tuple[Measurement, ...]:
        if self.mover is None or frame.t_mid_utc_ns is None or frame.exposure_s is None:
            return ()
        ra_deg, dec_deg = self.mover.at(frame.t_mid_utc_ns)
        if separation_deg(ra_deg, dec_deg, *centre) > 0.6:
            return ()
        half_ns = frame.exposure_s * NS / 2.0
        ends = [self.mover.at(frame.t_mid_utc_ns + sign * half_ns) for sign in (-1, 1)]
        return (
            Measurement(
                measurement_id=f"{frame.frame_id}-0",
                frame_id=frame.frame_id,
                t_mid_utc_ns=frame.t_mid_utc_ns,
                ra_icrs_deg=ra_deg,
                dec_icrs_deg=dec_deg,
                cov_sky_arcsec2=(1.0, 0.0, 1.0),
                x_px=128.0,
                y_px=96.0,
                confidence=0.9,
                source="network",
                ends_icrs_deg=(ends[0], ends[1]),
            ),
        )


@dataclasses.dataclass
class Night:
    engine: Engine
    memory: Memory
    reducer: TruthReducer

    def aims(self) -> list[SlewCommand]:
        return self.memory.of(SlewCommand)

    def off_arcmin(self, mover: Mover) -> list[float]:
        """How far the mover stood from the centre of every frame."""
        return [
            separation_deg(*mover.at(t_mid_ns), *centre) * 60.0
            for t_mid_ns, centre in self.reducer.looked
        ]

    def hour_angles_deg(self, mover: Mover) -> list[float]:
        """Where the mover stood at the middle of every frame."""
        return [
            float(hour_angle_icrs_deg(SITE, *mover.at(t_mid_ns), t_mid_ns))
            for t_mid_ns, _ in self.reducer.looked
        ]

    def beside_arcmin(self) -> list[float]:
        """How far every frame that was slewed for looks beside what the slew wanted."""
        found = []
        for t_mid_ns, centre in self.reducer.looked:
            before = [aim for aim in self.aims() if abs(aim.t_aim_utc_ns - t_mid_ns) < 5 * NS]
            if before:
                wanted = (before[-1].ra_icrs_deg, before[-1].dec_icrs_deg)
                found.append(separation_deg(*wanted, *centre) * 60.0)
        return found


@contextmanager
def night(
    folder: Path, seed: int, mover: Mover | None, settings: dict[str, Any]
) -> Iterator[Night]:
    """An engine against the observatory, armed."""
    truth_path = folder / f"truth{seed}.jsonl"
    with start_observatory(
        "plain", seed, math.inf, truth_path, stage="tests.rigs.stub_stage:open_plain"
    ) as observatory:
        indi = {"port": observatory.port, "simulated": True}
        config = Config.model_validate({"indi": indi, "optics": OPTICS} | settings)
        with connect_instruments(config, log_dir=folder) as instruments:
            queue, memory = CommandQueue(), Memory()
            reducer = TruthReducer(truth_path, mover)
            engine = Engine(
                config=config,
                instrument_controller=InstrumentController(
                    instruments, config, lambda: queue.is_interrupt_wanted
                ),
                reducer=reducer,  # type: ignore[arg-type]
                record=memory,
                queue=queue,
            )
            engine.arm()
            yield Night(engine, memory, reducer)


TARGETS = [
    {"name": "east of the meridian", "hour_angle_deg": -18.0},
    {"name": "west of the meridian", "hour_angle_deg": 20.0},
    {"name": "under the pole", "hour_angle_deg": 170.0},
    {"name": "far west", "hour_angle_deg": 45.0},
]
LIST = {
    "search": {"pattern": "targets", "targets": TARGETS, "frames_per_field": 3},
    # Early in a June night the way over the pole would pass too near to the Sun below it.
    "limits": {"sun_cone_deg": 15.0},
}


@pytest.mark.nightly("starts the observatory once more")
def test_every_place_of_a_list_is_met_on_both_sides_of_the_meridian(tmp_path):
    """The first look teaches the first place, one frame each other one; a return needs none."""
    with night(tmp_path, 3, None, LIST) as it:
        it.engine.run(frames=1 + 18)
        reasons = [aim.reason.removeprefix("search: ") for aim in it.aims()]
        one_round = ["east of the meridian", "west of the meridian", "far west"]
        assert reasons[:18:3] == one_round * 2
        beside = it.beside_arcmin()
        first_frames_of_new_places = {3, 6}
        assert len(beside) == 18
        for number, arcmin in enumerate(beside):
            assert (arcmin < TWO_ARCMIN) is (number not in first_frames_of_new_places)
        refusals = [event.text for event in it.memory.of(Event) if "refused" in event.text]
        assert len(refusals) == 1
        assert "altitude" in refusals[0]


CROSSING = Mover(ra_icrs_deg=240.45, ra_rate_deg_s=SIDEREAL_DEG_S - 100.0 / 3600.0)
"""It passes the field of the first look and goes west by 0.83 deg of hour angle a frame."""
STANDING = Mover(ra_icrs_deg=240.2, ra_rate_deg_s=SIDEREAL_DEG_S)


@pytest.mark.nightly("a whole night")
def test_a_satellite_is_met_and_met_again_after_the_flip(tmp_path):
    """It passes the meridian while it is followed: one frame after that is enough."""
    search = {"pattern": "stay", "recentre": "every"}
    with night(tmp_path, 1, CROSSING, {"search": search}) as it:
        it.engine.run(frames=28)
        sides = [frame < 0.0 for frame in it.hour_angles_deg(CROSSING)]
        flipped = sides.index(False)
        assert 15 < flipped < 24
        off = it.off_arcmin(CROSSING)
        assert max(off[2:flipped]) < TWO_ARCMIN
        assert off[flipped + 1] > TWO_ARCMIN or off[flipped] > TWO_ARCMIN
        assert max(off[flipped + 2 :]) < TWO_ARCMIN
        assert it.engine.following.state == "TRACK"
        assert not it.memory.of(Miss)


@pytest.mark.nightly("starts the observatory once more")
def test_a_satellite_that_need_not_be_recentred_drifts_in_the_middle_of_the_field(tmp_path):
    """Where the mount was sent for it, it stands in the centre; elsewhere not far from there."""
    search = {"pattern": "stay", "recentre": "when needed"}
    with night(tmp_path, 2, STANDING, {"search": search}) as it:
        it.engine.run(frames=12)
        off = it.off_arcmin(STANDING)
        met = [aim for aim in it.aims() if aim.reason in {"filter", "orbit"}]
        assert 2 <= len(met) <= 5
        centred = [arcmin for arcmin in off[2:] if arcmin < TWO_ARCMIN]
        assert len(centred) == len(met)
        a_quarter_of_the_height = 0.25 * 1.24 * 60.0
        assert max(off[2:]) < a_quarter_of_the_height


@pytest.mark.nightly("starts the observatory once more")
def test_a_mount_that_must_not_flip_is_left_on_its_side_and_the_misses_say_why(tmp_path):
    """mount.meridian = hold: the track is let go rather than the pier changed."""
    settings = {
        "search": {"pattern": "stay", "recentre": "every"},
        "mount": {"meridian": "hold"},
    }
    with night(tmp_path, 1, CROSSING, settings) as it:
        it.engine.run(frames=25)
        refusals = [event.text for event in it.memory.of(Event) if "refused" in event.text]
        assert len(refusals) == 1
        assert "mount.meridian is hold" in refusals[0]
        assert it.engine.instrument_controller.mount_report().pier_side == "west"
        assert it.engine.following.state == "COAST"
        reasons = [text(miss.reason) for miss in it.memory.of(Miss)]
        assert len(reasons) == 2
        assert all(reason.startswith("slew refused: hour angle") for reason in reasons)
