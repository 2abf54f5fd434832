"""Looking again for what was followed, where it must be by now: the operator's command."""

from rsoconsole.control import Seek
from rsoconsole.engine.aim import Guide, InstrumentController, Planner, Sought
from rsoconsole.engine.operator.handlers import Control, Handler, Handlers
from rsoconsole.engine.tasks import Slews
from rsoconsole.pipeline.cycle import direction_at
from rsoconsole.reasons import CommandResult, done
from rsoconsole.words import text


class Seeking:
    """Knows where what was followed must be, and has the search begin there."""

    def __init__(
        self,
        control: Control,
        instrument_controller: InstrumentController,
        planner: Planner,
        slews: Slews,
        guide: Guide,
    ) -> None:
        self._control = control
        self._instrument_controller = instrument_controller
        self._planner = planner
        self._slews = slews
        self._guide = guide

    @property
    def handlers(self) -> Handlers:
        """Its commands."""
        return {Seek: Handler(expect=self._expect, execute=self._seek)}

    def _expect(self, _command: Seek, _by: str) -> None:
        self.direction()

    def _seek(self, _command: Seek, by: str) -> CommandResult:
        """Search in a widening spiral round where it must be."""
        direction = self.direction()
        self._control.handle(Sought(by=by))
        self._planner.search_about(direction, self._instrument_controller.now_utc_ns())
        return done("looking for it in a widening spiral")

    def direction(self) -> tuple[float, float]:
        """Where what was followed must be now, ICRS.

        Raises ValueError where it cannot be looked for.
        """
        track, authority = self._control.last_track, self._control.authority
        if track is None:
            raise ValueError("nothing has been followed this night that could be looked for")
        if not authority.is_autonomous:
            raise ValueError("autonomy does not have the mount: arm or resume first")
        if authority.is_held:
            raise ValueError("the mount is held: resume first")
        now_ns = self._instrument_controller.now_utc_ns()
        # A line on the sky leads astray within the hour, an orbit does not.
        direction = self._guide.of_last(now_ns) or direction_at(track, now_ns)
        refused = self._slews.refuse_direction(direction, now_ns)
        if refused is not None:
            raise ValueError(f"it cannot be looked for where it must be: {text(refused)}")
        return direction
