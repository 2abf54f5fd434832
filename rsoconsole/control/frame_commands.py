"""The operator's decisions on streaks and tracks: one command a verb."""

from dataclasses import dataclass

from rsoconsole.control.command import Command, argument_field, register_command


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision(Command):
    """A decision of the operator on the streaks of one frame; without a frame: of the newest."""

    frame_id: int | None = argument_field(
        "frame", default=None, help_="The frame that it is said of; without: the newest."
    )

    def words(self) -> str:
        """The command in words, for the log."""
        return self.verb + self.of_frame(" frame {}")

    def of_frame(self, words: str) -> str:
        """Return ``words`` with the frame's number in place of ``{}``; empty: no frame is given."""
        return "" if self.frame_id is None else words.format(self.frame_id)


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class ChooseStreak(Decision):
    """Follow the streak nearest to a pixel position."""

    verb = "choose"

    x_px: float = argument_field("x")
    y_px: float = argument_field("y")

    def words(self) -> str:
        """The command in words, for the log."""
        return f"follow the streak at {self.x_px:.0f}, {self.y_px:.0f}"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Accept(Decision):
    """Accept the frame's likeliest streak that the track did not use, whatever the gates say."""

    verb = "accept"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class Reject(Decision):
    """Reject the track's measurement in a frame; without a frame: its last measurement."""

    verb = "reject"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class MarkByHand(Decision):
    """Mark a streak by hand: a measurement between two ends that the operator sets."""

    verb = "mark"
    answer_s = 30.0

    x_a_px: float = argument_field("x_a")
    y_a_px: float = argument_field("y_a")
    x_b_px: float = argument_field("x_b")
    y_b_px: float = argument_field("y_b")
    sigma_px: float | None = None
    """One sigma of the ends, px; None: the default of a mark by hand."""
    sigma_across_px: float | None = None
    """One sigma across, px, if refined on the light: ``sigma_px`` is then along; None otherwise."""
    is_clipped: bool | None = None
    """True where the image shows that the frame's edge cuts the streak."""
    replaces: bool | None = None
    """True where the mark may replace a more precise measurement."""

    def words(self) -> str:
        """The command in words, for the log."""
        return "mark by hand" + self.of_frame(" in frame {}")


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class BeginMark(Decision):
    """Keep a frame's pixels while the operator marks it; ``is_on`` False: keep them no longer."""

    verb = "begin_mark"
    answer_s = 30.0

    is_on: bool = argument_field("on", default=True)

    def words(self) -> str:
        """The command in words, for the log."""
        deed = "begin a mark" if self.is_on else "leave off the mark"
        return deed + self.of_frame(" in frame {}")


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class WithdrawDecisions(Decision):
    """Withdraw the decisions on a frame's streaks; without a frame: the last decision."""

    verb = "take_back"
    title = "take back"

    def words(self) -> str:
        """The command in words, for the log."""
        return "take back" + self.of_frame(" what was said of frame {}")


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class DropTrack(Decision):
    """Drop a track for good; its streaks start no new track while it may be in the field."""

    verb = "drop"
    shell = "rsoconsole drop 3"
    shell_help = """End one track by its number, as 'rsoconsole status' lists it; the others go on.

    Its streaks start no other track for as long as it may be in the field. With --off within
    12 frames it is followed as if it had never been dropped; so does 'u' in the console."""

    track: int = argument_field(help_="The track's number.")
    off: bool | None = argument_field(default=None, help_="Take it back.")

    def words(self) -> str:
        """The command in words, for the log."""
        return f"{'take back: ' if self.off else ''}drop track {self.track}"


@register_command
@dataclass(frozen=True, slots=True, kw_only=True)
class KeepTrack(Decision):
    """Keep a track: no miss ends it while it may be in the field; ``off``: keep it no longer."""

    verb = "keep"
    shell = "rsoconsole keep 3"
    shell_help = """Keep one track, by its number, whatever it misses.

    Neither the time that it coasts nor a miss on trial ends it, until it leaves the field or its
    3-sigma bounds are wider than the field. With --off that holds no longer."""

    track: int = argument_field(help_="The track's number.")
    off: bool | None = argument_field(default=None, help_="Keep it no longer.")

    def words(self) -> str:
        """The command in words, for the log."""
        return f"keep track {self.track}{' no longer' if self.off else ''}"
