"""The engine's status in Prometheus' format, for node_exporter's textfile collector.

Source: Prometheus' text exposition format 0.0.4. The text is printed or written to a file.
"""

from collections.abc import Iterator

from rsoconsole.control import Status

STATES = ("IDLE", "SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST", "MANUAL", "FAULT")
Sample = tuple[dict[str, str], float]


def metrics_text(status: Status | None) -> str:
    """Metrics of an engine's status as text; ``status`` None: no engine runs."""
    lines: list[str] = []
    for name, words, samples in _families(status):
        if not samples:
            continue
        lines += [f"# HELP rsoconsole_{name} {words}", f"# TYPE rsoconsole_{name} gauge"]
        lines += [f"rsoconsole_{name}{_labels(labels)} {value:.17g}" for labels, value in samples]
    return "\n".join(lines) + "\n"


def _families(status: Status | None) -> Iterator[tuple[str, str, list[Sample]]]:
    yield "up", "Whether an engine answers.", [({}, 0.0 if status is None else 1.0)]
    if status is None:
        return
    states: list[Sample] = [({"state": each}, float(each == status.state)) for each in STATES]
    yield "state", "1 for the state the loop is in.", states
    yield "frames", "Exposures begun in this session.", _known(status.frame_id)
    yield "tracks", "Tracks that are followed.", [({}, float(len(status.tracks)))]
    yield "faults", "Faults that last.", [({}, float(len(status.faults)))]
    yield "slewing", "Whether the mount slews.", _known(status.is_slewing)
    yield "tracking", "Whether the mount tracks.", _known(status.is_tracking)
    yield "parked", "Whether the mount is parked.", _known(status.is_parked)
    yield "target_altitude_degrees", "Of what is followed.", _known(status.alt_deg)
    yield "target_azimuth_degrees", "Of what is followed.", _known(status.az_deg)
    yield "mount_altitude_degrees", "Where the mount looks.", _known(status.mount_alt_deg)
    yield "mount_azimuth_degrees", "Where the mount looks.", _known(status.mount_az_deg)
    now_s = None if status.now_utc_ns is None else status.now_utc_ns / 1e9
    yield "clock_seconds", "The engine's clock, since 1970.", _known(now_s)
    well: list[Sample] = [({"part": each.name}, float(each.ok)) for each in status.health]
    yield "health_ok", "1 where a part of machine or instruments is well.", well
    yield from _of_machine(status)
    limiting = _known(status.limiting_mag)
    yield "limiting_magnitude", "Of a star with an SNR of 5 in the last frame.", limiting
    yield (
        "zero_point_magnitude",
        "Gives 1 ADU a second in the last frame.",
        _known(status.zero_point_mag),
    )
    in_v: list[Sample] = [
        ({"track": str(each.track_id)}, each.mag)
        for each in status.tracks
        if each.mag is not None and each.band == "V"
    ]
    yield "track_magnitude", "Apparent magnitude of the last streak, V.", in_v
    last = {each.track_id: each.nis for each in status.tracks if each.nis is not None}
    nis: list[Sample] = [({"track": str(number)}, value) for number, value in last.items()]
    yield "track_nis", "Normalised innovation squared of the last frame.", nis


def _of_machine(status: Status) -> Iterator[tuple[str, str, list[Sample]]]:
    machine = status.machine
    if machine is None:
        return
    yield "cpu_temperature_celsius", "Of the processor.", _known(machine.cpu_temperature_c)
    yield "under_voltage", "Whether the supply is too weak.", _known(machine.is_under_voltage)
    yield "throttled", "Whether the processor is slowed down.", _known(machine.is_throttled)
    troubles = _known(len(machine.troubles))
    yield "machine_troubles", "Things not well with the machine.", troubles


def _known(value: float | bool | None) -> list[Sample]:
    return [] if value is None else [({}, float(value))]


def _labels(labels: dict[str, str]) -> str:
    if not labels:
        return ""
    escaped = {
        key: value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
        for key, value in labels.items()
    }
    return "{" + ",".join(f'{key}="{value}"' for key, value in escaped.items()) + "}"
