"""A refusal is told with what the driver has said since that order, never with an older word."""

import threading
import time
from collections.abc import Mapping

import pytest

from rsoconsole.instruments.indi.indi_client import IndiClient, Vector


class SaidClient(IndiClient):
    """A driver whose words a test gives it."""

    def _connect(self, host: str, port: int) -> bool:
        return True

    def _connect_device(self) -> None:
        pass

    def _send_numbers(self, name: str, values: Mapping[str, float]) -> None:
        pass

    def _send_switch(self, name: str, member: str) -> None:
        pass

    def enable_blobs(self, name: str) -> None:
        pass

    def _let_go(self, content: memoryview) -> None:
        pass

    def says(self, words: str) -> None:
        self._note_message(words)

    def answers(self, state: str) -> None:
        self._store(
            Vector(
                name="PARK",
                state=state,
                values={},
                serial=self._next_serial(),
                is_definition=False,
                arrived_monotonic_s=0.0,
            )
        )


@pytest.fixture
def client() -> SaidClient:
    return SaidClient("Mount", lambda _vector: None)


def test_what_was_said_before_the_order_is_no_reason(client: SaidClient):
    client.says("2026-11-28T07:17:15: [ERROR] Slew aborted: cable")
    before = client.send_switch("PARK", "PARK")
    assert client.driver_message_since(before) == ""
    client.answers("Alert")
    assert client.failure_reason_since(before) == "no reason given"


def test_what_is_said_after_it_is(client: SaidClient):
    client.says("[ERROR] an old one")
    before = client.send_numbers("COORD", {"RA": 1.0})
    client.says("2026-11-28T07:17:15.5: [ERROR] Parking failed, home first")
    client.answers("Alert")
    assert client.failure_reason_since(before) == "[ERROR] Parking failed, home first"
    # The next order has its own words, or none.
    assert client.driver_message_since(client.send_switch("PARK", "PARK")) == ""


def test_an_error_counts_more_than_what_is_said_beside_it(client: SaidClient):
    before = client.last_update_number()
    for words in ("[INFO] Slewing", "[WARNING] slow", "[ERROR] below horizon", "[INFO] Tracking"):
        client.says(words)
    assert client.driver_message_since(before) == "[ERROR] below horizon"


def test_a_reason_that_comes_just_behind_the_answer_is_waited_for(client: SaidClient):
    before = client.send_switch("PARK", "PARK")
    client.answers("Alert")

    def late() -> None:
        time.sleep(0.05)
        client.says("[ERROR] home first")

    thread = threading.Thread(target=late)
    thread.start()
    assert client.failure_reason_since(before) == "[ERROR] home first"
    thread.join()


def test_an_answer_behind_words_is_still_found_by_who_waits_for_it(client: SaidClient):
    before = client.send_switch("PARK", "PARK")
    client.says("[INFO] parking")
    client.answers("Busy")
    client.says("[INFO] still parking")
    answer = client.wait("PARK", lambda _: True, 0.0, before)
    assert answer is not None
    assert answer.state == "Busy"
