"""The tuning pane: settings on trial for a night, to apply, undo and keep as presets."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

from textual.binding import Binding, BindingType
from textual.message import Message

from rsoconsole.base import (
    ConfigError,
    parse_toml,
    read_foreign_text,
    system_errors_as,
    value_errors_as,
    write_durably,
)
from rsoconsole.config import Config, FilterConfig, toml_value, with_setting
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.words.tunable import (
    BY_NAME,
    LEARNING,
    NAMES,
    PRESET,
    TUNABLES,
    Tunable,
    Value,
)
from rsoconsole.tracking import Settled

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures

Wanting = Literal["apply", "lend", "undo", "save", "load", "propose", "close", "try", "type"]
LAST_FRAMES = 40


class TuneFigures(NamedTuple):
    """Figures beside the settings; None: not computed yet, or of no use."""

    now: "TrackFigures | None" = None
    """Of the last frames as recorded."""
    then: "TrackFigures | None" = None
    """Of the same frames with the settings on trial."""
    settled: Settled | None = None
    """Bounds and gain to which the filter settles by the settings in force."""
    settled_then: Settled | None = None
    """Bounds and gain by the settings on trial."""


@dataclass(slots=True)
class Tuning:
    """The settings in force (``present``), those on trial (``changes``), and how to undo."""

    present: dict[str, Value | None] = field(default_factory=dict)
    changes: dict[str, Value] = field(default_factory=dict)
    before: list[dict[str, Value]] = field(default_factory=list)
    """For each application, the values in force before it; the last application at the end."""
    steps: dict[str, int] = field(default_factory=dict)
    """Steps of each setting from its value in force, or from a loaded or typed value."""
    loaded: dict[str, Value] = field(default_factory=dict)
    row: int = 0
    sent: dict[str, Value] = field(default_factory=dict)
    """Values sent to the engine that the record does not show as in force yet."""
    replaced: dict[str, Value | None] = field(default_factory=dict)
    """Value of each sent setting before it was sent."""

    @property
    def tunables(self) -> tuple[Tunable, ...]:
        """The settings that apply to the filter preset on trial, or else to the one in force."""
        preset = self.changes.get(PRESET, self.present.get(PRESET))
        return tuple(t for t in TUNABLES if t.preset is None or preset in (None, t.preset))

    @property
    def settings(self) -> FilterConfig | None:
        """The filter's settings with those on trial; None while those in force are not known."""
        return _filter_settings(self.present | self.changes)

    @property
    def present_settings(self) -> FilterConfig | None:
        """The filter's settings in force; None while they are not known."""
        return _filter_settings(self.present)

    @property
    def last_applied_words(self) -> str:
        """The settings applied last, in words; empty: none, or they are not in force yet."""
        before = self.before[-1] if self.before else {}
        if len(before) > 1:
            return f"{len(before)} in force"
        for name, value in before.items():
            after = self.present.get(name)
            if after is not None and after != value:
                return f"{BY_NAME[name].change_words(value, after)} in force"
        return ""

    @property
    def trial_words(self) -> str:
        """The settings on trial against those in force, in words: Q× 2.25 against 1."""
        if len(self.changes) != 1:
            return f"{len(self.changes)} settings tried"
        ((name, value),) = self.changes.items()
        tunable, label = BY_NAME[name], BY_NAME[name].label.replace(" ×", "×")
        return f"{label} {tunable.words(value)} against {tunable.words(self.present.get(name))}"

    def see(self, present: Mapping[str, Value | None]) -> None:
        """Store the settings in force; a value that is among them is no longer on trial."""
        self.present = dict(present)
        self.row = min(self.row, len(self.tunables) - 1)
        self.changes = {n: v for n, v in self.changes.items() if self.present.get(n) != v}
        self.steps = {n: k for n, k in self.steps.items() if n in self.changes}
        self.loaded = {n: v for n, v in self.loaded.items() if n in self.changes}
        self.sent = {n: v for n, v in self.sent.items() if self.changes.get(n) == v}

    def step(self, by: int) -> None:
        """Move the chosen setting's value on trial ``by`` steps, at first from the one in force.

        A value that is in force is not on trial any more. Does nothing if none is known to be in
        force.
        """
        tunable = self.tunables[self.row]
        present = self.present.get(tunable.name)
        if present is None:
            return
        before = self.steps.get(tunable.name, 0)
        steps = before + by
        from_preset = self.loaded.get(tunable.name)
        stepped = tunable.step_value(present if from_preset is None else from_preset, steps)
        if before and stepped == self.changes.get(tunable.name):
            return  # at its bound: no step that would have to be gone back
        if (steps == 0 and from_preset is None) or stepped == present:
            self.changes.pop(tunable.name, None)
            self.steps.pop(tunable.name, None)
        else:
            self.changes[tunable.name], self.steps[tunable.name] = stepped, steps
        if tunable.name == PRESET:
            names = {each.name for each in self.tunables}
            self.changes = {n: v for n, v in self.changes.items() if n in names}

    def type(self, text: str) -> str:
        """Put a typed value of the chosen setting on trial; return the error in words, or ""."""
        tunable = self.tunables[self.row]
        if tunable.choices:
            if text not in tunable.choices:
                return f"{tunable.label} is one of {', '.join(tunable.choices)}"
            value: Value = text
        else:
            try:
                value = float(text.replace("−", "-").replace(",", "."))
            except ValueError:
                return f"{text!r} is no number"
            if not tunable.low <= value <= tunable.high:
                return f"{tunable.label} lies between {tunable.low:g} and {tunable.high:g}"
        if self.present.get(tunable.name) == value:
            self.changes.pop(tunable.name, None)
        else:
            self.changes[tunable.name] = value
        self.steps.pop(tunable.name, None)
        # The steps go on from here.
        self.loaded[tunable.name] = value
        return ""

    def load(self, preset: Mapping[str, Value]) -> None:
        """Put the values of a preset on trial."""
        self.changes = {n: v for n, v in preset.items() if self.present.get(n) != v}
        self.loaded, self.steps = dict(self.changes), {}

    def apply(self) -> dict[str, Value]:
        """Return the settings on trial, to be sent; ``undo`` returns the values they replace."""
        wanted = dict(self.changes)
        present = {name: self.present.get(name) for name in wanted}
        if wanted:
            self.before.append({n: value for n, value in present.items() if value is not None})
        self.sent = dict(wanted)
        return wanted

    def undo(self) -> dict[str, Value]:
        """Clear the settings on trial; without any return those that undo the last application."""
        if self.untry():
            return {}
        return self.before.pop() if self.before else {}

    def untry(self) -> bool:
        """Clear the settings on trial; return False where there are none."""
        had_trial = any(self.sent.get(name) != value for name, value in self.changes.items())
        self.changes.clear()
        self.steps.clear()
        self.loaded.clear()
        return had_trial


