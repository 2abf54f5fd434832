"""Streaks below tau that frames together make sure: locks, false locks, and a record of them.

A candidate's statistic follows the normal law about eight tenths of a satellite's SNR (the detector
loses the rest), and for chance the tail of the extremes of noise: 200 a frame above 5.3. Its
confidence is the probability by both, for satellites of SNR 6 to 30 in every second frame.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest

import rsoconsole as rso
from rsoconsole.cli.words.frame_words import process_words
from rsoconsole.config import Config
from rsoconsole.library._given import records_table
from rsoconsole.library._observations import META
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.measurement import SIGMAS
from rsoconsole.night import frames_of
from rsoconsole.pipeline import replay
from rsoconsole.records import (
    BelowTau,
    Detections,
    FrameTaken,
    Measurement,
    Record,
    Rejection,
    StateChange,
    TrackState,
)
from rsoconsole.session import SessionWriter, encode
from rsoconsole.sky import tan_wcs
from rsoconsole.tracking import Field, Following, FrameInput, follow
from rsoconsole.words import text
from tests.makers import NS, T0_UTC_NS, geo_measurement, straight_detection
from tests.rigs.engine_rig import solution_at
from tests.tracking.test_follow import SETTINGS

TAU, SCALE, WIDTH_PX, HEIGHT_PX = 0.1, 1.25, 4000, 3572
CADENCE_S, EXPOSURE_S, RATE_ARCSEC_S = 30.0, 10.0, 15.041
KEPT_LIGHT, CHANCE, ABOVE = 0.8, 200.0, 5.3
OWN = 900
"""Number of the satellite's candidate in each frame."""
KINDS = ("", "columns", "glow", "ghosts")


def confidence(statistic: float) -> float:
    real = 0.5 / (statistic * math.log(5.0))
    odds = real / (statistic * CHANCE * math.exp(-0.5 * (statistic**2 - ABOVE**2)))
    return odds / (1.0 + odds)


