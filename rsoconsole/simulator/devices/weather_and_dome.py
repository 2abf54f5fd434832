"""The simulated weather station and dome as INDI devices that follow the night's schedules."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from indipydriver import Device

from rsoconsole.base import ConfigError
from rsoconsole.simulator.mount.indi_vectors import (
    connection_vector,
    driver_info,
    indi_timestamp,
    light_vector,
    requested_switch,
    switch_vector,
    text_vector,
    turn_on,
)

NS = 1_000_000_000
Schedule = Sequence[tuple[float, str]]
"""Schedule of a night in order: (seconds since the night's start, state as a word)."""
_GROUP = "Main Control"
_LIGHT = {"ok": "Ok", "warning": "Busy", "alert": "Alert"}
_DOME_WORDS = ("open", "closed", "moving")


class WeatherDevice:
    """Weather station: WEATHER_STATUS follows a schedule, and clients set it by SIM_WEATHER."""

    def __init__(
        self, name: str, schedule: Schedule, t_start_utc_ns: int, now_utc_ns: Callable[[], int]
    ) -> None:
        self._now_utc_ns = now_utc_ns
        self._changes = _changes(schedule, t_start_utc_ns, tuple(_LIGHT), "weather")
        self._status = light_vector(
            "WEATHER_STATUS", _GROUP, {"WEATHER_WIND_SPEED": "Ok", "WEATHER_RAIN_HOUR": "Ok"}
        )
        self._options = text_vector("SIM_WEATHER", "Options", {"STATE": "ok"}, perm="rw")
        others = (self._options, driver_info(name, 128))
        self.device = Device(name, [connection_vector(), self._status, *others])

    async def handle(self, event: Any) -> None:
        """Apply a client's request, which holds until the next change of the schedule."""
        word = event.get("STATE", "").strip() if event.vectorname == "SIM_WEATHER" else ""
        if word in _LIGHT:
            self._options["STATE"] = word
            await self._publish(word, self._now_utc_ns())
        await event.vector.send_setVector(timestamp=indi_timestamp(self._now_utc_ns()), state="Ok")

    async def pass_time(self) -> None:
        """Report to clients every scheduled change of the weather that is due."""
        for t_utc_ns, word in _due(self._changes, self._now_utc_ns()):
            await self._publish(word, t_utc_ns)

    async def _publish(self, word: str, t_utc_ns: int) -> None:
        # The wind alone makes the weather here.
        self._status["WEATHER_WIND_SPEED"] = _LIGHT[word]
        await self._status.send_setVector(timestamp=indi_timestamp(t_utc_ns), state=_LIGHT[word])


class DomeDevice:
    """Dome: DOME_SHUTTER follows a schedule, and clients open or close it at once."""

    def __init__(
        self, name: str, schedule: Schedule, t_start_utc_ns: int, now_utc_ns: Callable[[], int]
    ) -> None:
        self._now_utc_ns = now_utc_ns
        self._changes = _changes(schedule, t_start_utc_ns, _DOME_WORDS, "dome")
        self._shutter = switch_vector(
            "DOME_SHUTTER", _GROUP, ("SHUTTER_OPEN", "SHUTTER_CLOSE"), "SHUTTER_OPEN"
        )
        self._park = switch_vector("DOME_PARK", _GROUP, ("PARK", "UNPARK"), "UNPARK")
        self.device = Device(
            name, [connection_vector(), self._shutter, self._park, driver_info(name, 32)]
        )

    async def handle(self, event: Any) -> None:
        """Apply a client's request, which holds until the next change of the schedule."""
        asked = (
            requested_switch(event) if event.vectorname in ("DOME_SHUTTER", "DOME_PARK") else None
        )
        if asked is not None:
            turn_on(event.vector, asked)
        await event.vector.send_setVector(timestamp=indi_timestamp(self._now_utc_ns()), state="Ok")

    async def pass_time(self) -> None:
        """Report to clients every scheduled change of the dome that is due."""
        for t_utc_ns, word in _due(self._changes, self._now_utc_ns()):
            if word != "moving":
                turn_on(self._shutter, "SHUTTER_OPEN" if word == "open" else "SHUTTER_CLOSE")
            await self._shutter.send_setVector(
                timestamp=indi_timestamp(t_utc_ns), state="Busy" if word == "moving" else "Ok"
            )


def _changes(
    schedule: Schedule, t_start_utc_ns: int, words: Iterable[str], what: str
) -> list[tuple[int, str]]:
    """The schedule by instants, in order. Raises ConfigError for a word that is none."""
    known = tuple(words)
    for _, word in schedule:
        if word not in known:
            raise ConfigError(f"the {what} is {', '.join(known)}; not '{word}'")
    return sorted((t_start_utc_ns + round(seconds * NS), word) for seconds, word in schedule)


def _due(changes: list[tuple[int, str]], now_utc_ns: int) -> list[tuple[int, str]]:
    """Changes that are due, taken off the list."""
    due = [change for change in changes if change[0] <= now_utc_ns]
    del changes[: len(due)]
    return due
