"""An order ends the wish against it: nothing that was wanted before comes back by itself."""

import dataclasses
from collections.abc import Callable

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.control import Goto, Request, Sender
from rsoconsole.engine.aim.states import Failed, LimitMet, NightEnded, Stopped
from rsoconsole.instruments import MountAbilities, MountReport, StopResult
from rsoconsole.records import Event, OperatorAction, StateChange
from rsoconsole.sky import altaz_to_icrs, separation_deg
from rsoconsole.words import text
from tests.makers import NS, T0_UTC_NS
from tests.rigs.engine_rig import (
    SITE,
    PlainMount,
    Rig,
    StillClock,
    asked,
    command_handler_of,
    rig,
)

BESIDE = altaz_to_icrs(SITE, 50.0, 170.0, T0_UTC_NS)
ELSEWHERE = altaz_to_icrs(SITE, 60.0, 160.0, T0_UTC_NS)
HOME = altaz_to_icrs(SITE, 30.0, 180.0, T0_UTC_NS)
TAKES_NS = 50 * NS
"""A slew, and the way to the park position."""
Way = tuple[int, tuple[float, float], tuple[float, float]]


class SlowMount(PlainMount):
    """Takes its time; takes no slew while it parks, as INDI's mounts do not."""

    def __init__(self, clock: StillClock) -> None:
        super().__init__(clock)
        self.way: Way | None = None
        """When it began, from where, where to."""
        self.is_parking = False
        self.says_parking = True
        """Some drivers do not say where they go."""
        self.parks: list[int] = []
        self.unparks = 0

    def _look(self) -> None:
        if self.way is None:
            return
        began_ns, begin, end = self.way
        share = min((self.clock.t_utc_ns - began_ns) / TAKES_NS, 1.0)
        self.at_deg = tuple(a + share * (b - a) for a, b in zip(begin, end, strict=True))
        if share >= 1.0:
            self.is_parked, self.is_parking, self.way = self.is_parking, False, None

    def _go(self, to_deg: tuple[float, float]) -> None:
        self.way = (self.clock.t_utc_ns, self.at_deg, to_deg)

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        self._look()
        if self.is_parked or self.is_parking:
            raise InstrumentError("the mount is on its way to its park position: unpark it first")
        if self.way is not None:
            raise InstrumentError("the mount takes no new target while it moves")
        self.slews.append((ra_icrs_deg, dec_icrs_deg))
        self._go((ra_icrs_deg, dec_icrs_deg))

    def park(self) -> None:
        self._look()
        self.parks.append(self.clock.t_utc_ns)
        self.is_parking = True
        self._go(HOME)

    def unpark(self) -> None:
        self._look()
        self.unparks += 1
        if self.is_parking:
            self.way, self.is_parking = None, False
        self.is_parked = False

    def abort(self, timeout_s: float = 2.0, **news: Callable[[StopResult], None]) -> StopResult:
        self._look()
        self.way, self.is_parking = None, False
        return super().abort(timeout_s, **news)

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        self._look()
        return dataclasses.replace(
            super().report(),
            is_slewing=self.way is not None,
            is_parking=self.is_parking and self.says_parking,
        )


@dataclasses.dataclass
class SlowRig:
    """An engine whose mount takes its time."""

    whole: Rig
    mount: SlowMount

    def __post_init__(self) -> None:
        self.engine, self.clock, self.memory = (
            self.whole.engine,
            self.whole.clock,
            self.whole.memory,
        )

    def order(self, verb: str, **arguments: object) -> str:
        """One command, executed; what came of it."""
        self.whole.queue.put(asked(verb, arguments))
        return self.turn()

    def goto(self, direction: tuple[float, float]) -> str:
        command = Goto(ra_icrs_deg=direction[0], dec_icrs_deg=direction[1])
        self.whole.queue.put(Request(command=command, sender=Sender(name="console")))
        return self.turn()

    def turn(self) -> str:
        self.engine.commands.execute_waiting()
        return text(self.memory.of(OperatorAction)[-1].outcome)

    def idle(self, seconds: float) -> None:
        """The loop turns without a frame, as it does while nobody has the mount."""
        until_ns = self.clock.t_utc_ns + round(seconds * NS)
        while self.clock.t_utc_ns < until_ns:
            self.engine._one_turn(is_bounded=False)

    def later(self, seconds: float) -> None:
        """Time passes, and the loop is at something else."""
        self.clock.t_utc_ns += round(seconds * NS)

    @property
    def words(self) -> list[str]:
        return [event.text for event in self.memory.of(Event)]


