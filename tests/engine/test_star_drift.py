"""What the stars of successive frames say of the mount: a drift is told, its own errors are not."""

import math
from dataclasses import replace
from typing import Any

import pytest

from rsoconsole.engine.aim.star_drift import StarDrift
from rsoconsole.instruments import MountReport
from rsoconsole.records import Event, Solution
from rsoconsole.sky import altaz_to_icrs
from tests.makers import NS, T0_UTC_NS
from tests.nights.made_up_night import solution_of
from tests.rigs.engine_rig import SITE, PlainMount, asked, command_handler_of, rig

CADENCE_S, DEC_DEG = 20.0, 40.0
WHERE, BESIDE = ("ra_icrs_deg", "dec_icrs_deg"), altaz_to_icrs(SITE, 50.0, 170.0, T0_UTC_NS)


def plates(rate_arcsec_s: tuple[float, float], count: int) -> list[tuple[Solution, int]]:
    """Plates of a telescope that drifts by so much in RA (on the sky) and Dec."""
    east, north = rate_arcsec_s
    cos_dec = math.cos(math.radians(DEC_DEG))
    made = []
    for n in range(count):
        t_s = n * CADENCE_S
        ra_deg = (359.999 + east * t_s / 3600.0 / cos_dec) % 360.0
        plate = solution_of(n + 1, ra_deg, DEC_DEG + north * t_s / 3600.0)
        plate = replace(plate, frame_id=n + 1)
        made.append((plate, T0_UTC_NS + round(t_s * NS)))
    return made


def told(rate_arcsec_s: tuple[float, float], count: int = 4, *, moves: bool = False) -> list[str]:
    watch, said = StarDrift(), []
    for plate, t_utc_ns in plates(rate_arcsec_s, count):
        if moves:
            watch.note_move()
        watch.note_frame(plate.frame_id, t_utc_ns)
        said.append(watch.drift_words(plate))
    return [words for words in said if words is not None]


@pytest.mark.parametrize("rate", [(10.0, 0.0), (0.0, -3.0), (-1.5, 1.5)])
def test_a_drift_is_told_once_with_its_rate_and_the_frames(rate: tuple[float, float]):
    [words] = told(rate)
    assert f"drifts by {math.hypot(*rate):.1f}″/s against the stars" in words
    assert f"({rate[0]:+.1f}″/s RA·cosδ, {rate[1]:+.1f}″/s δ)" in words
    assert "by frames 1 and 2" in words


@pytest.mark.parametrize("rate", [(0.0, 0.0), (0.5, -0.5), (0.9, 0.0)])
def test_what_worm_gears_and_polar_axes_do_is_no_drift(rate: tuple[float, float]):
    assert told(rate) == []


def test_frames_with_a_slew_between_them_are_not_compared():
    assert told((10.0, 0.0), moves=True) == []


def test_another_rate_is_told_again_and_one_that_has_ended_and_come_back():
    watch, said = StarDrift(), []
    rates = [10.0, 10.0, 30.0, 30.0, 0.0, 10.0]
    ra_deg, t_utc_ns = 100.0, T0_UTC_NS
    for number, rate in enumerate([0.0, *rates], 1):
        ra_deg += rate * CADENCE_S / 3600.0 / math.cos(math.radians(DEC_DEG))
        t_utc_ns += round(CADENCE_S * NS)
        watch.note_frame(number, t_utc_ns)
        plate = replace(solution_of(number, ra_deg, DEC_DEG), frame_id=number)
        said.append(watch.drift_words(plate) is not None)
    assert said == [False, True, False, True, False, False, True]


def test_a_frame_that_was_not_solved_is_bridged_and_a_long_gap_is_not():
    for gap_s, is_told in ((60.0, True), (600.0, False)):
        watch = StarDrift()
        for number, t_s in ((1, 0.0), (2, gap_s)):
            watch.note_frame(number, T0_UTC_NS + round(t_s * NS))
            ra_deg = 100.0 + 5.0 * t_s / 3600.0
            words = watch.drift_words(replace(solution_of(number, ra_deg, 0.0), frame_id=number))
        assert (words is not None) is is_told


# -- in the engine, while the operator has the mount: frames go on without a slew between them -----


class Drifting(PlainMount):
    """Goes where it is told, and on from there while it says that it tracks."""

    RATE_ARCSEC_S = 3.0
    _from: tuple[float, tuple[float, float]] = (0.0, (0.0, 0.0))

    @property
    def at_deg(self) -> tuple[float, float]:
        t_utc_ns, (ra_deg, dec_deg) = self._from
        return ra_deg, dec_deg + self.RATE_ARCSEC_S * (self.clock.t_utc_ns - t_utc_ns) / NS / 3600.0

    @at_deg.setter
    def at_deg(self, place: tuple[float, float]) -> None:
        self._from = self.clock.t_utc_ns, place


class Steady(Drifting):
    RATE_ARCSEC_S = 0.2


class Standing(Drifting):
    """Its tracking is off, by an operator or another program; the stars pass it."""

    def report(self, *arguments: Any, **named: Any) -> MountReport:
        return replace(super().report(*arguments, **named), is_tracking=False)


@pytest.mark.parametrize(
    ("make_mount", "is_told"), [(Drifting, True), (Steady, False), (Standing, False)]
)
def test_the_log_has_a_drift_of_a_mount_that_is_to_track(make_mount: Any, is_told: bool):
    r = rig(set(), make_mount=make_mount)
    command_handler_of(r).handle(asked("goto", dict(zip(WHERE, BESIDE, strict=True))))
    r.engine.run(frames=6)
    said = [e for e in r.memory.of(Event) if "against the stars" in e.text]
    assert len(said) == is_told
    if said:
        assert said[0].level == "warning"
        assert "the mount drifts by 3.0″/s against the stars" in said[0].text
    assert len(r.mount.slews) == 1
