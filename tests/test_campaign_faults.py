"""The campaign of faults judges by what it sees itself, and a short one finds nothing wrong."""

from tests.campaign import faults
from tests.campaign.fault_kinds import ENDS_IT, KINDS
from tests.campaign.fault_wire import Orders

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
        "stop_confirmed_ms": None,
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
    well = {"rows": [], "lost": [], "unsafe_slews": [], "tracebacks": 0, "tracebacks_in_logs": 0}
    assert faults.is_well(well)
    for name, found in (("tracebacks_in_logs", 1), ("tracebacks", 1), ("lost", ["fact 1"])):
        assert not faults.is_well({**well, name: found})
