"""All commands to the engine, one class a verb.

A new verb is a class here and a handler in the engine (``engine/operator/handlers.py``); if a key
of the console gives it, also an entry in ``console/commands/commands.py``. Wire, record, log, panel
and shell use the class itself: README.md beside this file shows one whole example.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.control.command import Command, add_override_words, argument_field, register_command
from rsoconsole.words import direction

LARGEST_NUDGE_ARCMIN = 600.0
MAX_FRAMES = 1000
"""Greatest number of frames for which a setting can be changed."""
OVERRIDE_HELP = "Go without this check of the arming list; may be repeated."
_COMPASS = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)


# -- answered at once -------------------------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Stop(Command):
    """End every motion and exposure, and disarm: at once, from any sender."""

    verb = "stop"
    is_immediate = True
    survives_stop = True
    needs_control = False
    takes_anything = True


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class AskStatus(Command):
    """Ask for the engine's state; the answer's data are those of a ``Status``."""

    verb = "status"
    is_immediate = True
    survives_stop = True
    needs_control = False
    takes_anything = True


# -- who has the mount ------------------------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Arm(Command):
    """Give control of the mount to autonomy, after its checklist."""

    verb = "arm"
    moves_mount = True
    is_on_panel = True
    shell = "rsoconsole arm --override disk"
    shell_help = """Hand the mount to the engine: it searches from where the telescope points.

    A checklist is gone through first (clock, site, Sun, weather, disk and so on); what is not
    well can be overridden by name, which goes on record."""

    override: tuple[str, ...] = argument_field(default=(), help_=OVERRIDE_HELP)

    def words(self) -> str:
        """The command in words, for the log."""
        return add_override_words("arm", self.override)


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Disarm(Command):
    """Take control back from autonomy without moving the mount."""

    verb = "disarm"
    is_urgent = True
    survives_stop = True
    is_on_panel = True
    shell = "rsoconsole disarm"
    shell_help = (
        "Take the mount back from the engine; it keeps running and waits to be armed again."
    )


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Hold(Command):
    """Stop slews for now: tracks are still exposed, measured and predicted."""

    verb = "hold"
    is_urgent = True
    is_on_panel = True
    shell = "rsoconsole hold"
    shell_help = "No slews for now: what is followed is still exposed, measured and predicted."

    until: str | None = argument_field(default=None, help_="'clear': until the stars are back.")

    def check(self) -> None:
        """Check that ``until`` is empty or "clear"."""
        if self.until not in {None, "clear"}:
            raise ValueError("a hold is until 'clear', or until you resume")

    def words(self) -> str:
        """The command in words, for the log."""
        return "hold until it clears" if self.until == "clear" else "hold"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Resume(Command):
    """Give control back after a hold or a move by hand, or follow an ended track again."""

    verb = "resume"
    moves_mount = True
    is_on_panel = True
    shell = "rsoconsole resume"
    shell_help = """Give the mount back to the engine after a hold or a move by hand.

    A track that your own move ended is followed again as long as it may be coasted;
    one that 'disarm' or a new search ended for at most 15 minutes of that, without
    the checklist. After a STOP or a fault 'arm' comes first."""


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Park(Command):
    """Disarm, and send the mount to its park position."""

    verb = "park"
    is_urgent = True
    awaits_mount = True
    shell = "rsoconsole park"
    shell_help = "Disarm and send the mount to its park position."


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Abort(Command):
    """Give up the exposure under way; the next one begins as planned."""

    verb = "abort"
    is_urgent = True


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Shutdown(Command):
    """End the engine: the mount stops, the session is closed."""

    verb = "shutdown"
    survives_stop = True
    shell = "rsoconsole quit"
    shell_help = "End the engine safely: the mount stops, the session is closed."


# -- by hand ----------------------------------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Goto(Command):
    """Move the telescope by hand, within its limits; autonomy waits until it is resumed."""

    verb = "goto"
    title = "go to"
    is_urgent = True
    moves_mount = True
    awaits_mount = True

    ra_icrs_deg: float
    dec_icrs_deg: float
    override: tuple[str, ...] = argument_field(default=(), help_=OVERRIDE_HELP)

    def check(self) -> None:
        """Check that the declination is between -90 and 90 degrees."""
        if not -90.0 <= self.dec_icrs_deg <= 90.0:
            raise ValueError(f"declination {self.dec_icrs_deg:g} is outside -90 to 90")

    def words(self) -> str:
        """The command in words, for the log."""
        place = direction(self.ra_icrs_deg, self.dec_icrs_deg)
        return add_override_words(f"go to {place}", self.override)


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Nudge(Command):
    """Move the telescope by hand by a small angle on the sky; repeated moves add up."""

    verb = "nudge"
    is_urgent = True
    moves_mount = True
    awaits_mount = True

    east_arcmin: float
    north_arcmin: float
    override: tuple[str, ...] = argument_field(default=(), help_=OVERRIDE_HELP)

    def check(self) -> None:
        """Check that the move is small."""
        if math.hypot(self.east_arcmin, self.north_arcmin) > LARGEST_NUDGE_ARCMIN:
            raise ValueError(f"a nudge goes at most {LARGEST_NUDGE_ARCMIN:g} arcmin: use goto")

    def words(self) -> str:
        """The command in words, for the log."""
        arcmin = math.hypot(self.east_arcmin, self.north_arcmin)
        size = f"{arcmin:.3g}′" if arcmin >= 0.995 else f"{arcmin * 60:.3g}″"
        angle_deg = math.degrees(math.atan2(self.east_arcmin, self.north_arcmin))
        return add_override_words(
            f"nudge {size} {_COMPASS[round(angle_deg / 45.0) % 8]}", self.override
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AimOffset(Command):
    """Offset of the aim point from the predicted position, for previews alone.

    The settings ``aim.*`` apply an offset.
    """

    verb = "aim"

    lead_s: float | None = None
    along_arcmin: float | None = None
    across_arcmin: float | None = None

    def settings(self) -> dict[str, float]:
        """Return the given offsets by the names of their settings, such as ``aim.lead_s``."""
        return {f"aim.{name}": value for name, value in self.arguments().items()}


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Preview(Command):
    """Ask for a preview of a move: its target, duration and limits; nothing moves."""

    verb = "preview"
    needs_control = False

    move: Goto | Nudge | AimOffset

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of the previewed move, whose names tell the kinds of moves apart."""
        return self.move.arguments()

    @classmethod
    def read(cls, arguments: Mapping[str, Any]) -> "Preview":
        """Make the preview of the move that has these arguments."""
        if "east_arcmin" in arguments:
            return cls(move=Nudge.read(arguments))
        is_beside = not AimOffset.__dataclass_fields__.keys().isdisjoint(arguments)
        return cls(move=AimOffset.read(arguments) if is_beside else Goto.read(arguments))

    def check(self) -> None:
        """Check the arguments of the previewed move."""
        self.move.check()


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class SetTracking(Command):
    """Turn sidereal tracking on or off, by hand."""

    verb = "track"
    is_urgent = True
    moves_mount = True
    awaits_mount = True

    is_on: bool = argument_field("on", default=True)

    def words(self) -> str:
        """The command in words, for the log."""
        return "track" if self.is_on else "stand still"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Unpark(Command):
    """Release a parked mount; nothing moves."""

    verb = "unpark"
    is_urgent = True
    awaits_mount = True
    shell = "rsoconsole unpark"
    shell_help = "Release a parked mount; nothing moves."