class TunePane(LinesPane, can_focus=False):
    """Pane of the tuning; its keys change settings on trial or post a request."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "row(-1)", "Setting above"),
        Binding("down", "row(1)", "Setting below"),
        Binding("left", "step(-1)", "Less"),
        Binding("right", "step(1)", "More"),
        Binding("enter", "say('apply')", "Apply"),
        Binding("f", "say('lend')", "Apply for a number of frames"),
        Binding("u", "say('undo')", "Undo"),
        Binding("backspace", "untry", "Nothing on trial"),
        Binding("w", "say('save')", "Save as preset"),
        Binding("o", "say('load')", "Load a preset"),
        Binding("p", "say('propose')", "Propose Q and R"),
        Binding("l", "learning", "Hold what is learnt, or learn on"),
        Binding("t,escape", "say('close')", "Close"),
        *(Binding(key, f"type('{key}')", show=False) for key in "0123456789"),
        Binding("full_stop", "type('.')", show=False),
    ]
    DEFAULT_CSS = """
    TunePane { background: $surface; border: none; }
    """

    class Wanted(Message):
        """Posted to request an action, such as "apply", from the screen."""

        def __init__(self, what: Wanting, begun: str = "") -> None:
            """``what``: the action; ``begun``: the first digit typed, for the action "type"."""
            super().__init__()
            self.what, self.begun = what, begun

    tuning: Tuning | None = None

    def action_row(self, by: int) -> None:
        """Choose the setting ``by`` rows below; a negative number chooses one above."""
        if self.tuning is not None:
            self.tuning.row = (self.tuning.row + by) % len(self.tuning.tunables)
            self.post_message(self.Wanted("try"))

    def action_step(self, by: int) -> None:
        """Change the chosen setting by steps."""
        if self.tuning is not None:
            self.tuning.step(by)
            self.post_message(self.Wanted("try"))

    def action_untry(self) -> None:
        """Clear the settings on trial."""
        if self.tuning is not None:
            self.tuning.untry()
            self.post_message(self.Wanted("try"))

    def action_learning(self) -> None:
        """Try the next choice of whether the filter learns the night's noise."""
        if self.tuning is not None:
            names = [each.name for each in self.tuning.tunables]
            self.tuning.row = names.index(LEARNING)
            self.action_step(1)

    def action_type(self, begun: str) -> None:
        """Request a text field for a number; ``begun``: the digit that was typed already."""
        self.post_message(self.Wanted("type", begun))

    def action_say(self, what: Wanting) -> None:
        """Post the request for an action of the screen."""
        self.post_message(self.Wanted(what))


