"""The progress of a search: its fields in order, the next one, and those passed over."""

from rsoconsole.config import Config
from rsoconsole.pipeline import (
    SearchBase,
    direction_of_hour_angle,
    field_number,
    fields_in_round,
    search_base,
    search_base_at,
    search_direction,
    search_target,
)
from rsoconsole.sky import separation_deg

Direction = tuple[float, float]
"""Right ascension and declination, ICRS degrees."""

SAME_FIELD = 0.25
"""Distance, in field heights, within which the telescope counts as in a field of the search."""


class SearchSequence:
    """The sequence of a search's fields, visited again and again; progress counts exposures.

    The first exposure after arming is taken where the telescope points, outside the sequence, and
    the search waits there for what that exposure shows.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._site = config.site.to_site()
        self._base: SearchBase | None = None
        self._home: SearchBase | None = None
        self._here: SearchBase | None = None
        self._refused: set[int | str] = set()
        self.number = 0
        """Number of exposures counted in the search so far; it determines the field."""

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config

    def start(self, direction: Direction, t_utc_ns: int) -> None:
        """Start a search at the configured place, completed by ``direction``.

        ``direction`` gives a missing hour angle and, with pattern ``stay``, a missing declination;
        with other patterns a missing declination is that of the geostationary belt.
        """
        self._home = search_base(self._config.search, self._site, *direction, t_utc_ns)
        self._refused.clear()
        self.return_to_first_field()

    def return_to_first_field(self) -> None:
        """Return to the first field of the search that ``start`` began."""
        self._base, self._here, self.number = self._home, None, 0

    def start_around_lost_track(self, direction: Direction, t_utc_ns: int) -> None:
        """Start a search around ``direction``, where a track was lost.

        The configured targets are searched after that.
        """
        self._base = search_base_at(self._site, *direction, t_utc_ns, comes_before_targets=True)
        self._here, self.number = None, 0

    def start_spiral(self, direction: Direction, t_utc_ns: int) -> None:
        """Search around ``direction`` in a widening spiral.

        ``return_to_first_field`` then leads back to the search that ``start`` started.
        """
        self._base = search_base_at(self._site, *direction, t_utc_ns, widens=True)
        self._here, self.number = None, 0
        self._refused.clear()

    @property
    def is_spiral(self) -> bool:
        """True while the search is a widening spiral."""
        return self._base is not None and self._base.widens

    @property
    def is_outside_round(self) -> bool:
        """True while the next exposure stays where the telescope points, outside the sequence."""
        return self._here is not None

    def stay_for_next_exposure(self, direction: Direction, t_utc_ns: int) -> None:
        """Take the next exposure where the telescope points (``direction``), off the sequence."""
        self._here = search_base_at(self._site, *direction, t_utc_ns)

    def return_to_round(self) -> bool:
        """Return to the sequence of fields; False where the search had not left it."""
        was_here, self._here = self._here is not None, None
        return was_here

    def exposure_numbers_to_try(self) -> list[int]:
        """Return the present exposure number, then the first number of every other field."""
        per_field = self._config.search.frames_per_field
        visited = self.number // per_field
        others = range(1, fields_in_round(self._begun(), self._config.search))
        return [self.number, *((visited + n) * per_field for n in others)]

    def direction(self, number: int, t_utc_ns: int, *, is_waiting: bool) -> tuple[Direction, str]:
        """Return the direction of exposure ``number`` at an instant, and its reason in words.

        ``is_waiting``: the loop is in ACQUIRE, waiting for a second frame of a detected object.
        """
        reason = "wait for a second frame" if is_waiting else "search"
        if self._here is not None and number == self.number:
            here = (self._here.hour_angle_deg, self._here.declination_deg)
            return direction_of_hour_angle(self._site, *here, t_utc_ns), reason
        base, search = self._begun(), self._config.search
        target = search_target(base, search, number)
        if target is not None and not is_waiting:
            reason = f"search: {target.name}"
        return self._field_direction(number, t_utc_ns), reason

    def is_first_refusal(self, number: int) -> bool:
        """Return True at the first call for each refused field, so that it is reported once."""
        place = self._place(number)
        is_new = place not in self._refused
        self._refused.add(place)
        return is_new

    def take(self, number: int) -> None:
        """Make exposure ``number`` the next one; the fields before it are passed over."""
        self._refused.discard(self._place(number))
        if number != self.number:
            self._here, self.number = None, number

    def count(self, centre: Direction | None, t_utc_ns: int) -> None:
        """Count a finished exposure; ``centre``: where it looked, ICRS degrees.

        One taken outside the sequence counts only where it looked at the present field.
        """
        if self._here is None or centre is None:
            self.number += 1
            return
        self._here = None
        off_deg = separation_deg(*centre, *self._field_direction(self.number, t_utc_ns))
        if off_deg < SAME_FIELD * min(self._config.optics.field_deg):
            self.number += 1

    def _field_direction(self, number: int, t_utc_ns: int) -> Direction:
        return search_direction(
            self._begun(),
            self._config.search,
            self._site,
            field_deg=self._config.optics.field_deg,
            exposure_number=number,
            t_utc_ns=t_utc_ns,
        )

    def _place(self, number: int) -> int | str:
        if self._here is not None and number == self.number:
            return "here"
        return field_number(self._begun(), self._config.search, number)

    def _begun(self) -> SearchBase:
        if self._base is None:
            raise RuntimeError("a search is planned before it was started")
        return self._base
