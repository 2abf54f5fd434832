"""The machine's name and kind, as it states them itself."""

import os
import platform
import sys
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.engine.machine.machine import ROOT, board_model, parse_name_values, text_of
from rsoconsole.vision import available_cores

_ARM = {"aarch64", "arm64", "armv7l", "armv8l", "armv6l"}


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineIdentity:
    """Name, processor and system of the machine on which figures were measured."""

    model: str
    """Board's name from the device tree, else the processor's name."""
    cores: int
    """Number of cores that this process may use."""
    architecture: str
    python: str
    system: str
    is_emulated: bool
    """True where another machine emulates the processor; False also where that is not known."""

    @property
    def words(self) -> str:
        """The machine's name, processor and system in one line."""
        cores = f"{self.cores} core{'s' if self.cores > 1 else ''}"
        emulated = " (EMULATED: not the speed of a real one)" if self.is_emulated else ""
        return (
            f"{self.model}{emulated}, {cores}, {self.architecture}, "
            f"Python {self.python}, {self.system}"
        )


def machine_identity(root: Path = ROOT, architecture: str | None = None) -> MachineIdentity:
    """Return this machine's identity; tests replace ``root`` and ``architecture``."""
    kind = platform.machine() if architecture is None else architecture
    cpu = parse_name_values(text_of(root / "proc/cpuinfo"), ":")
    board = board_model(root)
    return MachineIdentity(
        model=board or cpu.get("Model") or cpu.get("model name") or f"unnamed {kind} processor",
        cores=available_cores(),
        architecture=kind,
        python=".".join(str(part) for part in sys.version_info[:3]),
        system=_system(root),
        is_emulated=_is_emulated(kind, cpu, root),
    )


def load_share() -> float:
    """Return the load of the last minute: running and waiting processes per core."""
    return os.getloadavg()[0] / available_cores()


def _system(root: Path) -> str:
    name = parse_name_values(text_of(root / "etc/os-release"), "=").get("PRETTY_NAME")
    return name.strip('"') if name else f"{platform.system()} {platform.release()}"


def _is_emulated(architecture: str, cpu: dict[str, str], root: Path) -> bool:
    """True with signs of QEMU: a PC's processor under an ARM program, or QEMU's own."""
    if architecture not in _ARM:
        return cpu.get("model name", "").startswith("QEMU Virtual CPU")
    is_pc = "vendor_id" in cpu or "cpu family" in cpu
    is_qemus_own = cpu.get("CPU implementer") in {"0x00", "0x0"}
    handler = text_of(root / f"proc/sys/fs/binfmt_misc/qemu-{architecture}") or ""
    return is_pc or is_qemus_own or handler.startswith("enabled")
