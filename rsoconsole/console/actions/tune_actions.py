"""Tuning, from the key that opens the pane to the settings that the engine is sent."""

import time
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from rsoconsole.config import default_config_path
from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.dialogs import LineDialog
from rsoconsole.console.tuning import (
    BY_NAME,
    LAST_FRAMES,
    NAMES,
    TunePane,
    TuneWords,
    Tuning,
    Value,
    WhatIfWatch,
    frames_of_track,
    load_presets,
    of_settings_now,
    save_preset,
    tune_lines,
)
from rsoconsole.console.watches import WhatIfSeen
from rsoconsole.control import MOST_FRAMES, Command, Outcome, Set
from rsoconsole.errors import ConfigError

if TYPE_CHECKING:
    from rsoconsole.pipeline.replay import TrackFigures

PRESETS = "presets.toml"
USUAL_FRAMES = 5
EVERY_S = 20.0
"""How often an open pane's figures are computed again."""


class TuneActions(Seat):
    """Try, see what it would have done, apply, undo, keep."""

    is_tune_open = False
    _figures: "tuple[TrackFigures | None, TrackFigures | None]" = (None, None)
    _tuning: Tuning | None = None
    _watch: WhatIfWatch | None = None
    _computed_s = 0.0

    def place_panes(self) -> None:
        """Lay the panes out again; the screen that has them does."""

    @property
    def tuning(self) -> Tuning:
        """What is in force and what is tried."""
        if self._tuning is None:
            self._tuning = Tuning()
        return self._tuning

    def action_tune(self) -> None:
        """Open the pane, or give it the keys; once more: close it."""
        pane = self.query_one("#tune", TunePane)
        if self.is_tune_open and pane.has_focus:
            self.close_tune()
            return
        self.is_tune_open = True
        pane.tuning = self.tuning
        self.place_panes()
        pane.can_focus = True
        self.set_focus(pane)
        self.show_tuning()
        self.show_keys()
        self.compute()
        if self._watch is not None:
            self._watch.prepare()

    def close_tune(self) -> None:
        """Put it away; what is tried stays tried."""
        self.is_tune_open = False
        self.query_one("#tune", TunePane).can_focus = False
        self.set_focus(None)
        self.forget_notice()  # what was said of the pane ends with it
        self.place_panes()
        self.show_keys()

    def show_tuning(self) -> None:
        """Draw the pane; what is in force comes from the record."""
        was_tried = bool(self.tuning.tried)
        self.tuning.see({name: self.night.setting(name) for name in NAMES})
        if was_tried and not self.tuning.tried:
            self._figures = (self._figures[0], None)
            self.compute()  # what was tried is in force: its figures are those of the night
        lines = tune_lines(self.tuning, *self._figures, words=self.tune_words)
        self.query_one("#tune", TunePane).show(lines)

    @property
    def tune_words(self) -> TuneWords:
        """What the pane says of its figures and its keys."""
        return TuneWords(of_present=self.of_present())

    def of_present(self) -> int | None:
        """How many of the figures' frames ran with the settings in force now, whenever that was."""
        now = self._figures[0]
        if now is None:
            return None
        return of_settings_now(self.night, now.frames)

    def tune_scope(self) -> tuple[int | None, int | None]:
        """(until which place of the log, over how many of its last frames) figures are computed."""
        return None, self.last_frames()

    def last_frames(self) -> int:
        """Of the lead, as many as the orbit's pane says how good it is by."""
        return len(frames_of_track(self.night)) or LAST_FRAMES

    def compute(self) -> None:
        """Have the figures computed."""
        if self.night.folder is None or self.night.config is None:
            return
        self._computed_s = time.monotonic()
        if self._watch is None:
            self._watch = WhatIfWatch(lambda *figures: self.post_from_thread(WhatIfSeen(*figures)))
        until_seq, last = self.tune_scope()
        self._watch.ask(
            self.night.folder,
            self.night.config,
            self.tuning.tried,
            until_seq=until_seq,
            last=last,
        )

    def compute_now_and_then(self) -> None:
        """Where the pane is always seen, its figures follow the night."""
        if not self.night.is_read:
            return  # nobody knows yet over how many frames
        is_due = time.monotonic() - self._computed_s >= EVERY_S
        if self.query_one("#tune", TunePane).display and is_due:
            self.compute()

    def on_what_if_seen(self, message: WhatIfSeen) -> None:
        """Figures now and with what is tried."""
        if message.fault:
            self.say(message.fault, "warn")
            return
        self._figures = (message.now, message.then)
        self.show_tuning()

    def on_unmount(self) -> None:
        """Nobody asks any more."""
        if self._watch is not None:
            self._watch.close()

    def on_tune_pane_wanted(self, message: TunePane.Wanted) -> None:
        """One of the pane's keys."""
        message.stop()
        if message.what == "type":
            self._type(message.begun)
            return
        {
            "try": self._try,
            "apply": self._apply,
            "lend": self._lend,
            "undo": self._undo,
            "save": self._save,
            "load": self._load,
            "close": self.close_tune,
        }[message.what]()

    def _type(self, begun: str) -> None:
        """A number for the chosen setting, typed."""
        tunable = self.tuning.tunables[self.tuning.row]
        if self.tuning.present.get(tunable.name) is None:
            return
        if tunable.choices:
            self.say(f"{tunable.label} is chosen with ←→: {', '.join(tunable.choices)}", "warn")
            return

        def decided(text: str | None) -> None:
            if not text:
                return
            fault = self.tuning.type(text)
            if fault:
                self.say(fault, "warn")
                return
            self._try()

        words = f"from {tunable.low:g} to {tunable.high:g}"
        title = f"{tunable.label}{tunable.unit}: a number {words}"
        dialog = LineDialog(title, words, begun, goes_on=True)
        self.app.push_screen(dialog, decided)

    def _try(self) -> None:
        self._figures = (self._figures[0], None)
        self.show_tuning()
        self.compute()

    def _apply(self) -> None:
        if not self.may_act():
            return
        wanted = self.tuning.apply()
        self._set(wanted)
        if not wanted:
            self.say("nothing is tried: ←→ changes the chosen setting")

    def _lend(self) -> None:
        """For some frames only: the engine sets it back by itself."""
        if not self.may_act():
            return
        if not self.tuning.tried:
            self.say("nothing is tried: ←→ changes the chosen setting")
            return

        def decided(text: str | None) -> None:
            if text is None:
                return
            if not (text.isdecimal() and 1 <= int(text) <= MOST_FRAMES):
                self.say(f"{text!r} is no number of frames from 1 to {MOST_FRAMES}", "warn")
                return
            self._set(self.tuning.tried, int(text))

        dialog = LineDialog("apply for so many frames", "how many", f"{USUAL_FRAMES}")
        self.app.push_screen(dialog, decided)

    def _undo(self) -> None:
        if not self.may_act():
            return
        wanted = self.tuning.undo()
        self._set(wanted)
        if not wanted:
            self.say("nothing to undo")
        self._try()

    def _set(self, wanted: Mapping[str, Value], frames: int | None = None) -> None:
        for name, value in wanted.items():
            self.tuning.replaced[name] = self.tuning.present.get(name)
            self.send(Set(name=name, value=value, frames=frames))

    def done_words(self, command: Command, outcome: Outcome) -> str:
        """A setting with its values: the engine's word says only that it took it."""
        if not isinstance(command, Set) or command.name not in self.tuning.replaced:
            return super().done_words(command, outcome)
        before = self.tuning.replaced[command.name]
        change = BY_NAME[command.name].change_words(before, command.value)
        lasts = "" if command.frames is None else f", for {command.frames} frames"
        return f"{change} from the next frame{lasts}"

    def _save(self) -> None:
        present = self.tuning.present | self.tuning.tried
        path = default_config_path().with_name(PRESETS)

        def decided(name: str | None) -> None:
            if not name:
                return
            try:
                save_preset(path, name, present)
                self.say(f"preset {name!r} is kept", "good")
            except ConfigError as error:
                self.say(str(error), "warn")

        self.app.push_screen(LineDialog("save as a preset", "a name"), decided)

    def _load(self) -> None:
        try:
            presets = load_presets(default_config_path().with_name(PRESETS))
        except ConfigError as error:
            self.say(str(error), "warn")
            return
        if not presets:
            self.say("no preset has been kept: w keeps one")
            return
        decided = partial(self._take_preset, presets)
        words = f"one of {', '.join(presets)}"
        self.app.push_screen(LineDialog("load a preset", words), decided)

    def _take_preset(self, presets: dict[str, dict[str, Value]], name: str | None) -> None:
        if not name:
            return
        if name not in presets:
            self.say(f"no preset is called {name!r}: there are {', '.join(presets)}", "warn")
            return
        self.tuning.load(presets[name])
        self._try()