def _filter_settings(values: Mapping[str, Value | None]) -> FilterConfig | None:
    own = {n: v for n, v in values.items() if n.startswith("filter.")}
    if not own or any(value is None for value in own.values()):
        return None
    return FilterConfig.model_validate({n.partition(".")[2]: v for n, v in own.items()})


_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}")

NAMING = "letters, digits, blanks and . _ -"


def load_presets(path: Path) -> dict[str, dict[str, Value]]:
    """Read all presets: settings by the preset's name; empty without a file.

    Raises ConfigError for a bad preset or a file that cannot be read.
    """
    try:
        table = parse_toml(read_foreign_text(path))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    presets: dict[str, dict[str, Value]] = {}
    for name, settings in table.items():
        if not isinstance(settings, dict) or not set(settings) <= set(NAMES):
            raise ConfigError(f"{path}: preset {name!r} may only set {', '.join(NAMES)}")
        if not _NAME.fullmatch(name):
            raise ConfigError(f"{path}: {name!r} is no name for a preset: {NAMING}")
        for key, value in settings.items():
            if isinstance(value, bool):
                raise ConfigError(f"{path}: preset {name!r}: {key} = {value} is no number")
            with value_errors_as(ConfigError, f"{path}: preset {name!r}: ", ConfigError):
                with_setting(Config(), key, value)
        presets[name] = settings
    return presets


def save_preset(path: Path, name: str, settings: Mapping[str, Value | None]) -> None:
    """Add a preset to the file, or replace the one of that name.

    Raises ConfigError for a bad name, and where the file cannot be written.
    """
    if not _NAME.fullmatch(name):
        raise ConfigError(f"{name!r} is no name for a preset: {NAMING}")
    presets = load_presets(path)
    presets[name] = {key: value for key, value in settings.items() if value is not None}
    lines: list[str] = []
    for each, values in sorted(presets.items()):
        lines.append(f'["{each}"]')
        lines += [f'"{key}" = {toml_value(value)}' for key, value in sorted(values.items())]
        lines.append("")
    with system_errors_as(ConfigError, f"{path} cannot be written: "):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, "\n".join(lines).encode())