def slow(frames: set[int] | None = None, config: Config | None = None) -> SlowRig:
    whole = rig(frames or set(), config or Config(), make_mount=SlowMount)
    assert isinstance(whole.mount, SlowMount)
    return SlowRig(whole, whole.mount)


# ---- park and its opposites -------------------------------------------------------------------


def test_a_mount_that_was_unparked_is_not_parked_again():
    """On EQMod, PMC8 and Paramount the engine parked it again within 30 s."""
    r = slow()
    r.order("park")
    r.later(70.0)
    assert r.mount.report().is_parked
    r.order("unpark")
    r.idle(120.0)
    assert len(r.mount.parks) == 1
    assert not r.mount.is_parked
    assert not r.engine.is_park_wanted


def test_that_the_mount_is_parked_is_seen_at_the_next_look():
    """Not up to 30 s later: until then a run of some frames did not end."""
    r = slow()
    r.order("park")
    r.idle(53.0)
    assert "the mount is parked" in r.words
    assert not r.engine.is_park_wanted


@pytest.mark.parametrize("says_parking", [True, False])
def test_unpark_stops_a_mount_that_is_on_its_way_to_its_park_position(says_parking):
    r = slow()
    r.mount.says_parking = says_parking
    r.order("park")
    r.idle(20.0)
    assert r.order("unpark") == "the mount is not parked any more"
    assert r.mount.way is None
    assert not r.mount.is_parked
    r.idle(120.0)
    assert len(r.mount.parks) == 1


def test_a_mount_on_its_way_to_be_parked_may_be_asked_to_be_unparked():
    r = slow()
    answers = command_handler_of(r.whole)
    assert not answers.begin(asked("unpark")).ok
    r.order("park")
    r.idle(20.0)
    begun = answers.begin(asked("unpark"))
    assert getattr(begun, "ok", True), begun


@pytest.mark.parametrize("says_parking", [True, False])
def test_a_go_to_ends_a_park_that_is_under_way(says_parking):
    r = slow()
    r.mount.says_parking = says_parking
    r.order("park")
    r.idle(20.0)
    assert r.goto(BESIDE) == "on its way"
    assert r.engine.status().holder == "operator"
    r.later(70.0)
    r.mount.report()
    assert separation_deg(*r.mount.at_deg, *BESIDE) < 1e-6
    r.order("disarm")
    r.idle(120.0)
    assert len(r.mount.parks) == 1


def test_a_nudge_while_the_mount_parks_counts_from_where_that_ends():
    r = slow()
    r.order("park")
    r.idle(20.0)
    r.order("nudge", east_arcmin=0.0, north_arcmin=30.0)
    stood = r.mount.way[1]
    assert r.mount.slews[-1][1] - stood[1] == pytest.approx(0.5, abs=1e-3)
    r.order("disarm")
    r.idle(120.0)
    assert len(r.mount.parks) == 1


def test_tracking_turned_on_ends_a_park_and_turned_off_does_not():
    r = slow()
    r.order("park")
    r.idle(5.0)
    r.order("track", on=False)
    assert r.engine.is_park_wanted
    assert r.order("track", on=True) == "the mount tracks"
    assert r.mount.way is None
    r.idle(120.0)
    assert (len(r.mount.parks), r.mount.is_parked) == (1, False)


@pytest.mark.parametrize("says_parking", [True, False])
def test_arming_ends_a_park_under_way_and_searches_from_where_that_leaves_it(says_parking):
    """It failed with "on its way to its park position" at its first slew."""
    r = slow()
    r.mount.says_parking = says_parking
    r.order("park")
    r.idle(20.0)
    r.engine.arm()
    assert r.mount.way is None
    assert not r.engine.is_park_wanted
    r.engine.run(frames=3)
    assert [c.after for c in r.memory.of(StateChange)] == ["SEARCH"]
    assert r.mount.slews
    assert len(r.mount.parks) == 1


def test_a_park_that_is_tried_again_and_again_is_over_with_arming():
    r = slow()

    def refuses() -> None:
        r.mount.parks.append(r.clock.t_utc_ns)
        raise InstrumentError("the mount refused to park")

    r.mount.park = refuses  # type: ignore[method-assign]
    r.order("park")
    r.idle(70.0)
    assert len(r.mount.parks) == 3
    r.engine.arm()
    r.engine.run(frames=3)
    r.order("disarm")
    r.idle(70.0)
    assert len(r.mount.parks) == 3


def test_a_second_park_on_the_way_is_no_second_order():
    for says_parking in (True, False):
        r = slow()
        r.mount.says_parking = says_parking
        r.order("park")
        r.idle(20.0)
        r.order("park")
        r.idle(60.0)
        assert len(r.mount.parks) == 1
        assert r.mount.is_parked


