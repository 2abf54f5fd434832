"""Every INDI client makes the same of the same bytes, and sends what means the same."""

import base64
import contextlib
import json
import socket
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rsoconsole.instruments.indi.indi_process import DEVICE_LOST, SERVER_LOST
from tests.children.indi_clients import CLIENTS

DEVICE = "Mount"
PATIENCE_S = 20.0
STAMP = 'timestamp="2023-06-22T02:13:20"'
CONNECTION = (
    f'<defSwitchVector device="{DEVICE}" name="CONNECTION" label="Connection" group="Main"'
    f' state="Ok" perm="rw" rule="OneOfMany" timeout="60" {STAMP}>'
    '<defSwitch name="CONNECT" label="Connect">On</defSwitch>'
    '<defSwitch name="DISCONNECT" label="Disconnect">Off</defSwitch></defSwitchVector>\n'
)
NUMBERS = (
    f'<defNumberVector device="{DEVICE}" name="EQ" label="Eq" group="Main" state="Idle" perm="rw"'
    f' timeout="60" {STAMP}>'
    '<defNumber name="RA" label="RA" format="%010.6m" min="0" max="24" step="0">\n  1:30:00\n'
    '</defNumber><defNumber name="DEC" label="Dec" format="%010.6m" min="-90" max="90" step="0">'
    "-0:30:00</defNumber></defNumberVector>\n"
)
TEXTS = (
    f'<defTextVector device="{DEVICE}" name="TIME_UTC" label="UTC" group="Main" state="Idle"'
    f' perm="rw" timeout="60" {STAMP}>'
    '<defText name="UTC" label="UTC">  2023-06-22T02:13:20 </defText>'
    '<defText name="OFFSET" label="Offset"></defText></defTextVector>\n'
)
LIGHTS = (
    f'<defLightVector device="{DEVICE}" name="STATUS" label="Status" group="Main" state="Ok"'
    f' {STAMP}><defLight name="POWER" label="Power">Ok</defLight></defLightVector>\n'
)
BLOBS = (
    f'<defBLOBVector device="{DEVICE}" name="CCD1" label="Image" group="Main" state="Idle"'
    f' perm="ro" timeout="60" {STAMP}><defBLOB name="CCD1" label="Image"/></defBLOBVector>\n'
)
DEFINITIONS = CONNECTION + NUMBERS + TEXTS + LIGHTS + BLOBS


def set_numbers(members: str, more: str = f'state="Ok" {STAMP}', device: str = DEVICE) -> str:
    return f'<setNumberVector device="{device}" name="EQ" {more}>{members}</setNumberVector>\n'


def number(name: str, value: str) -> str:
    return f'<oneNumber name="{name}">{value}</oneNumber>'


def set_blob(content: bytes, line: int) -> bytes:
    text = base64.b64encode(content)
    lines = b"\n".join(text[i : i + line] for i in range(0, len(text), line))
    head = f'<setBLOBVector device="{DEVICE}" name="CCD1" state="Ok" {STAMP}>\n<oneBLOB name="CCD1"'
    # libindi's drivers say how long the text is without the ends of its lines.
    encoded = f' enclen="{len(text)}"' if line == 72 else ""
    head += f' size="{len(content)}"{encoded} format=".fits">\n'
    return head.encode() + lines + b"\n</oneBLOB>\n</setBLOBVector>\n"