class Search:
    """Frames of a search at one hour angle; the mount comes back to it but for its error.

    ``many``: mean number of candidates by chance; ``frames_between``: from one return of the mount
    to the next, it goes with the stars meanwhile.
    """

    def __init__(
        self, seed: int, *, many: float = 30.0, error_arcsec: float = 20.0, frames_between: int = 1
    ) -> None:
        self.seed, self.many, self.rng = seed, many, np.random.default_rng(seed)
        self.least = math.sqrt(ABOVE**2 + 2.0 * math.log(CHANCE / many))
        away = self.rng.normal(0.0, error_arcsec, (60, 2))
        returns = np.arange(60) // frames_between
        self.pointing = away[returns]
        self.pointing[:, 0] += RATE_ARCSEC_S * CADENCE_S * returns * frames_between

    def measured(
        self, n: int, number: int, place: Sequence[float], streak: Sequence[float], statistic: float
    ) -> Measurement:
        """A candidate at a place (east, north), with a streak (direction deg, length arcsec)."""
        (east, north), (angle_deg, length) = place, streak
        turn = math.radians(angle_deg)
        along, across = np.array([math.sin(turn), math.cos(turn)]), None
        across = np.array([along[1], -along[0]])
        cov = 16.0 * np.outer(along, along) + np.outer(across, across)
        x, y = (np.array(place) - self.pointing[n - 1]) / SCALE
        sure, half = confidence(statistic), 0.5 * length * along / 3600.0
        return Measurement(
            measurement_id=f"{n}-{number}",
            frame_id=n,
            t_mid_utc_ns=T0_UTC_NS + round((n - 1) * CADENCE_S * NS),
            ra_icrs_deg=150.0 + east / 3600.0,
            dec_icrs_deg=north / 3600.0,
            cov_sky_arcsec2=(cov[0, 0], cov[0, 1], cov[1, 1]),
            x_px=-x,
            y_px=y,
            confidence=sure,
            source="network" if sure > TAU else "faint",
            ends_icrs_deg=(
                (150.0 + east / 3600.0 - half[0], north / 3600.0 - half[1]),
                (150.0 + east / 3600.0 + half[0], north / 3600.0 + half[1]),
            ),
        )

    def chance(self, n: int) -> list[Measurement]:
        """Candidates anywhere, mostly short, of any direction."""
        rng, found = self.rng, []
        for number in range(rng.poisson(self.many)):
            statistic = math.sqrt(self.least**2 - 2.0 * math.log(rng.uniform()))
            place = rng.uniform(-0.5, 0.5, 2) * (WIDTH_PX * SCALE, HEIGHT_PX * SCALE)
            streak = rng.uniform(0.0, 180.0), 25.0 * math.exp(min(rng.exponential(0.8), 3.0))
            found.append(self.measured(n, number, place + self.pointing[n - 1], streak, statistic))
        return found

    def satellite(self, n: int, snr: float) -> list[Measurement]:
        """A geostationary satellite's streak, where the detector has it among its candidates."""
        statistic = self.rng.normal(KEPT_LIGHT * snr, 1.0)
        off = self.rng.standard_t(4, 4) / math.sqrt(2.0)
        if statistic < self.least:
            return []
        way = RATE_ARCSEC_S * CADENCE_S * (n - 1)
        place = (way * math.cos(0.05) - 300.0 + 4.0 * off[0], way * math.sin(0.05) + off[1])
        streak = (87.0 + 1.2 * off[2], RATE_ARCSEC_S * EXPOSURE_S * (1.0 + 0.1 * off[3]))
        return [self.measured(n, OWN, place, streak, statistic)]

    def fixed(self, n: int, kind: str) -> list[Measurement]:
        """Light fixed to the sensor: pieces of bad columns, edges of glow, ghosts."""
        rng, found = np.random.default_rng([self.seed, 7]), []
        places = rng.uniform(-0.45, 0.45, (12, 2)) * (WIDTH_PX * SCALE, HEIGHT_PX * SCALE)
        angles = {"columns": np.zeros(12), "glow": np.full(12, 87.0)}
        turns_deg = angles.get(kind, rng.uniform(0.0, 180.0, 12))
        for number, (place, turn_deg) in enumerate(zip(places, turns_deg, strict=True)):
            along = 4.0 * self.rng.normal() if kind != "columns" else self.rng.uniform(-600, 600)
            turn = math.radians(turn_deg)
            there = place + along * np.array([math.sin(turn), math.cos(turn)])
            streak = turn_deg + self.rng.normal(), self.rng.normal(150.0, 12.0)
            if self.rng.uniform() < 0.6:
                there = there + self.pointing[n - 1] + self.rng.normal(0.0, 1.0, 2)
                shown = self.measured(n, 500 + number, there, streak, self.rng.uniform(5.7, 6.6))
                found.append(shown)
        return found

    def seen(self, n: int, shown: Sequence[Measurement]) -> FrameInput:
        ra, dec = self.pointing[n - 1] / 3600.0
        wcs = tan_wcs(
            150.0 + ra,
            dec,
            scale_arcsec_px=SCALE,
            rotation_deg=0.0,
            is_flipped=False,
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
        )
        return FrameInput(
            frame_id=n,
            t_mid_utc_ns=T0_UTC_NS + round((n - 1) * CADENCE_S * NS),
            exposure_s=EXPOSURE_S,
            measurements=tuple(m for m in shown if m.source != "faint"),
            faint=tuple(m for m in shown if m.source == "faint"),
            field=Field(wcs=wcs, width_px=WIDTH_PX, height_px=HEIGHT_PX),
        )

    def begun(self, frames: int, snr: float | None = None, kind: str = "") -> TrackState | None:
        """First track that some frames begin; None: they begin none."""
        following = Following()
        for n in range(1, frames + 1):
            shown = self.chance(n)
            shown += [] if snr is None else self.satellite(n, snr)
            shown += self.fixed(n, kind) if kind else []
            following, records = follow(following, self.seen(n, shown), SETTINGS)
            for each in records:
                if isinstance(each, TrackState):
                    return each
        return None


