"""The machine's own state: read from the kernel's files, said once when it changes."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest

from rsoconsole.config import Config
from rsoconsole.control import Machine, Status, read_status, status_json
from rsoconsole.engine import read_machine, read_recording_medium, troubles_of
from rsoconsole.engine.doctor import checks as doctor_machine
from rsoconsole.engine.machine import machine
from rsoconsole.engine.machine.machine import Trouble
from rsoconsole.engine.machine.medium import RecordingMedium
from rsoconsole.engine.machine.time_source import TimeSource, read_time_source
from rsoconsole.engine.service import machine_watch
from rsoconsole.engine.service.machine_watch import QUIET_LOOKS, MachineWatch, TroubleTracker
from tests.rigs.pi_files import make_it_emmc, pi_files, put

NO_TIME = TimeSource(kind="unknown", detail="this system does not tell", rtc=None)


def test_a_pi_tells_its_model_heat_frequency_and_supply(tmp_path):
    reading = read_machine(pi_files(tmp_path))
    assert reading == Machine(
        model="Raspberry Pi 4 Model B Rev 1.4",
        cpu_temperature_c=51.6,
        cpu_frequency_mhz=1500.0,
        cpu_frequency_max_mhz=1800.0,
        is_under_voltage=False,
        is_throttled=False,
        has_been_under_voltage=False,
        has_been_throttled=False,
    )
    assert reading.is_pi
    assert troubles_of(reading) == ()


@pytest.mark.parametrize(
    ("word", "now", "before"),
    [
        ("0", (False, False), (False, False)),
        ("1", (True, False), (False, False)),
        ("2", (False, True), (False, False)),
        ("4", (False, True), (False, False)),
        ("8", (False, True), (False, False)),
        ("50005", (True, True), (True, True)),
        ("10000", (False, False), (True, False)),
        ("e0000", (False, False), (False, True)),
        ("throttled=0x20000", (False, False), (False, True)),
    ],
)
def test_each_bit_of_the_firmwares_word_has_its_meaning(tmp_path, word, now, before):
    reading = read_machine(pi_files(tmp_path, throttled=word, alarm=None))
    assert (reading.is_under_voltage, reading.is_throttled) == now
    assert (reading.has_been_under_voltage, reading.has_been_throttled) == before


def test_the_hardware_monitor_is_enough_to_know_of_a_weak_supply(tmp_path):
    reading = read_machine(pi_files(tmp_path, throttled=None, alarm="1"))
    assert reading.is_under_voltage is True
    assert reading.is_throttled is None
    assert [each.name for each in troubles_of(reading)] == ["power"]


@pytest.mark.parametrize("word", ["", "nonsense", "0x"])
def test_a_word_that_is_none_is_not_told(tmp_path, word):
    assert read_machine(pi_files(tmp_path, throttled=word)).is_throttled is None


def test_a_machine_without_such_files_tells_nothing_and_is_not_called_a_pi(tmp_path):
    reading = read_machine(tmp_path)
    assert reading == Machine()
    assert not reading.is_pi
    assert troubles_of(reading) == ()
    for check in (doctor_machine.check_power(reading), doctor_machine.check_temperature(reading)):
        assert check.ok is True
        assert "does not tell it" in check.detail
    assert "not a Raspberry Pi" in doctor_machine.check_power(reading).detail


def test_the_processors_zone_counts_before_others(tmp_path):
    for number, (kind, heat) in enumerate([("wifi", "91000"), ("cpu-thermal", "48000")]):
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/type", kind)
        put(tmp_path, f"sys/class/thermal/thermal_zone{number}/temp", heat)
    put(tmp_path, "sys/class/thermal/thermal_zone2/type", "soc")
    put(tmp_path, "sys/class/thermal/thermal_zone2/temp", "-274000")
    assert read_machine(tmp_path).cpu_temperature_c == 48.0


def test_a_pi_is_hot_where_other_machines_are_not():
    pi = Machine(model="Raspberry Pi 5 Model B Rev 1.0", cpu_temperature_c=82.0)
    pc = Machine(cpu_temperature_c=82.0)
    assert [each.name for each in troubles_of(pi)] == ["hot"]
    assert troubles_of(pc) == ()


def test_the_firmwares_own_program_is_asked_before_the_file_that_complains(tmp_path, monkeypatch):
    asked: list[tuple[str, ...]] = []

    def answer(words: tuple[str, ...]) -> str:
        asked.append(words)
        return "throttled=0x50005\n"

    monkeypatch.setattr(machine, "run_program", answer)
    assert read_machine(Path("/")).is_throttled is True
    assert asked == [("vcgencmd", "get_throttled")]


@pytest.mark.parametrize(
    ("folder", "kind", "device"),
    [
        ("/home/pi/sessions", "SD card", "mmcblk0"),
        ("/mnt/usb disk/nights", "USB disk", "sda"),
        ("/mnt/pool/nights", "NVMe disk", "nvme0n1"),
        ("/mnt/nas", "network share", ""),
        ("/mnt/sealed/x", "USB disk", "sda"),
        ("/run/x", "memory", ""),
    ],
)
def test_a_folders_medium_is_that_of_its_mount(tmp_path, folder, kind, device):
    medium = read_recording_medium(Path(folder), pi_files(tmp_path))
    assert (medium.kind, medium.device) == (kind, device)


def test_an_emmc_tells_how_worn_it_is(tmp_path):
    make_it_emmc(pi_files(tmp_path), "0x02 0x09")
    medium = read_recording_medium(Path("/home"), tmp_path)
    assert (medium.kind, medium.life_used_percent) == ("eMMC", 90)
    check = doctor_machine.check_recording_medium(Config(), medium)
    assert check.ok is False
    assert "90 % of its life used" in check.detail


def test_a_folder_on_this_machine_lies_on_something():
    assert isinstance(read_recording_medium(Path.home()), RecordingMedium)


def test_a_card_is_advised_against_with_the_nights_megabytes(tmp_path):
    config = Config.model_validate({"session": {"root": str(tmp_path)}})
    check = doctor_machine.check_recording_medium(
        config, RecordingMedium(kind="SD card", device="mmcblk0")
    )
    assert check.ok is None
    assert check.detail.startswith("SD card mmcblk0, a night writes up to ")
    megabytes = float(check.detail.split("up to ")[1].split(" MB")[0])
    ten_frames_mb = 10 * 0.52 * 2 * 4656 * 3520 / 1e6
    assert megabytes > ten_frames_mb
    assert "USB disk" in check.remedy
    assert (
        doctor_machine.check_recording_medium(config, RecordingMedium(kind="USB disk")).ok is True
    )
    assert doctor_machine.check_recording_medium(config, RecordingMedium(kind="memory")).ok is False


CHRONY = (
    "{refid},{name},{stratum},1700000000.1,0.000012,0.00001,0.00002,"
    "-1.2,0.001,0.03,0.02,0.001,64.2,{leap}"
)


def chrony(name: str, stratum: int, leap: str = "Normal", refid: str = "C0A80101") -> str:
    return CHRONY.format(refid=refid, name=name, stratum=stratum, leap=leap) + "\n"


@pytest.mark.parametrize(
    ("answers", "kind", "words"),
    [
        ({"chronyc": chrony("PPS", 1)}, "GPS", "PPS"),
        ({"chronyc": chrony("ntp1.example.org", 3)}, "NTP", "ntp1.example.org, stratum 3"),
        ({"chronyc": chrony("", 1)}, "NTP", "C0A80101"),
        ({"chronyc": chrony("", 0, "Not synchronised", "00000000")}, "none", "reaches no source"),
        (
            {
                "timedatectl show": "NTP=yes\nNTPSynchronized=yes\n",
                "timedatectl show-timesync": "ServerName=0.debian.pool.ntp.org\n",
            },
            "NTP",
            "0.debian.pool.ntp.org",
        ),
        ({"timedatectl show": "NTP=no\nNTPSynchronized=yes\n"}, "NTP", "a time service"),
        ({"timedatectl show": "NTP=yes\nNTPSynchronized=no\n"}, "none", "not reached"),
        ({"timedatectl show": "NTP=no\nNTPSynchronized=no\n"}, "none", "no time service"),
        ({"chronyc": "506 Cannot talk to daemon\n"}, "unknown", "does not tell"),
        ({}, "unknown", "does not tell"),
    ],
)
def test_the_source_of_time_is_what_the_system_says(tmp_path, answers, kind, words):
    def ask(command: Sequence[str]) -> str | None:
        return answers.get(" ".join(command), answers.get(command[0]))

    source = read_time_source(ask, tmp_path)
    assert source.kind == kind
    assert words in source.detail
    assert source.rtc is None
    check = doctor_machine.check_time_source(source)
    assert check.ok is (True if kind in {"GPS", "NTP"} else None)
    assert "no real-time clock" in check.detail
    put(tmp_path, "sys/class/rtc/rtc0/name", "rpi-rtc")
    assert read_time_source(ask, tmp_path).rtc == "rpi-rtc"


def test_what_is_wrong_with_the_supply_is_checked_with_its_remedy(tmp_path):
    weak = read_machine(pi_files(tmp_path / "a", throttled="50005"))
    check = doctor_machine.check_power(weak)
    assert check.ok is False
    assert check.detail.startswith("under-voltage: ")
    assert "throttled: " in check.detail
    assert "supply" in check.remedy
    was = doctor_machine.check_power(read_machine(pi_files(tmp_path / "b", throttled="50000")))
    assert was.ok is None
    assert "before" in was.detail
    well = doctor_machine.check_power(read_machine(pi_files(tmp_path / "c")))
    assert (well.ok, well.remedy) == (True, "")
    hot = read_machine(pi_files(tmp_path / "d", temperature_c=84.2, throttled="8"))
    assert doctor_machine.check_temperature(hot).ok is False
    assert "fan" in doctor_machine.check_power(hot).remedy


POWER = Trouble(name="power", words="under-voltage: too little", remedy="another supply")


def test_a_trouble_is_said_when_it_begins_and_when_it_is_over_and_not_between():
    troubles = TroubleTracker()
    said = [troubles.step((POWER,)) for _ in range(5)]
    assert said == [[("alarm", "machine: under-voltage: too little: another supply")], *[[]] * 4]
    for _ in range(QUIET_LOOKS - 1):
        assert troubles.step(()) == []
        assert troubles.present_troubles == (POWER,)
    assert troubles.step((POWER,)) == []
    assert [troubles.step(()) for _ in range(QUIET_LOOKS)][-1] == [
        ("info", "machine: no longer under-voltage")
    ]
    assert troubles.present_troubles == ()
    assert len(troubles.step((POWER,))) == 1


def test_the_watch_reads_says_and_keeps_what_it_saw(tmp_path, monkeypatch):
    files = pi_files(tmp_path, throttled="50005")
    monkeypatch.setattr(machine_watch, "read_machine", partial(machine.read_machine, files))
    monkeypatch.setattr(
        machine_watch, "read_recording_medium", partial(read_recording_medium, root=files)
    )
    monkeypatch.setattr(machine_watch, "read_time_source", lambda: NO_TIME)
    said: list[tuple[str, str]] = []
    watch = MachineWatch(Path("/mnt/usb disk"), lambda level, text: said.append((level, text)))
    assert watch.state is None
    watch.look()
    watch.look()
    assert [level for level, _ in said] == ["alarm", "alarm"]
    assert said[0][1].startswith("machine: under-voltage")
    assert said[1][1].startswith("machine: throttled")
    assert watch.state is not None
    status = watch.state.as_status()
    told = json.loads(json.dumps(status_json(Status(machine=status))))
    assert read_status(told).machine == status
    assert told["machine"]["cpu_temperature_c"] == 51.6
    assert told["machine"]["recording_medium"] == "USB disk"
    assert status.is_under_voltage is True
    assert status.is_throttled is True
    assert status.time_source == "unknown"
    assert len(status.troubles) == 2


def test_a_reading_that_breaks_is_no_end_of_the_looking(tmp_path, monkeypatch):
    said: list[str] = []
    watch = MachineWatch(tmp_path, lambda _, text: said.append(text))
    monkeypatch.setattr(machine_watch, "read_machine", lambda: 1 / 0)
    watch._look()
    assert watch.state is None
    assert said == []
