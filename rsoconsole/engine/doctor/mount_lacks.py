"""What a mount's driver does not offer, and what follows from that for a night. Pure."""

from dataclasses import dataclass
from typing import Literal

from rsoconsole.config import MountConfig
from rsoconsole.instruments import MountAbilities

LackName = Literal["abort", "tracking", "park", "pier side", "site", "time"]

PROPERTIES: dict[LackName, str] = {
    "abort": "TELESCOPE_ABORT_MOTION",
    "tracking": "TELESCOPE_TRACK_STATE",
    "park": "TELESCOPE_PARK",
    "pier side": "TELESCOPE_PIER_SIDE",
    "site": "GEOGRAPHIC_COORD",
    "time": "TIME_UTC",
}
"""By which an INDI driver offers them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lack:
    """One thing that a driver does not offer."""

    name: LackName
    what: str
    """In two words, for a panel."""
    follows: str
    needs_override: bool = False
    """Whether arming needs one, by the name."""

    @property
    def text(self) -> str:
        """In one line."""
        return f"the mount has {self.what}: {self.follows}"


def lacks_of(abilities: MountAbilities, mount: MountConfig) -> tuple[Lack, ...]:
    """All that is missing, the unsafe first."""
    found = []
    if not abilities.can_abort:
        follows = "STOP cannot end a slew: cut its power"
        found.append(Lack(name="abort", what="no ABORT", follows=follows, needs_override=True))
    if not abilities.can_set_tracking:
        then = "it parks there" if abilities.can_park else "stay at its power switch"
        follows = f"tracking cannot be ended at a limit: {then}"
        is_unsafe = not abilities.can_park
        found.append(
            Lack(
                name="tracking",
                what="no tracking switch",
                follows=follows,
                needs_override=is_unsafe,
            )
        )
    if not abilities.can_park:
        found.append(Lack(name="park", what="no park position", follows="dawn only stops it"))
    if not abilities.has_pier_side and mount.type == "german":
        follows = "it is computed from the hour angle"
        found.append(Lack(name="pier side", what="no side of the pier", follows=follows))
    if not abilities.has_site:
        follows = "compare it with yours by hand"
        found.append(Lack(name="site", what="no site", follows=follows))
    if not abilities.has_time:
        follows = "compare its clock by hand"
        found.append(Lack(name="time", what="no time", follows=follows))
    return tuple(found)