def test_a_park_is_ordered_each_half_minute_and_no_oftener():
    r = slow()

    def refuses() -> None:
        r.mount.parks.append(r.clock.t_utc_ns)
        raise InstrumentError("the mount refused to park")

    r.mount.park = refuses  # type: ignore[method-assign]
    r.order("park")
    r.idle(300.0)
    apart_s = {round((b - a) / NS) for a, b in zip(r.mount.parks, r.mount.parks[1:], strict=False)}
    assert (len(r.mount.parks), apart_s) == (10, {30})


def test_a_silent_mount_is_looked_at_each_half_minute():
    """Each look takes as long as it is waited for: the loop would do nothing else."""
    r = slow()
    r.order("park")
    looks: list[int] = []

    def silent(*_: object) -> MountReport:
        looks.append(r.clock.t_utc_ns)
        raise InstrumentError("the mount has not reported for 10 s")

    r.mount.report = silent  # type: ignore[method-assign]
    for _ in range(100):
        r.engine._parking.see_to_it()
        r.later(1.0)
    assert len(looks) == 4


def test_a_mount_without_a_park_position_refuses_to_be_parked_at_once():
    r = slow({*range(1, 30)})
    r.mount.able = MountAbilities(can_park=False)
    r.engine.arm()
    assert "no park position" in r.order("park")
    assert r.engine.authority.is_autonomous
    assert r.mount.parks == []


def test_at_dawn_a_mount_without_a_park_position_is_told_of_once():
    r = slow()
    r.mount.able = MountAbilities(can_park=False)
    r.engine.arm()
    r.engine.handle(NightEnded(words="the Sun stands at -11.9 deg", parks=True, is_dawn=True))
    r.idle(700.0)
    told = [words for words in r.words if "does not park" in words]
    assert len(told) == 1
    assert "no park position" in told[0]
    assert r.mount.parks == []


def test_arming_after_dawn_s_park_began_is_not_parked_again():
    r = slow()
    r.engine.arm()
    r.engine.handle(NightEnded(words="rain", parks=True))
    r.idle(20.0)
    assert len(r.mount.parks) == 1
    r.engine.arm()
    r.engine.run(frames=2)
    assert len(r.mount.parks) == 1
    assert r.engine.authority.is_autonomous


def test_what_waits_when_the_night_ends_moves_the_mount_no_more():
    r = slow()
    r.engine.arm()
    waiting = asked("goto", {"ra_icrs_deg": BESIDE[0], "dec_icrs_deg": BESIDE[1]})
    r.whole.queue.put(waiting)
    r.whole.queue.interrupt(NightEnded(words="rain", parks=True))
    (alarm,) = r.whole.queue.take_alarms()
    assert alarm.dropped == (waiting,)
    assert r.whole.queue.take_all() == ()


# ---- a move by hand and its opposites ------------------------------------------------------------


@pytest.mark.parametrize(
    "trigger",
    [
        Stopped(by="operator"),
        LimitMet(words="altitude 14.9 deg"),
        Failed(words="the camera is gone", is_final=True),
    ],
)
def test_a_nudge_after_the_end_of_a_go_to_counts_from_where_the_telescope_looks(trigger):
    r = slow()
    r.goto(BESIDE)
    r.later(20.0)
    r.mount.abort()
    r.engine.handle(trigger)
    assert r.engine.hand_move is None
    assert r.engine.instrument_controller.sent is None
    stood = r.mount.at_deg
    assert separation_deg(*stood, *BESIDE) > 1.0
    r.order("nudge", east_arcmin=0.0, north_arcmin=30.0)
    assert separation_deg(*r.mount.slews[-1], *stood) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("verb", ["park", "disarm"])
def test_park_and_disarm_end_a_go_to(verb):
    r = slow()
    r.goto(BESIDE)
    r.later(20.0)
    r.order(verb)
    assert r.engine.hand_move is None


def test_a_go_to_that_the_mount_refuses_leaves_none_behind():
    """The one before it was ended for it: its target was waited for, and "somebody else" blamed."""
    r = slow()
    r.goto(BESIDE)
    r.later(20.0)

    def refuses(*_: object) -> None:
        raise InstrumentError("the mount refused to slew")

    r.mount.slew = refuses  # type: ignore[method-assign]
    assert "refused to slew" in r.goto(ELSEWHERE)
    assert r.engine.hand_move is None
    assert r.engine.instrument_controller.sent is None
    r.engine.run(frames=2)
    assert not any("somebody else" in words for words in r.words)
    assert r.engine.status().holder == "operator"


