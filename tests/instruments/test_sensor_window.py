"""Parts of a sensor, by what drivers answer: late, twice, rounded, refused, or not at all."""

from collections.abc import Callable, Mapping, Sequence

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.camera._sensor_window import SensorWindow, central_window
from rsoconsole.instruments.indi.indi_client import Vector

WHOLE = [0, 0, 4656, 3520]
HALF = [1168, 880, 2320, 1760]
SIDES = ("X", "Y", "WIDTH", "HEIGHT")
Answer = tuple[str, list[int] | None]
"""State, and window; None: as it was."""


class ScriptedClient:
    """A driver that says to each order what is written; time does not pass."""

    def __init__(
        self, answers: Sequence[Answer], now: Sequence[int] = WHOLE, binning: int = 1
    ) -> None:
        self.answers, self.now, self.binning = answers, list(now), binning
        self.state, self.serial = "Ok", 1
        self.words: list[Vector] = []
        self.asked: list[list[int]] = []

    def vector(self, name: str, values: Mapping[str, float]) -> Vector:
        return Vector(
            name=name,
            state=self.state,
            values=values,
            serial=self.serial,
            is_definition=False,
            arrived_monotonic_s=0.0,
        )

    def get(self, name: str) -> Vector | None:
        if name == "CCD_FRAME":
            return self.vector(name, dict(zip(SIDES, map(float, self.now), strict=True)))
        if name == "CCD_BINNING":
            return self.vector(name, {"HOR_BIN": float(self.binning)})
        return self.vector(name, {"CCD_MAX_X": 4656.0, "CCD_MAX_Y": 3520.0})

    def failure_reason_since(self, after: int) -> str:
        return "no such part"

    def send_numbers(self, name: str, values: Mapping[str, float]) -> int:
        self.asked.append([int(values[side]) for side in SIDES])
        before = self.serial
        for state, window in self.answers:
            self.state, self.now = state, list(window or self.now)
            self.serial += 1
            self.words.append(self.get(name))  # type: ignore[arg-type]
        return before

    def wait(
        self, name: str, is_wanted: Callable[[Vector], bool], timeout_s: float, after: int
    ) -> Vector | None:
        assert timeout_s <= 3.0
        later = (each for each in self.words if each.serial > after)
        return next((each for each in later if is_wanted(each)), None)


def window(client: ScriptedClient) -> SensorWindow:
    return SensorWindow(client, 15.0)  # type: ignore[arg-type]


def half(client: ScriptedClient, own: Sequence[int] = (), size=(4656, 3520)) -> dict:
    return window(client).set_share(0.5, list(own), size)


@pytest.mark.parametrize(
    "answers",
    [
        [("Ok", HALF)],
        [("Alert", HALF), ("Ok", HALF)],  # the state of a refusal before
        [("Alert", None), ("Ok", HALF)],
        [("Busy", None), ("Ok", HALF)],
        [("Ok", [1168, 880, 2304, 1760])],  # rounded
    ],
)
def test_a_part_that_is_taken_is_told_with_what_was_read_before(answers) -> None:
    client = ScriptedClient(answers)
    found = half(client)
    assert client.asked == [HALF]
    assert found["own"] == WHOLE
    assert found["window"] == client.now
    assert found["share"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(
    "answers", [[], [("Alert", None)], [("Ok", None)], [("Ok", [0, 0, 2320, 1760])]]
)
def test_what_is_refused_done_otherwise_or_left_unsaid_is_an_error_with_the_remedy(answers) -> None:
    with pytest.raises(InstrumentError, match=r"did not take 2320 x 1760 .* leap\.subframe to 1"):
        half(ScriptedClient(answers))


def test_nothing_is_asked_that_is_so_already() -> None:
    client = ScriptedClient([], HALF)
    assert half(client)["window"] == HALF
    assert not client.asked


@pytest.mark.parametrize("size", [(4656, 3520), (2328, 1760)])
def test_what_a_killed_engine_has_left_is_given_back(size) -> None:
    client = ScriptedClient([("Ok", WHOLE)], HALF)
    window(client).restore_whole(size)
    assert client.asked == [WHOLE]


@pytest.mark.parametrize(
    ("now", "size"),
    [
        (WHOLE, (4656, 3520)),
        ([0, 0, 2320, 1760], (4656, 3520)),  # in a corner: nothing that leaps have asked for
        (HALF, (2320, 1760)),  # as configured
    ],
)
def test_what_is_the_operators_own_is_left_alone(now, size) -> None:
    client = ScriptedClient([], now)
    window(client).restore_whole(size)
    assert not client.asked


def test_a_part_of_a_part_is_about_its_middle() -> None:
    own = [200, 100, 3600, 2400]
    client = ScriptedClient([("Ok", central_window(own, 0.5, 16))], own)
    found = half(client, size=(3600, 2400))
    assert found["own"] == own
    x, y, width, height = found["window"]
    assert (width, height) == (1792, 1200)
    assert abs(x + width / 2 - 2000) <= 16
    assert abs(y + height / 2 - 1300) <= 16


def test_a_part_is_not_taken_for_the_whole_where_the_configured_size_is_neither() -> None:
    with pytest.raises(InstrumentError, match=r"reads 1792 x 1200 .* not optics\.width_px"):
        half(ScriptedClient([], [1096, 692, 1792, 1200]), size=(3600, 2400))


@pytest.mark.parametrize("joined", [1, 2, 3, 4])
def test_sides_are_multiples_of_sixteen_joined_pixels(joined) -> None:
    x, y, width, height = central_window(WHOLE, 0.4, 16 * joined)
    assert all(each % (16 * joined) == 0 for each in (x, y, width, height))


def test_what_joining_has_rounded_away_is_read_again() -> None:
    client = ScriptedClient([("Ok", WHOLE)])
    there = window(client)
    there.remember()
    client.now = [0, 0, 4640, 3520]
    there.restore()
    assert client.asked == [WHOLE]
