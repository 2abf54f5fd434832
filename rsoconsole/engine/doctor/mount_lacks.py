"""Functions that a mount's driver lacks, and the effect of each on a night."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingAbility:
    """One function that a driver lacks, and the consequence."""

    name: LackName
    what: str
    """Name of the missing function in two words, for a panel."""
    follows: str
    needs_override: bool = False
    """True where arming needs the operator to override the lack by its name."""

    @property
    def text(self) -> str:
        """The missing function and the effect of its lack, in one line."""
        return f"the mount has {self.what}: {self.follows}"


def missing_abilities(abilities: MountAbilities, mount: MountConfig) -> tuple[MissingAbility, ...]:
    """Return all functions that a driver lacks, those that matter for safety first."""
    then = "it parks there" if abilities.can_park else "stay at its power switch"
    known: tuple[tuple[bool, LackName, str, str], ...] = (
        (abilities.can_abort, "abort", "no ABORT", "STOP cannot end a slew: cut its power"),
        (
            abilities.can_set_tracking,
            "tracking",
            "no tracking switch",
            f"tracking cannot be ended at a limit: {then}",
        ),
        (abilities.can_park, "park", "no park position", "dawn only stops it"),
        (
            abilities.has_pier_side or mount.type != "german",
            "pier side",
            "no side of the pier",
            "it is computed from the hour angle",
        ),
        (abilities.has_site, "site", "no site", "compare it with yours by hand"),
        (abilities.has_time, "time", "no time", "compare its clock by hand"),
    )
    unsafe = {"abort"} if abilities.can_park else {"abort", "tracking"}
    return tuple(
        MissingAbility(name=name, what=what, follows=follows, needs_override=name in unsafe)
        for is_there, name, what, follows in known
        if not is_there
    )