# -- settings ---------------------------------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Set(Command):
    """Change a setting of the running engine, for good or for a number of frames."""

    verb = "set"
    title = "setting"
    wakes_loop = False
    is_on_panel = True
    shell = "rsoconsole set detector.tau 0.2"
    shell_help = (
        "Change a setting of the running engine, from the next exposure until the engine ends."
    )

    name: str = argument_field(help_="Dotted name, as 'config show' lists it.")
    value: int | float | str = argument_field(help_="New value.")
    frames: int | None = argument_field(default=None, help_="Set it back after this many frames.")

    def check(self) -> None:
        """Check the number of frames."""
        if self.frames is not None and not 1 <= self.frames <= MAX_FRAMES:
            raise ValueError(f"frames must be a number from 1 to {MAX_FRAMES}")

    def words(self) -> str:
        """The command in words, for the log."""
        frames = self.frames
        lent = "" if frames is None else f" for {frames} frame{'s' if frames != 1 else ''}"
        return f"{self.name} {self.value}{lent}"


# -- the operator's decisions on a frame ------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Seek(Command):
    """Search for the last track again, in a widening spiral around its predicted position."""

    verb = "seek"
    moves_mount = True


# -- among the consoles -----------------------------------------------------------------------


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class RequestControl(Command):
    """Request control from the console that has it."""

    verb = "ask_seat"
    title = "control"
    needs_control = False
    is_on_panel = True


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerControlRequest(Command):
    """Give control to the console that requests it, or refuse."""

    verb = "answer_seat"
    title = "control"
    needs_control = False
    is_on_panel = True

    gives: bool = False
    to: str | None = None
    """Console that the answer is for; None: any that requests control."""


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Note(Command):
    """Put a remark on record."""

    verb = "note"
    needs_control = False

    text: str = argument_field(help_="What you want to remember.")

    def check(self) -> None:
        """Check that the remark is not empty."""
        if not self.text.strip():
            raise ValueError("a note needs words")

    def words(self) -> str:
        """The command in words, for the log."""
        return f"note: {self.text}"