def is_right(begun: TrackState | None) -> bool:
    """True for a track whose streaks are all the satellite's."""
    if begun is None or begun.begun_with is None:
        return False
    return all(m.endswith(f"-{OWN}") for m in (*begun.begun_with, *begun.begun_through))


@pytest.mark.parametrize("many", [10.0, 40.0])
@pytest.mark.parametrize(("snrs", "share"), [((8.0, 12.0), 0.95), ((6.5, 8.0), 0.6)])
def test_a_faint_satellite_is_locked_within_eight_frames(many, snrs, share):
    """Three frames in four nights, where candidates are many; fewer where only ten are kept."""
    nights = [
        Search(seed, many=many, frames_between=3).begun(8, float(snr))
        for seed, snr in enumerate(np.linspace(*snrs, 16))
    ]
    assert sum(map(is_right, nights)) >= share * len(nights)
    assert not any(each is not None and not is_right(each) for each in nights)


@pytest.mark.parametrize("kind", KINDS)
def test_frames_without_a_satellite_begin_no_track(kind):
    """Whether the mount comes back exactly, about, or every third frame alone."""
    mounts = ((0.0, 1), (20.0, 1), (20.0, 3))
    nights = [
        Search(100 + n, error_arcsec=error, frames_between=frames)
        for n, (error, frames) in enumerate(mounts)
    ]
    assert [night.begun(40, kind=kind) for night in nights] == [None] * len(nights)


def test_what_stays_on_the_sensor_begins_none_though_it_moves_as_the_belt_does():
    """A satellite of the belt does the same where the mount errs less than a streak's place."""

    def night(error_arcsec: float) -> TrackState | None:
        search, following = Search(5, many=1e-9, error_arcsec=error_arcsec), Following()
        for n in range(1, 7):
            place = (RATE_ARCSEC_S * CADENCE_S * (n - 1), 100.0)
            shown = search.measured(n, OWN, place, (90.0, 150.0), 6.3)
            following, records = follow(following, search.seen(n, [shown]), SETTINGS)
            for each in records:
                if isinstance(each, TrackState):
                    return each
        return None

    assert night(0.5) is None
    assert is_right(night(60.0))


def test_two_faint_ones_wait_for_another_frame_and_three_begin():
    search, following, states = Search(5, many=1e-9), Following(), []
    for n in range(1, 4):
        place = (RATE_ARCSEC_S * CADENCE_S * (n - 1), 100.0)
        shown = search.measured(n, OWN, place, (90.0, 150.0), 6.6)
        following, records = follow(following, search.seen(n, [shown]), SETTINGS)
        states += [r for r in records if isinstance(r, StateChange)]
    assert [each.after for each in states] == ["ACQUIRE", "TRACK"]
    assert text(states[0].reason).startswith("faint: 2 frames together .")
    assert text(states[1].reason) == "faint: 3 frames together .99"


def test_two_that_no_later_frame_follows_are_forgotten():
    search, following, records = Search(5, many=1e-9), Following(), list[Record]()
    for n in range(1, 31):
        place = (RATE_ARCSEC_S * CADENCE_S * (n - 1), 100.0)
        shown = [search.measured(n, OWN, place, (90.0, 150.0), 6.6)] if n in {1, 2, 30} else []
        following, made = follow(following, search.seen(n, shown), SETTINGS)
        records += made
        assert following.state == ("ACQUIRE" if n == 2 else "SEARCH")
    assert not any(isinstance(each, TrackState) for each in records)


def test_two_faint_ones_beside_a_track_begin_none():
    """They lie in its gate, and nothing above tau does."""
    search, following, begun = Search(5, many=1e-9), Following(), set[int]()
    for n in range(1, 7):
        place = (RATE_ARCSEC_S * CADENCE_S * (n - 1), 100.0)
        shown = [search.measured(n, OWN, place, (90.0, 150.0), 9.0 if n < 5 else 6.3)]
        beside = search.measured(n, OWN + 1, (place[0] + 4.0, 102.0), (90.0, 150.0), 6.2)
        following, records = follow(
            following, search.seen(n, [*shown, beside] if n > 4 else shown), SETTINGS
        )
        begun |= {each.track_id for each in records if isinstance(each, TrackState)}
    assert begun == {1}
    assert following.state == "TRACK"