class Session:
    """A server of ours with one client that runs in a process of its own."""

    def __init__(self, client: str) -> None:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            host, port = listener.getsockname()
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "tests.children.indi_client_child",
                    client,
                    host,
                    str(port),
                    DEVICE,
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            listener.settimeout(PATIENCE_S)
            self.socket, _ = listener.accept()
        self.socket.settimeout(PATIENCE_S)
        self.received = b""
        self.read_until(b"getProperties")
        self.send(DEFINITIONS)
        self.said_first: list[dict[str, Any]] = []
        while len(self.said_first) < 6:
            self.said_first.append(self.next())
        self.said_first.remove({"ready": True})

    def send(self, text: str | bytes) -> None:
        self.socket.sendall(text.encode() if isinstance(text, str) else text)

    def order(self, *order: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(order).encode() + b"\n")
        self.process.stdin.flush()

    def read_until(self, mark: bytes) -> bytes:
        while mark not in self.received:
            chunk = self.socket.recv(65536)
            assert chunk, self.received
            self.received += chunk
        read, self.received = self.received, b""
        return read

    def next(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, "the client ended"
        said: dict[str, Any] = json.loads(line)
        return said

    def receive(self, is_last: Callable[[dict[str, Any]], Any]) -> list[dict[str, Any]]:
        """What is said until then, the last left out."""
        said = []
        while not is_last(one := self.next()):
            said.append(one)
        return said

    def hear_until_mark(self) -> list[dict[str, Any]]:
        """What the client has made of everything that was sent until now."""
        self.send(set_numbers(number("RA", "23.5"), 'state="Busy"'))
        return self.receive(lambda said: said.get("state") == "Busy")

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self.socket.close()
        self.process.kill()
        self.process.communicate()


@pytest.fixture(params=CLIENTS)
def session(request: pytest.FixtureRequest) -> Iterator[Session]:
    opened = Session(request.param)
    yield opened
    opened.close()


def test_definitions_are_plain_values_with_their_state_and_time(session):
    told = {said["name"]: said for said in session.said_first}
    assert told["CONNECTION"]["values"] == {"CONNECT": True, "DISCONNECT": False}
    assert told["EQ"]["values"] == {"RA": 1.5, "DEC": -0.5}
    assert told["TIME_UTC"]["values"]["UTC"].strip() == "2023-06-22T02:13:20"
    assert told["TIME_UTC"]["values"]["OFFSET"] == ""
    assert told["STATUS"]["values"] == {}
    assert told["CCD1"]["blobs"] == {}
    assert all(said["is_definition"] for said in told.values())
    assert [told[name]["state"] for name in ("CONNECTION", "EQ", "CCD1")] == ["Ok", "Idle", "Idle"]


def test_a_change_of_one_member_leaves_the_others_as_they_were(session):
    session.send(set_numbers(number("DEC", "12.25")))
    (said,) = session.hear_until_mark()
    assert (said["values"], said["state"]) == ({"RA": 1.5, "DEC": 12.25}, "Ok")
    assert not said["is_definition"]


def test_what_is_defined_already_is_not_defined_again(session):
    session.send(NUMBERS.replace("1:30:00", "9"))
    assert session.hear_until_mark() == []


def test_other_devices_are_none_of_its_business(session):
    session.send(DEFINITIONS.replace(DEVICE, "Other"))
    session.send(set_numbers(number("RA", "3"), device="Other"))
    assert session.hear_until_mark() == []


def test_a_driver_s_words_come_before_the_change_that_they_go_with(session):
    session.send(f'<message device="{DEVICE}" {STAMP} message="[INFO] hello"/>\n')
    session.send(set_numbers(number("RA", "2"), f'state="Alert" {STAMP} message="cannot &lt;"'))
    first, second, third = session.hear_until_mark()
    assert first == {"message": "2023-06-22T02:13:20: [INFO] hello"}
    assert second == {"message": "2023-06-22T02:13:20: cannot <"}
    assert third["state"] == "Alert"


def test_a_property_that_goes_is_forgotten_and_may_come_back(session):
    session.send(f'<delProperty device="{DEVICE}" name="EQ" {STAMP}/>\n')
    session.send(f'<message device="{DEVICE}" {STAMP} message="gone"/>\n')
    assert session.next()["message"].endswith("gone")
    session.order("forgotten", "EQ")
    assert session.next() == {"forgotten": True}
    session.send(NUMBERS)
    assert session.next()["values"] == {"RA": 1.5, "DEC": -0.5}


def test_a_driver_that_ends_and_comes_back_defines_everything_again(session):
    session.send(f'<delProperty device="{DEVICE}" {STAMP} message="the driver ended"/>\n')
    session.send(set_numbers(number("RA", "7")))
    session.send(DEFINITIONS)
    words, *said = session.hear_until_mark()
    assert words["message"].endswith("the driver ended")
    assert said == session.said_first


def test_a_blob_comes_whole_whatever_its_lines(session):
    content = bytes(range(256)) * 300 + b"\xff"
    session.order("blobs", "CCD1")
    enable = session.read_until(b"</enableBLOB>").decode()
    assert f'device="{DEVICE}"' in enable.replace("'", '"')
    assert ">Also<" in enable
    for line in (72, 1 << 20):
        session.send(set_blob(content, line))
        (said,) = session.hear_until_mark()
        # libindi counts the ends of lines as content, too: something follows.
        assert bytes.fromhex(said["blobs"]["CCD1"])[: len(content)] == content
        assert (said["name"], said["state"]) == ("CCD1", "Ok")


def test_orders_say_device_property_and_the_members_that_are_wanted(session):
    session.order("numbers", "EQ", {"RA": 5.123456789012345, "DEC": -12.5})
    session.order("switch", "CONNECTION", "CONNECT")
    text = session.read_until(b"</newSwitchVector>").decode()
    numbers, switch = ET.fromstring(f"<all>{text}</all>")
    assert numbers.tag == "newNumberVector"
    assert (numbers.get("device"), numbers.get("name")) == (DEVICE, "EQ")
    values = {one.get("name"): float((one.text or "").strip()) for one in numbers}
    assert values == {"RA": 5.123456789012345, "DEC": -12.5}
    assert (switch.get("device"), switch.get("name")) == (DEVICE, "CONNECTION")
    assert [(one.get("name"), (one.text or "").strip()) for one in switch] == [("CONNECT", "On")]


MALFORMED = {
    "a number that is none": set_numbers(number("RA", "north")),
    "a member without a name": set_numbers("<oneNumber>5</oneNumber>"),
    "an unknown property": set_numbers(number("RA", "5")).replace('"EQ"', '"NOTHING"'),
    "an unknown tag": f'<oddVector device="{DEVICE}" name="EQ"/>',
    "a vector without a name": f'<setNumberVector device="{DEVICE}" state="Ok"/>',
    "a definition without members": f'<defNumberVector device="{DEVICE}" name="ODD" state="Ok"/>',
    "a BLOB that is no base64": (
        f'<setBLOBVector device="{DEVICE}" name="CCD1" state="Ok" {STAMP}><oneBLOB name="CCD1"'
        ' size="nine" format=".fits">*!</oneBLOB></setBLOBVector>'
    ),
    "an ampersand that stands for itself": (
        set_numbers(number("RA", "5"), f'state="Ok" {STAMP} message="R&D &amp; more"')
    ),
    "control characters": "\x00\x01\x02 nonsense \x1b[0m",
}


@pytest.mark.parametrize("kind", MALFORMED)
def test_after_a_malformed_message_the_next_ones_are_understood(session, kind):
    session.send(MALFORMED[kind])
    # A message of its own to the system.
    time.sleep(0.2)
    session.send(set_numbers(number("DEC", "33")))
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        time.sleep(0.1)
        session.send(set_numbers(number("DEC", "34"), 'state="Busy"'))
        said = session.next()
        if said.get("name") == "EQ" and said["values"]["DEC"] == 34.0:
            break
    else:
        pytest.fail("nothing is understood any more")
    assert said["state"] == "Busy"
    assert session.process.poll() is None


def test_tags_that_cross_cost_a_reconnection_at_most(session):
    """libindi goes on; indipyclient ends, and the next order makes another process."""
    session.send("<setNumberVector><oneNumber></setNumberVector></oneNumber>")
    with contextlib.suppress(subprocess.TimeoutExpired):
        assert session.process.wait(1.0) == SERVER_LOST
        return
    session.send(set_numbers(number("DEC", "34")))
    assert [said["values"]["DEC"] for said in session.hear_until_mark()] == [34.0]


def test_letters_of_another_alphabet_cost_nothing(session):
    latin = NUMBERS.replace('"EQ"', '"ALT"').replace('label="Dec"', 'label="Dec (\xb0)"')
    session.send(latin.encode("latin-1") + set_numbers(number("DEC", "7")).encode())
    assert [said["values"]["DEC"] for said in session.hear_until_mark()] == [-0.5, 7.0]
    session.send(TEXTS.replace('"TIME_UTC"', '"\u00c5"').replace("2023", "\u20ac"))
    (said,) = session.hear_until_mark()
    assert said["name"] == "\u00c5"
    assert said["values"]["UTC"].strip().startswith("\u20ac-06")


def test_a_server_that_hangs_up_ends_the_process_at_once(session):
    session.socket.close()
    begun_s = time.monotonic()
    assert session.process.wait(PATIENCE_S) == SERVER_LOST
    assert time.monotonic() - begun_s < 2.0


def test_a_driver_that_is_started_again_unconnected_ends_the_process(session):
    """indiserver starts a driver that died again, and it offers its connection once more."""
    session.send(f'<delProperty device="{DEVICE}" {STAMP}/>\n')
    again = CONNECTION.replace(">On<", ">?<").replace(">Off<", ">On<").replace(">?<", ">Off<")
    session.send(again)
    assert session.process.wait(PATIENCE_S) == DEVICE_LOST


def test_what_is_sent_in_pieces_is_read_as_a_whole(session):
    text = set_numbers(number("RA", "4.5") + number("DEC", "-4.5")).encode()
    for byte in range(0, len(text), 3):
        session.send(text[byte : byte + 3])
    (said,) = session.hear_until_mark()
    assert said["values"] == {"RA": 4.5, "DEC": -4.5}
