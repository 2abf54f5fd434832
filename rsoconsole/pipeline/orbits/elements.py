"""Elements for SGP4 of an orbit that was found, where it is known well enough to have any."""

from dataclasses import dataclass, replace

from rsoconsole.errors import OrbitError
from rsoconsole.orbits.elements import MeanElements, mean_elements
from rsoconsole.pipeline.orbits.orbit_of import Found

WORTH_WRITING = ("free", "constrained by prior")
"""Others would be taken for better than they are: elements carry no errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedElements:
    """The elements, or why there are none."""

    mean: MeanElements | None
    tle: tuple[str, str] | None
    """The two lines; None also where they have no room for the catalogue number."""
    reason: str


def orbit_elements(found: Found, *, norad_id: int, name: str, cospar: str = "") -> FittedElements:
    """Fitted to the directions and the orbit; nothing is raised for what SGP4 does not follow."""
    if found.orbit is None or found.orbit.label not in WORTH_WRITING:
        label = "not observable" if found.orbit is None else found.orbit.label
        return FittedElements(mean=None, tle=None, reason=f"the orbit is labelled {label}")
    try:
        fitted = mean_elements(found.orbit, found.seen, norad_id=norad_id, name=name)
        fitted = replace(fitted, cospar=cospar)
    except OrbitError as error:
        return FittedElements(mean=None, tle=None, reason=str(error))
    try:
        lines = fitted.element_set()
    except OrbitError as error:
        return FittedElements(mean=fitted, tle=None, reason=str(error))
    return FittedElements(mean=fitted, tle=(lines.line_1, lines.line_2), reason="")