CONFIG = Config()


def record_of(frame_id: int) -> list[Record]:
    """A frame in which a satellite of the belt lies below tau, among others."""
    x_px = 300.0 + 358.1 * (frame_id - 1)
    faint = {"frame_id": frame_id, "snr": 8.0, "sigma_along_px": 4.0, "confidence": 0.02}
    shown = (
        straight_detection(**(faint | {"x_px": 1700.0 * (frame_id % 3), "angle_deg": 40.0})),
        straight_detection(x_px=x_px, length_px=119.4, **faint),
    )
    rejected = (Rejection(detection=d, reason=BelowTau(confidence=0.02, tau=0.1)) for d in shown)
    return [
        FrameTaken(
            frame_id=frame_id,
            name=f"frame {frame_id}",
            t_start_utc_ns=geo_measurement(frame_id).t_mid_utc_ns,
            exposure_s=10.0,
            width_px=4656,
            height_px=3520,
            pointing_ra_icrs_deg=150.0,
            pointing_dec_icrs_deg=0.0,
        ),
        Detections(
            frame_id=frame_id,
            width_px=4656,
            height_px=3520,
            detections=(),
            rejected=tuple(rejected),
        ),
        dataclasses.replace(solution_at(150.0, 0.0), frame_id=frame_id),
    ]


def test_a_track_of_faint_streaks_goes_on_with_them_and_is_replayed_from_its_record():
    frames = {n: record_of(n) for n in range(1, 6)}
    folded = list(replay([r for each in frames.values() for r in each], CONFIG))
    assert [each.after.state for each in folded] == ["SEARCH", "ACQUIRE", *["TRACK"] * 3]
    log = [r for frame in folded for r in (*frames[frame.frame_id], *frame.records)]
    again = list(replay(log, CONFIG))
    assert all(each.is_as_recorded for each in again)
    assert [each.records for each in again] == [each.records for each in folded]
    shown = [m for frame in frames_of(log) for m in frame.measurements]
    assert [(m.measurement_id, m.source) for m in shown] == [(f"{n}-1", "faint") for n in frames]
    begun, *_ = (r for r in log if isinstance(r, TrackState))
    assert begun.begun_with == ("1-1", "3-1")
    assert begun.begun_through == ("2-1",)


def test_what_is_exported_has_the_faint_measurements_of_a_track(tmp_path):
    frames = {n: record_of(n) for n in range(1, 6)}
    writer = SessionWriter.create(tmp_path / "night", CONFIG, {})
    for frame in replay([r for each in frames.values() for r in each], CONFIG):
        for record in (*frames[frame.frame_id], *frame.records):
            writer.append(record, T0_UTC_NS)
    writer.close()
    rows = read_exported_night(tmp_path / "night").rows
    shown = [(row.frame_id, row.source, row.track, row.is_taken) for row in rows]
    assert shown == [(n, "faint", 1, True) for n in frames]


def test_a_script_follows_what_its_table_has_and_comes_to_an_end():
    mine = [geo_measurement(n) for n in range(1, 6)]
    frames = [[encode(r)[::2] for r in record_of(n)] for n in range(1, 6)]
    meta = {META: {"site": None, "frames": frames}}
    more = [dict(zip((c.name for c in SIGMAS), (0.5, 0.5, 0.0, 10.0), strict=True)) for _ in mine]
    table = records_table("measurements", mine, meta, extra=SIGMAS, more=more)
    tracks = rso.track(table, site=(29.0, -81.0, 10.0))
    taken = [frame for each in tracks.values() for frame in each.measurements["frame_id"]]
    assert taken == [m.frame_id for m in mine]


def test_process_says_it_too():
    frame = {
        "frame": "a.fits",
        "state": "TRACK",
        "measurement": None,
        "solution": None,
        "detections": [],
        "no_time": None,
        "nis": None,
        "faint": {"frames": 3, "probability": 0.97},
    }
    assert process_words(frame).endswith("faint: 3 frames together .97")
