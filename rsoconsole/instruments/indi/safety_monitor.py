"""Watches weather and dome through a plain INDI connection, on a thread of its own."""

import threading
import time
from typing import Literal

from rsoconsole.base import InstrumentError, LongWait
from rsoconsole.config import IndiConfig, WaitsConfig
from rsoconsole.instruments.indi.indi_wire import IndiVector, IndiWire
from rsoconsole.instruments.ports import SkyReport

Weather = Literal["ok", "warning", "alert", "silent"]
Dome = Literal["open", "closed", "moving", "silent"]

SILENCE_S = 60.0
_ASK_EVERY_S = 15.0
_POLL_S = 0.5
_CONNECT_S = 2.0
_LOOK_S = 0.5
_WEATHER: dict[str, Weather] = {"Ok": "ok", "Busy": "warning", "Alert": "alert"}


class IndiSafetyMonitor:
    """Monitor of the configured weather station and the configured dome.

    A device counts as silent when it has never reported its state, when the server has removed it,
    or when it has reported nothing for a minute in spite of four requests.
    """

    def __init__(
        self,
        config: IndiConfig,
        *,
        silence_s: float = SILENCE_S,
        first_word_s: float = WaitsConfig().quiet_s,
    ) -> None:
        """``start`` begins to watch; this only describes the devices.

        ``silence_s``: time without a report after which a device counts as silent.
        ``first_word_s``: longest wait of ``start`` for the first reports.
        """
        self._first_word_s = first_word_s
        self._config, self._silence_s = config, silence_s
        self._ask_every_s = min(_ASK_EVERY_S, silence_s / 4)
        self._vectors: dict[tuple[str, str], IndiVector] = {}
        self._received_s: dict[str, float] = {}
        self._trouble = ""
        self._changed = threading.Condition()
        self._is_over = threading.Event()
        self._devices = tuple(name for name in (config.weather, config.dome) if name)
        self._thread = threading.Thread(target=self._run, daemon=True, name="safety monitor")

    def start(self) -> None:
        """Start the monitor; wait a limited time for the first report of every device."""
        self._thread.start()
        wait = LongWait(f"a first word of {' and '.join(self._devices)}")
        with self._changed:
            while self._is_any_silent() and wait.waited_s < self._first_word_s:
                wait.log_if_due()
                self._changed.wait(_LOOK_S)

    def look(self) -> SkyReport:
        """Return the latest report, at once; never raises."""
        with self._changed:
            weather = dome = None
            details = []
            if self._config.weather:
                weather, words = self._weather(self._config.weather)
                details.append(words)
            if self._config.dome:
                dome, words = self._dome(self._config.dome)
                details.append(words)
            return SkyReport(
                weather=weather, dome=dome, detail="; ".join(words for words in details if words)
            )

    def close(self) -> None:
        """Close the connection."""
        self._is_over.set()
        if self._thread.is_alive():
            self._thread.join(_CONNECT_S + _POLL_S)

    def _is_any_silent(self) -> bool:
        now = self.look()
        return "silent" in (now.weather, now.dome)

    def _weather(self, device: str) -> tuple[Weather, str]:
        why_silent = self._why_silent(device)
        status = self._vectors.get((device, "WEATHER_STATUS"))
        if why_silent or status is None:
            return "silent", why_silent or f"{device} does not offer WEATHER_STATUS"
        if status.state not in _WEATHER:
            return "silent", f"{device} has not judged the weather yet"
        bad = [f"{key} {_WEATHER[v]}" for key, v in status.values.items() if v in ("Busy", "Alert")]
        return _WEATHER[status.state], f"{device}: {', '.join(bad)}" if bad else ""

    def _dome(self, device: str) -> tuple[Dome, str]:
        why_silent = self._why_silent(device)
        if why_silent:
            return "silent", why_silent
        # A roll-off roof has no shutter: it parks closed.
        for name, is_open in (("DOME_SHUTTER", "SHUTTER_OPEN"), ("DOME_PARK", "UNPARK")):
            vector = self._vectors.get((device, name))
            if vector is None:
                continue
            if vector.state == "Busy":
                return "moving", ""
            on = [key for key, value in vector.values.items() if value == "On"]
            if vector.state == "Alert" or len(on) != 1:
                return "silent", f"{device} does not know how its {name} stands"
            return ("open" if on[0] == is_open else "closed"), ""
        return "silent", f"{device} offers neither DOME_SHUTTER nor DOME_PARK"

    def _why_silent(self, device: str) -> str:
        """Reason why a device is silent; empty where it has reported lately."""
        received_s = self._received_s.get(device)
        where = f"the INDI server at {self._config.host}:{self._config.port}"
        if received_s is None:
            return self._trouble or f"{where} has announced no device '{device}' yet"
        connection = self._vectors.get((device, "CONNECTION"))
        if connection is not None and connection.values.get("CONNECT") != "On":
            return f"{device} is there but not connected"
        age_s = time.monotonic() - received_s
        if age_s > self._silence_s:
            return self._trouble or f"{device} has said nothing for {age_s:.0f} s"
        return ""

    def _run(self) -> None:
        while not self._is_over.is_set():
            try:
                wire = IndiWire(self._config.host, self._config.port, _CONNECT_S)
            except InstrumentError as error:
                self._note(str(error))
                self._is_over.wait(_CONNECT_S)
                continue
            try:
                self._listen(wire)
            except InstrumentError as error:
                self._note(str(error))
            finally:
                wire.close()
            self._is_over.wait(_POLL_S)

    def _listen(self, wire: IndiWire) -> None:
        """Read one connection to its end. Raises InstrumentError when the server hangs up."""
        self._note("")
        next_ask_s = time.monotonic()
        asked_to_connect: set[str] = set()
        while not self._is_over.is_set():
            if time.monotonic() >= next_ask_s:
                next_ask_s = time.monotonic() + self._ask_every_s
                for device in self._devices:
                    # Of all its properties: some drivers answer nothing else.
                    wire.ask(device)
            vector = wire.wait(lambda each: each.device in self._devices, _POLL_S)
            self._forget(wire)
            if vector is None:
                continue
            with self._changed:
                self._vectors[vector.device, vector.name] = vector
                self._received_s[vector.device] = time.monotonic()
                self._changed.notify_all()
            is_off = vector.name == "CONNECTION" and vector.values.get("CONNECT") == "Off"
            if is_off and vector.state != "Busy" and vector.device not in asked_to_connect:
                asked_to_connect.add(vector.device)
                wire.new("Switch", vector.device, "CONNECTION", {"CONNECT": "On"})

    def _forget(self, wire: IndiWire) -> None:
        """Remove the reports of a device that the server removed."""
        while wire.deleted:
            device, name = wire.deleted.pop(0)
            with self._changed:
                if name:
                    self._vectors.pop((device, name), None)
                    continue
                self._received_s.pop(device, None)
                for key in [key for key in self._vectors if key[0] == device]:
                    del self._vectors[key]

    def _note(self, trouble: str) -> None:
        with self._changed:
            self._trouble = trouble
