"""The campaign of faults judges by what it sees itself, and a short one finds nothing wrong."""

import numpy as np
import pytest

from tests.campaign import faults
from tests.campaign.fault_growth import HELD, Sample, growing, growth_lines, slopes_of
from tests.campaign.fault_kinds import ENDS_IT, KINDS
from tests.campaign.fault_wire import Orders

WELL = {
    "rows": [],
    "lost": [],
    "unsafe_slews": [],
    "tracebacks": 0,
    "tracebacks_in_logs": 0,
    "slopes": {},
}
SHORT = ("wire cut", "frame spoilt", "socket replaced", "noise on the socket", "log removed")


def test_orders_are_read_from_the_wire_in_whatever_pieces_they_come():
    slew = (
        b'<newNumberVector device="Mount" name="EQUATORIAL_EOD_COORD"><oneNumber name="RA">'
        b'5.25</oneNumber><oneNumber name="DEC">-3.5</oneNumber></newNumberVector>'
    )
    abort = (
        b'<newSwitchVector device="Mount" name="TELESCOPE_ABORT_MOTION"><oneSwitch name="ABORT">'
        b"On</oneSwitch></newSwitchVector>"
    )
    orders, tail = Orders(utc="2023-06-22T02:13:20"), b""
    stream = b"<getProperties/>" + slew + abort + slew
    for begin in range(0, len(stream), 7):
        tail = orders.read(tail + stream[begin : begin + 7])
    assert [(s.ra_date_hours, s.dec_date_deg) for s in orders.slews] == [(5.25, -3.5)] * 2
    assert len(orders.aborts_s) == 1


@pytest.mark.nightly("a night of the whole program")
def test_a_short_night_loses_nothing_and_goes_on(tmp_path):
    answer = faults.night(1, 20, tmp_path / "night", SHORT)
    assert {row["kind"] for row in answer["rows"]} == set(SHORT)
    assert [row["wrong"] for row in answer["rows"] if row["wrong"]] == []
    assert (answer["lost"], answer["unsafe_slews"], answer["tracebacks"]) == ([], [], 0)
    assert answer["acknowledged"] >= len(SHORT)
    assert answer["slews"] > 0


def test_the_table_counts_what_was_wrong():
    row = {
        "kind": "wire cut",
        "recovered_s": 1.0,
        "armed_again": False,
        "slowest_verb_s": 0.1,
        "stop_ordered_ms": 250.0,
        "stop_answered_ms": None,
        "wrong": ["a verb hung"],
    }
    answer = {
        "seed": 4,
        "frames": 9,
        "rows": [row, {**row, "wrong": [], "stop_ordered_ms": 20.0}],
        "acknowledged": 5,
        "destroyed": 1,
        "lost": ["fact 2"],
        "unsafe_slews": ["sent to altitude 3.0 deg"],
        "slews": 7,
        "tracebacks": 0,
        "tracebacks_in_logs": 2,
        "slopes": {},
    }
    text = faults.table([answer])
    for words in (
        "| acknowledged facts lost | 1 of 4 |",
        "| tracebacks in the logs | 2 |",
        "| unsafe slews | 1 of 7 |",
        "| faults after which something was wrong | 1 |",
        "worst 250 ms, 1 of 2 over 200 ms",
        "| wire cut | 2 | 1.0 s, 1.0 s | 0 | a verb hung |",
    ):
        assert words in text


def test_there_are_kinds_enough_and_each_says_what_it_is():
    assert len(KINDS) >= 25
    assert set(ENDS_IT) < set(KINDS)


def test_a_traceback_in_any_log_is_nothing_well():
    assert faults.is_well(WELL)
    for name, found in (("tracebacks_in_logs", 1), ("tracebacks", 1), ("lost", ["fact 1"])):
        assert not faults.is_well({**WELL, name: found})


def life(**grows: float) -> list[Sample]:
    """A life of 1,000 frames on a machine that has ever more to do; ``grows``: a frame."""
    draw, samples = np.random.default_rng(7), []
    for frame in range(2, 1000, 2):
        busy = 1.0 + frame / 500.0 + draw.normal(0.0, 0.3) ** 2
        figures = {
            "mib": 210.0 + 4.0 * (1.0 - np.exp(-frame / 150.0)) + draw.normal(0.0, 0.05),
            "descriptors": 36 + draw.integers(3),
            "threads": 22 + draw.integers(3),
            "cycle_s": 0.2 + 0.05 * busy + draw.normal(0.0, 0.01),
        }
        for name, each in grows.items():
            figures[name] += each * frame
        samples.append(Sample(frame=frame, **figures, pace_s=0.003 * busy))
    return samples


def test_a_life_that_fills_what_is_bounded_on_an_ever_busier_machine_is_flat():
    slopes = slopes_of(life())
    assert set(slopes) == {"mib", "descriptors", "threads", "cycle_s"}
    assert growing(slopes) == []
    assert faults.is_well({**WELL, "slopes": slopes})


@pytest.mark.parametrize(
    ("name", "a_frame"),
    [("mib", 0.004), ("descriptors", 0.01), ("threads", 0.01), ("cycle_s", 0.0001)],
)
def test_what_grows_with_the_frames_is_named_and_nothing_well(name: str, a_frame: float):
    slopes = slopes_of(life(**{name: a_frame}))
    assert growing(slopes) == [HELD[name].words]
    assert not faults.is_well({**WELL, "slopes": slopes})
    marked = [line for line in growth_lines(slopes, "seed 7") if line.endswith("GROWS |")]
    assert [HELD[name].words in line for line in marked] == [True]


def test_a_short_night_has_no_slopes():
    assert slopes_of(life()[:150]) == {}
