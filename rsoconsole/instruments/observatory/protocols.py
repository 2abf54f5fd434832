"""Protocols of mount and camera: INDI, or the protocol of an installed package.

A package adds a protocol by an entry point of group ``rsoconsole.mounts`` or
``rsoconsole.cameras``: a callable that takes a ``ProtocolContext`` and returns an object with the
methods of ``MountPort`` or ``CameraPort`` (``instruments/ports.py``). Its settings are in
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
    """Argument of a protocol's factory: the configuration and the log folder."""

    config: Config
    log_dir: Path
    """Folder for what the processes of a protocol print."""


def create_mount(context: ProtocolContext) -> MountPort:
    """Make the configured mount, not yet connected.

    Raises InstrumentError where its protocol is not installed or the package cannot be loaded.
    """
    name = context.config.instruments.mount
    if name == "indi":
        config, log_file = context.config, context.log_dir / "mount.log"
        site = config.site.to_site()
        return IndiMount(config.indi, log_file, config.mount, config.waits, site=site)
    mount: MountPort = _factory(MOUNTS, "mount", name)(context)
    return mount


def create_camera(context: ProtocolContext) -> CameraPort:
    """Make the configured camera, not yet connected.

    Raises InstrumentError where its protocol is not installed or the package cannot be loaded.
    """
    name = context.config.instruments.camera
    if name == "indi":
        config, log_file = context.config, context.log_dir / "camera.log"
        return IndiCamera(config.indi, config.optics, log_file, config.waits)
    camera: CameraPort = _factory(CAMERAS, "camera", name)(context)
    return camera


def missing_protocol(config: Config) -> str | None:
    """Return the error of a configured protocol that cannot be used; None without one."""
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
