"""INDI by plain TCP and the standard library: the second way to STOP, and the simulated clock.

A stream of XML elements without a root. Nothing here depends on a client library or
on another process.
"""

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape, quoteattr

from rsoconsole.errors import InstrumentError
from rsoconsole.indi_port import indi_port_option
from rsoconsole.instruments import AfterStop, StopResult, tracking_after_stop

_MEMBER = {"Number": "oneNumber", "Switch": "oneSwitch", "Text": "oneText"}
_READ_BYTES = 65536
_REPEAT_ABORT_S = 0.5
_LOOK_S = 0.05
_TRACKING_S = 2.0
_SETTLE_S = 1.2
"""A driver may go back to its own idea of tracking at its next look at the mount."""
_COORDINATES = "EQUATORIAL_EOD_COORD"
_PARK = "TELESCOPE_PARK"
_TRACK_STATE = "TELESCOPE_TRACK_STATE"


@dataclass(frozen=True, slots=True, kw_only=True)
class IndiVector:
    """One property vector as the server sent it."""

    device: str
    name: str
    kind: str
    """Number, Switch, Text, Light or BLOB."""
    is_definition: bool
    state: str
    timestamp: str
    values: Mapping[str, str] = field(default_factory=dict)


class IndiWire:
    """One TCP connection to an INDI server that is never sent BLOBs; not thread-safe."""

    def __init__(self, host: str, port: int, timeout_s: float = 5.0) -> None:
        """Connect. Raises InstrumentError when nobody listens there."""
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise InstrumentError(
                f"no INDI server answers at {host}:{port} ({error}): "
                f"start indiserver{indi_port_option(port)}"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._address = f"{host}:{port}"
        # Typeshed gives the events one type for every kind of parser.
        self._parser: Any = ET.XMLPullParser(events=("start", "end"))
        self._parser.feed(b"<indi>")
        self._root: ET.Element | None = None
        self._depth = 0
        self._waiting: list[IndiVector] = []
        self.last_message = ""
        """The latest words of any device."""
        self.deleted: list[tuple[str, str]] = []
        """Devices and properties that went away, for a reader to empty; name "": all."""

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def ask(self, device: str, name: str | None = None) -> None:
        """Ask for the definitions of a device's properties, or of one."""
        which = f" name={quoteattr(name)}" if name else ""
        self._send(f'<getProperties version="1.7" device={quoteattr(device)}{which}/>')

    def ask_all(self) -> None:
        """Ask for the definitions of all properties of all devices."""
        self._send('<getProperties version="1.7"/>')

    def new(self, kind: str, device: str, name: str, values: Mapping[str, str]) -> None:
        """Ask for new values: ``kind`` is Number, Switch or Text."""
        one = _MEMBER[kind]
        members = "".join(
            f"<{one} name={quoteattr(key)}>{escape(value)}</{one}>" for key, value in values.items()
        )
        vector = f"new{kind}Vector"
        self._send(
            f"<{vector} device={quoteattr(device)} name={quoteattr(name)}>{members}</{vector}>"
        )

    def wait(self, is_wanted: Callable[[IndiVector], bool], timeout_s: float) -> IndiVector | None:
        """The next vector that is wanted, None when none came in time; others are dropped.

        Raises InstrumentError when the server hangs up.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            while self._waiting:
                vector = self._waiting.pop(0)
                if is_wanted(vector):
                    return vector
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return None
            self._receive(left_s)

    def _send(self, text: str) -> None:
        try:
            self._socket.settimeout(5.0)
            self._socket.sendall(text.encode())
        except OSError as error:
            raise self._hung_up(error) from error

    def _receive(self, timeout_s: float) -> None:
        self._socket.settimeout(max(timeout_s, 1e-3))
        try:
            chunk = self._socket.recv(_READ_BYTES)
        except TimeoutError:
            return
        except OSError as error:
            raise self._hung_up(error) from error
        if not chunk:
            raise self._hung_up("connection closed")
        try:
            self._parser.feed(chunk)
            events = list(self._parser.read_events())
        except ET.ParseError as error:
            raise self._hung_up(error) from error
        for event, element in events:
            if event == "start":
                self._root = element if self._root is None else self._root
                self._depth += 1
                continue
            self._depth -= 1
            if self._depth == 1:
                self._take(element)
                # The stream is one element that never ends: what is read must not stay in it.
                assert self._root is not None
                self._root.remove(element)

    def _take(self, element: ET.Element) -> None:
        self.last_message = element.get("message") or self.last_message
        if element.tag == "delProperty":
            self.deleted.append((element.get("device", ""), element.get("name", "")))
            return
        verb, kind = element.tag[:3], element.tag[3:].removesuffix("Vector")
        if verb not in ("def", "set") or not element.tag.endswith("Vector") or kind == "BLOB":
            return
        values = {member.get("name", ""): (member.text or "").strip() for member in element}
        self._waiting.append(
            IndiVector(
                device=element.get("device", ""),
                name=element.get("name", ""),
                kind=kind,
                is_definition=verb == "def",
                state=element.get("state", ""),
                timestamp=element.get("timestamp", ""),
                values=values,
            )
        )

    def _hung_up(self, why: object) -> InstrumentError:
        return InstrumentError(
            f"the INDI server at {self._address} hung up ({why}): look at its log, start it again"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedStop:
    """Who hears of a STOP while it is under way, and may give it up."""

    on_ordered: Callable[[], None] = lambda: None
    """ABORT has been handed to the system for the server."""
    on_stands: Callable[[], None] = lambda: None
    is_over: Callable[[], bool] = lambda: False
    """True: the mount stands by another way, nothing more is to be sent to it."""


def stop_mount(
    host: str,
    port: int,
    device: str,
    timeout_s: float = 2.0,
    *,
    after_stop: AfterStop = "track",
    had_tracking: bool | None = None,
    watched: WatchedStop = WatchedStop(),
) -> StopResult:
    """Abort motion by a connection of its own and read back that it has ended.

    Sends ABORT at once, before anything is known of the mount, and again while it still moves;
    then tracking is turned on or off as ``after_stop`` says. ``had_tracking``: whether there was
    any to restore, where the caller knows better than the mount, which may have been aborted by
    another way meanwhile. Never raises: a server that cannot be reached is a result with
    ``stopped`` false.
    """
    begun_s = time.monotonic()
    result = StopResult(stopped=False, ms=0.0, path="indi")
    try:
        wire = IndiWire(host, port, timeout_s)
        try:
            stop = _WireStop(wire, device, watched)
            aborts = stop.abort(begun_s + timeout_s)
            if stop.stands:
                stood_ms = (time.monotonic() - begun_s) * 1e3
                watched.on_stands()
                result = replace(result, stopped=True, ms=stood_ms)
                is_tracking = stop.settle_tracking(after_stop, had_tracking)
                return replace(result, is_tracking=is_tracking)
            if not watched.is_over():
                still = f"the mount still moves after {aborts} aborts in {timeout_s:.1f} s"
                result = replace(result, detail=still if stop.vectors else _UNTOLD)
        finally:
            wire.close()
    except InstrumentError as error:
        if result.stopped:
            return result
        result = replace(result, detail=str(error))
    return replace(result, ms=(time.monotonic() - begun_s) * 1e3)


_UNTOLD = "the mount does not answer: look at its driver and its cable, and at the telescope"


class _WireStop:
    """One STOP by plain connection: what the mount said before and after."""

    def __init__(self, wire: IndiWire, device: str, watched: WatchedStop) -> None:
        self._wire, self._device, self._watched = wire, device, watched
        self.vectors: dict[str, IndiVector] = {}
        """The latest of each property."""
        self._first: dict[str, IndiVector] = {}
        self.stands = False

    def abort(self, deadline_s: float) -> int:
        """ABORT until the mount stands; how often it was sent. Sets ``stands``."""
        aborts = 0
        if self._watched.is_over():
            return 0
        # Answered in order: one line tells how the mount was before the first ABORT.
        for name in (_TRACK_STATE, _PARK, _COORDINATES):
            self._wire.ask(self._device, name)
        while time.monotonic() < deadline_s and not (self.stands or self._watched.is_over()):
            self._wire.new("Switch", self._device, "TELESCOPE_ABORT_MOTION", {"ABORT": "On"})
            aborts += 1
            if aborts == 1:
                self._watched.on_ordered()
            # Only an answer given after the order counts, so the state is asked for behind it.
            self._wire.ask(self._device, _COORDINATES)
            repeat_s = min(time.monotonic() + _REPEAT_ABORT_S, deadline_s)
            while not self.stands and (left_s := repeat_s - time.monotonic()) > 0:
                self._read_next(left_s)
        return aborts

    def settle_tracking(self, after_stop: AfterStop, had_tracking: bool | None) -> bool | None:
        """Turn tracking on or off as it is to be; whether it is then, None where untold."""
        was_parking = self._was_busy(_PARK)
        wanted = tracking_after_stop(
            after_stop,
            was_slewing=self._was_busy(_COORDINATES) and not was_parking,
            was_parking=was_parking,
            was_tracking=_is_on(self._first.get(_TRACK_STATE), "TRACK_ON"),
            is_parked=not was_parking and _is_on(self.vectors.get(_PARK), "PARK"),
        )
        if had_tracking and after_stop == "track":
            wanted = True
        if _TRACK_STATE not in self.vectors:
            return None
        if wanted is None or self._watched.is_over():
            return _is_on(self.vectors[_TRACK_STATE], "TRACK_ON")
        member = "TRACK_ON" if wanted else "TRACK_OFF"
        self._wire.new("Switch", self._device, _TRACK_STATE, {member: "On"})
        del self.vectors[_TRACK_STATE]
        self._wire.ask(self._device, _TRACK_STATE)
        self._await_tracking(member, time.monotonic() + _TRACKING_S)
        if self._was_busy(_COORDINATES):
            self._hold_tracking(member, time.monotonic() + _SETTLE_S)
            if not self._watched.is_over():
                # It may just have been said again.
                self._await_tracking(member, time.monotonic() + _TRACKING_S)
        tracking = self.vectors.get(_TRACK_STATE)
        return None if tracking is None else _is_on(tracking, "TRACK_ON")

    def _await_tracking(self, member: str, ends_s: float) -> None:
        while (left_s := ends_s - time.monotonic()) > 0:
            if _is_on(self.vectors.get(_TRACK_STATE), member):
                return
            self._read_next(left_s)

    def _hold_tracking(self, member: str, ends_s: float) -> None:
        """Say again what is wanted of tracking whenever the driver thinks otherwise."""
        before = self.vectors.get(_TRACK_STATE)
        while (left_s := ends_s - time.monotonic()) > 0 and not self._watched.is_over():
            self._read_next(min(left_s, _LOOK_S))
            now = self.vectors.get(_TRACK_STATE)
            if self._watched.is_over():
                return
            if now is not before and not _is_on(now, member):
                self._wire.new("Switch", self._device, _TRACK_STATE, {member: "On"})
            before = now

    def _read_next(self, timeout_s: float) -> None:
        vector = self._wire.wait(lambda each: each.device == self._device, timeout_s)
        if vector is None:
            return
        is_first = vector.name not in self._first
        self._first.setdefault(vector.name, vector)
        self.vectors[vector.name] = vector
        # The first word on the coordinates was asked for before the order.
        if vector.name == _COORDINATES and not is_first and vector.state != "Busy":
            self.stands = True

    def _was_busy(self, name: str) -> bool:
        return name in self._first and self._first[name].state == "Busy"


def _is_on(vector: IndiVector | None, member: str) -> bool:
    return vector is not None and vector.values.get(member) == "On"
