"""Protocols of mount and camera: INDI, or that of an installed package.

A package brings a protocol as an entry point of group ``rsoconsole.mounts`` or
``rsoconsole.cameras``: a callable that accepts a ``ProtocolContext`` and returns an object with the
methods of ``MountPort`` or ``CameraPort`` (``instruments/ports.py``). Its settings are
``[instruments.options]``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments.camera.camera import IndiCamera
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.instruments.ports import CameraPort, MountPort

MOUNTS, CAMERAS = "rsoconsole.mounts", "rsoconsole.cameras"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtocolContext:
    """The configuration and the log folder, for the factory of a protocol."""

    config: Config
    log_dir: Path
    """Folder for a library's output in a process of its own."""


def create_mount(context: ProtocolContext) -> MountPort:
    """The configured mount, not yet connected.

    Raises InstrumentError where no such protocol is installed or its package cannot be loaded.
    """
    name = context.config.instruments.mount
    if name == "indi":
        config = context.config
        return IndiMount(config.indi, context.log_dir / "mount.log", config.mount, config.waits)
    mount: MountPort = _factory(MOUNTS, "mount", name)(context)
    return mount


def create_camera(context: ProtocolContext) -> CameraPort:
    """The configured camera, not yet connected.

    Raises InstrumentError where no such protocol is installed or its package cannot be loaded.
    """
    name = context.config.instruments.camera
    if name == "indi":
        config, log_file = context.config, context.log_dir / "camera.log"
        return IndiCamera(config.indi, config.optics, log_file, config.waits)
    camera: CameraPort = _factory(CAMERAS, "camera", name)(context)
    return camera


def missing_protocol(config: Config) -> str | None:
    """Fault of a configured protocol's name, in words; None where both are installed."""
    named = (
        ("mount", MOUNTS, config.instruments.mount),
        ("camera", CAMERAS, config.instruments.camera),
    )
    for kind, group, name in named:
        if name != "indi":
            try:
                _factory(group, kind, name)
            except InstrumentError as error:
                return str(error)
    return None


def _factory(group: str, kind: str, name: str) -> Callable[[ProtocolContext], Any]:
    found = entry_points(group=group)
    for each in found:
        if each.name == name:
            try:
                factory: Callable[[ProtocolContext], Any] = each.load()
            except Exception as error:  # a vendor's library may fail in any way
                raise InstrumentError(
                    f"the {kind} protocol {name!r} of {each.value} cannot be loaded: {error}"
                ) from error
            return factory
    known = ", ".join(sorted({"indi", *(each.name for each in found)}))
    raise InstrumentError(
        f"no {kind} protocol {name!r} is installed (there is: {known}): install the package that"
        f" brings it, or set instruments.{kind}"
    )
