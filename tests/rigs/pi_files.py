"""A Raspberry Pi's own files, as its kernel shows them, in a folder of a test's."""

from pathlib import Path

MOUNTS = """\
24 1 179:2 / / rw,noatime shared:1 - ext4 /dev/mmcblk0p2 rw
30 24 0:26 / /run rw,nosuid - tmpfs tmpfs rw,size=380000k
41 24 8:1 / /mnt/usb\\040disk rw - ext4 /dev/sda1 rw
42 24 0:45 / /mnt/pool rw - btrfs /dev/nvme0n1p1 rw
43 24 0:46 / /mnt/nas rw - nfs4 nas:/nights rw
44 24 253:0 / /mnt/sealed rw - ext4 /dev/mapper/sealed rw
"""
_SD = "platform/emmc2bus/fe340000.mmc/mmc_host/mmc0/mmc0:aaaa/block/mmcblk0"
_USB = "platform/scb/fd500000.pcie/pci0000:00/usb2/2-1/2-1:1.0/host0/target0:0:0/0:0:0:0/block/sda"
_NVME = "platform/axi/1000110000.pcie/pci0001:00/0001:01:00.0/nvme/nvme0/nvme0n1"


def pi_files(
    root: Path,
    *,
    temperature_c: float = 51.6,
    throttled: str | None = "0",
    alarm: str | None = "0",
    model: str = "Raspberry Pi 4 Model B Rev 1.4",
) -> Path:
    """The tree of a Pi 4 with an SD card, a USB disk and an encrypted one on it."""
    put(root, "proc/device-tree/model", f"{model}\0")
    put(root, "proc/self/mountinfo", MOUNTS)
    put(root, "sys/class/thermal/thermal_zone0/type", "cpu-thermal")
    put(root, "sys/class/thermal/thermal_zone0/temp", str(round(temperature_c * 1000)))
    put(root, "sys/class/hwmon/hwmon0/name", "cpu_thermal")
    put(root, "sys/class/hwmon/hwmon1/name", "rpi_volt")
    if alarm is not None:
        put(root, "sys/class/hwmon/hwmon1/in0_lcrit_alarm", alarm)
    if throttled is not None:
        put(root, "sys/devices/platform/soc/soc:firmware/get_throttled", throttled)
    put(root, "sys/devices/system/cpu/cpu0/cpufreq/scaling_cur_freq", "1500000")
    put(root, "sys/devices/system/cpu/cpu0/cpufreq/cpuinfo_max_freq", "1800000")
    for number, disk, partition in (
        ("179:2", _SD, "mmcblk0p2"),
        ("8:1", _USB, "sda1"),
        ("259:1", _NVME, "nvme0n1p1"),
    ):
        put(root, f"sys/devices/{disk}/{partition}/partition", "1")
        link(root, f"sys/dev/block/{number}", f"sys/devices/{disk}/{partition}")
        link(root, f"sys/class/block/{partition}", f"sys/devices/{disk}/{partition}")
    put(root, f"sys/devices/{_SD}/device/type", "SD")
    link(root, "sys/dev/block/253:0", "sys/devices/virtual/block/dm-0")
    link(root, "sys/devices/virtual/block/dm-0/slaves/sda1", f"sys/devices/{_USB}/sda1")
    return root


def make_it_emmc(root: Path, life_time: str) -> None:
    """A Compute Module has eMMC where others have the card."""
    put(root, f"sys/devices/{_SD}/device/type", "MMC")
    put(root, f"sys/devices/{_SD}/device/life_time", life_time)


def put(root: Path, place: str, text: str) -> None:
    """One of the kernel's files."""
    path = root / place
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n", encoding="utf-8")


def link(root: Path, place: str, to: str) -> None:
    """One of the kernel's links."""
    path = root / place
    path.parent.mkdir(parents=True, exist_ok=True)
    (root / to).mkdir(parents=True, exist_ok=True)
    path.symlink_to(root / to)