def test_a_refused_go_to_in_autonomy_s_slew_leaves_the_mount_to_the_operator():
    r = slow({*range(1, 30)})
    r.engine.arm()
    r.mount.slew(*BESIDE, r.clock.t_utc_ns)
    r.later(20.0)

    def refuses(*_: object) -> None:
        raise InstrumentError("the mount refused to slew")

    r.mount.slew = refuses  # type: ignore[method-assign]
    assert "refused to slew" in r.goto(ELSEWHERE)
    r.engine.run(frames=2)
    assert not any("somebody else" in words for words in r.words)
    assert r.engine.authority.is_resumable


def test_the_second_of_two_go_tos_counts():
    r = slow()
    r.goto(BESIDE)
    r.later(20.0)
    r.goto(ELSEWHERE)
    assert r.engine.hand_move is not None
    r.engine.run(frames=1)
    assert separation_deg(*r.mount.at_deg, *ELSEWHERE) < 1e-6


def test_a_go_to_that_waits_behind_an_unpark_is_no_refusal():
    r = slow()
    r.mount.is_parked = True
    handlers = r.engine.handlers
    goto = asked("goto", {"ra_icrs_deg": BESIDE[0], "dec_icrs_deg": BESIDE[1]})
    handlers[type(goto.command)].check(goto.command, "operator")
    with pytest.raises(ValueError, match="unpark it first"):
        handlers[type(goto.command)].expect(goto.command, "operator")
    r.whole.queue.put(asked("unpark"))
    r.whole.queue.put(goto)
    assert r.turn() == "on its way"


def test_arming_in_a_go_to_searches_from_where_that_leads():
    r = slow()
    r.goto(BESIDE)
    r.later(20.0)
    r.engine.arm()
    assert separation_deg(*r.mount.at_deg, *BESIDE) < 1e-6
    pose = r.engine.planner.pose(r.clock.t_utc_ns)
    assert pose is not None
    assert separation_deg(pose.ra_icrs_deg, pose.dec_icrs_deg, *BESIDE) < 0.1


def test_resuming_a_track_ends_a_go_to_that_is_under_way():
    """Some drivers take no new target while they move: three of them made a FAULT."""
    r = slow({*range(1, 60)})
    r.engine.arm()
    r.engine.run(frames=6)
    assert r.engine.authority.state == "TRACK"
    r.goto(BESIDE)
    r.later(10.0)
    r.order("resume")
    assert r.engine.hand_move is None
    assert r.mount.way is None
    r.engine.run(frames=10)
    assert "FAULT" not in [c.after for c in r.memory.of(StateChange)]
    assert r.engine.authority.state == "TRACK"


# ---- hold and resume ---------------------------------------------------------------------------


@pytest.mark.parametrize("until", [None, "clear"])
@pytest.mark.parametrize("verb", ["resume", "disarm", "goto", "STOP"])
def test_a_hold_is_over_with_what_ends_it(verb, until):
    r = slow({*range(1, 60)})
    r.engine.arm()
    r.engine.run(frames=6)
    r.engine.frames.clear_frames = 0
    r.order("hold", **({} if until is None else {"until": until}))
    assert r.engine.authority.is_held
    if verb == "goto":
        r.goto(BESIDE)
    elif verb == "STOP":
        r.engine.handle(Stopped(by="operator"))
    else:
        r.order(verb)
    assert not r.engine.authority.is_held
    assert not r.engine.authority.resumes_when_clear
    if not r.engine.authority.is_autonomous:
        r.engine.arm()
    assert not r.engine.authority.is_held


def test_a_plain_hold_does_not_end_by_the_sky_when_one_that_would_came_before():
    r = slow({*range(1, 60)})
    r.engine.arm()
    r.engine.frames.clear_frames = 0
    r.order("hold", until="clear")
    r.order("hold")
    r.engine.run(frames=8)
    assert r.engine.authority.is_held


# ---- settings for some frames --------------------------------------------------------------------


def test_an_exposure_for_some_frames_goes_back_to_the_night_s_own():
    """Not to the one that the track had it changed to, which no track's end would set back."""
    from rsoconsole.engine.tasks.pace import Pace, TemporarySettings, config_with_setting
    from tests.engine.test_pace import track

    night = Config.model_validate({"exposure": {"automatic": True}})
    pace = Pace()
    temporary = TemporarySettings(pace.config_before_track)
    paced, _ = pace.after(night, track(167.0))
    assert paced.exposure.exposure_s != night.exposure.exposure_s
    temporary.remember_setting(paced, "exposure.exposure_s", 1)
    lent = config_with_setting(paced, "exposure.exposure_s", 4.0)
    after, _ = pace.after(lent, track(167.0))
    back, _ = temporary.count(after)
    ended, _ = pace.after(back, None)
    assert ended.exposure == night.exposure
