"""Side of the pier of a German mount, whichever convention its driver follows.

INDI's PIER_EAST means a telescope east of the pier, which looks west. Some drivers name the sides
the other way round. Where a slew has just ended, far from the meridian, a German mount as a rule
looks across its pier, so its side follows from where it looks. One such slew proves nothing: its
counterweight may be up. So the driver is believed until slews to both sides of the meridian have
shown the contrary.
"""

from collections.abc import Callable
from typing import Literal

from rsoconsole.instruments.ports import MountReport, PierSide
from rsoconsole.records import Site
from rsoconsole.sky import hour_angle_jnow_deg, icrs_to_jnow, separation_deg

PierSetting = Literal["found", "driver", "reversed", "none"]
MIN_HOUR_ANGLE_DEG = 30.0
"""Least hour angle, from the meridian, of a direction that tells the side."""
ARRIVED_DEG = 0.5
_OTHER: dict[PierSide, PierSide] = {"east": "west", "west": "east"}


class PierConvention:
    """Reads a driver's side of the pier by the setting, or by what the mount has done."""

    def __init__(self, setting: PierSetting, site: Site | None, say: Callable[[str], None]) -> None:
        """``site`` None: nothing can be found. ``say``: called with what was found."""
        self._setting, self._site, self._say = setting, site, say
        self._target: tuple[float, float] | None = None
        self._is_reversed = setting == "reversed"
        self._is_found = setting != "found" or site is None
        self._contrary: set[PierSide] = set()
        """Sides on which the mount should have been where the driver has said the other one."""

    def begin_slew(self, ra_icrs_deg: float, dec_icrs_deg: float) -> None:
        """Note where the mount is sent."""
        self._target = (ra_icrs_deg, dec_icrs_deg)

    def forget_slew(self) -> None:
        """Note that the slew was given up: where it ends tells nothing."""
        self._target = None

    def side(self, report: MountReport) -> PierSide | None:
        """Return the side of the pier of a report; None where it is not known."""
        if report.pier_side is None or self._setting == "none":
            return None
        self._look(report, report.pier_side)
        return _OTHER[report.pier_side] if self._is_reversed else report.pier_side

    def _look(self, report: MountReport, said: PierSide) -> None:
        """Compare the driver's side with that of a direction to which the mount was sent."""
        if self._is_found or self._target is None or report.is_slewing or self._site is None:
            return
        here = (report.ra_icrs_deg, report.dec_icrs_deg)
        if separation_deg(*here, *self._target) > ARRIVED_DEG:
            return
        self._target = None
        ra_jnow_deg, _ = icrs_to_jnow(*here, report.t_utc_ns)
        hour_angle_deg = hour_angle_jnow_deg(self._site, ra_jnow_deg, report.t_utc_ns)
        if not MIN_HOUR_ANGLE_DEG <= abs(hour_angle_deg) <= 180.0 - MIN_HOUR_ANGLE_DEG:
            return
        true: PierSide = "east" if hour_angle_deg > 0.0 else "west"
        if said == true:
            self._is_found = True
            return
        if true in self._contrary:
            return
        self._contrary.add(true)
        where = "west" if hour_angle_deg > 0.0 else "east"
        seen = f"the mount's driver says {said} of the pier after a slew to the {where}"
        if len(self._contrary) < len(_OTHER):
            self._say(
                f"{seen}: its counterweight is up, or it names the sides otherwise. A slew"
                " far beyond the meridian will tell, or set mount.pier_side"
            )
            return
        self._is_found = self._is_reversed = True
        self._say(
            f"{seen}, as on the other side: it names the sides of the pier the other way round, and"
            f" is read as {true} (mount.pier_side sets this)"
        )
