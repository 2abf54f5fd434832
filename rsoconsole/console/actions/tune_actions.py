"""Keys of the tuning pane: open it, change settings on trial, send them to the engine."""

import math
import time
from collections.abc import Mapping
from functools import partial

from rsoconsole.base import ConfigError
from rsoconsole.config import default_config_path
from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.dialogs.ask import LineDialog
from rsoconsole.console.tuning.lines import TuneWords, tune_lines
from rsoconsole.console.tuning.tuning_pane import (
    LAST_FRAMES,
    TuneFigures,
    TunePane,
    Tuning,
    load_presets,
    save_preset,
)
from rsoconsole.console.tuning.what_if_watch import (
    WhatIfWatch,
    count_present_settings_frames,
    lead_track_frames,
)
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.console.words.tunable import BY_NAME, NAMES, Value
from rsoconsole.control import MAX_FRAMES, Command, Set

PRESETS = "presets.toml"
USUAL_FRAMES = 5
EVERY_S, NEW_FRAME_S = 20.0, 5.0
"""Least seconds between requests of an open pane's figures: of the same frames, and of others."""


class TuneActions:
    """Computes a night's figures with changed settings; sends settings, handles presets."""

    def __init__(self, seat: OperatorScreen) -> None:
        self._seat = seat
        self.is_open = False
        self.figures = TuneFigures()
        self.tuning = Tuning()
        self._watch: WhatIfWatch | None = None
        self._computed_s = 0.0
        self._computed_of = (0, 0)
        self._applied: list[str] = []
        """Changes that the engine has accepted of the settings sent last, in words."""

    @property
    def pane(self) -> TunePane:
        """The widget of the tuning pane."""
        return self._seat.query_one(TunePane)

    def action_tune(self) -> None:
        """Open the tuning pane and give it the keys; pressed again: close it."""
        seat = self._seat
        pane = self.pane
        if self.is_open and pane.has_focus:
            self.close()
            return
        self.is_open = True
        pane.tuning = self.tuning
        seat.place_panes()
        pane.can_focus = True
        seat.set_focus(pane)
        self.show()
        seat.show_keys()
        self.request_figures()
        if self._watch is not None:
            self._watch.prepare()

    def close(self) -> None:
        """Close the tuning pane; changed settings that were not sent are kept."""
        seat = self._seat
        self.is_open = False
        self.pane.can_focus = False
        seat.set_focus(None)
        seat.forget_notice()  # what was said of the pane ends with it
        seat.place_panes()
        seat.show_keys()

    def show(self) -> None:
        """Draw the tuning pane; the settings in force are read from the record."""
        had_changes = bool(self.tuning.changes)
        self.tuning.see({name: self._seat.night.setting(name) for name in NAMES})
        if had_changes and not self.tuning.changes:
            self.figures = TuneFigures(now=self.figures.now)
            self.request_figures()  # what was tried is in force: its figures are those of the night
        self.pane.show(tune_lines(self.tuning, self.figures, words=self.words))
        then = self.figures.then if self.tuning.changes and self.is_open else None
        self._seat.show_bounds_on_trial({} if then is None else then.lead_sigmas_arcsec)

    def _forget_trial(self) -> None:
        self.figures = self.figures._replace(then=None, settled_then=None)

    @property
    def words(self) -> TuneWords:
        """The pane's texts: which frames the figures cover, and the keys that it offers."""
        return TuneWords(
            of_present=self.frames_with_present_settings(),
            aims_by_orbit=self._seat.aims_by_orbit,
            learnt=self._learnt_words(),
        )

    def _learnt_words(self) -> str:
        """Return what the filter has learnt of the night's noise; empty: nothing."""
        track = self._seat.night.track
        if track is None:
            return ""
        if track.mixture is not None:
            wider = math.sqrt(track.mixture.variance_scale)
            return f"learnt: ±{track.mixture.scatter_s:.2g} s, errors ×{wider:.2g}"
        return "" if track.q_scale == 1.0 else f"learnt: Q ×{track.q_scale:.2g}"

    def frames_with_present_settings(self) -> int | None:
        """Return how many of the figures' frames ran with the settings in force; None: unknown."""
        now = self.figures.now
        if now is None:
            return None
        return count_present_settings_frames(self._seat.night, now.frames)

    def figures_scope(self) -> tuple[int | None, int | None]:
        """Return the figures' span: (last ``seq`` of the log, number of last frames).

        The first is None for the log's end, the second None for all frames.
        """
        return None, self.last_frame_count()

    def last_frame_count(self) -> int:
        """Return how many of the lead's last frames the figures cover."""
        return len(lead_track_frames(self._seat.night)) or LAST_FRAMES

    @property
    def _frames_of_lead(self) -> tuple[int, int]:
        """First and last frame of the lead track."""
        night = self._seat.night
        return night.track_frame_id, night.rows[-1].frame_id if night.rows else 0

    def request_figures(self) -> None:
        """Request the figures: as recorded, and with the changed settings."""
        seat = self._seat
        if seat.night.folder is None or seat.night.config is None:
            return
        self._computed_s, self._computed_of = time.monotonic(), self._frames_of_lead
        until_seq, last = self.figures_scope()
        self._started_watch().ask(
            seat.night.folder,
            seat.night.config,
            self.tuning.changes,
            in_force=self.tuning.present_settings,
            until_seq=until_seq,
            last=last,
        )

    def _started_watch(self) -> WhatIfWatch:
        if self._watch is None:
            between = partial(call_between_messages, self._seat)
            self._watch = WhatIfWatch(
                partial(between, self.show_figures), partial(between, self._take_proposal)
            )
        return self._watch

    def _propose(self) -> None:
        """Request the likeliest Q and R of the night so far."""
        night = self._seat.night
        if night.folder is None or night.config is None:
            return
        self._started_watch().propose(night.folder, night.config)
        self._seat.say("seeking the likeliest Q and R of this night: up to a minute or two")

    def _take_proposal(self, changes: Mapping[str, Value], words: str) -> None:
        """Put proposed settings on trial, and say the verdict."""
        self._seat.say(f"proposal: {words}", "good" if changes else "title")
        if changes:
            self.tuning.load({**self.tuning.changes, **changes})
        self._preview()

    def refresh_stale_figures(self) -> None:
        """Request the figures of a visible pane, where the last ones are of other frames, or old.

        What is on trial takes a process some seconds: it is computed for old ones alone.
        """
        if not self._seat.night.is_read:
            return  # nobody knows yet over how many frames
        is_new = not self.tuning.changes and self._computed_of != self._frames_of_lead
        is_due = time.monotonic() - self._computed_s >= (NEW_FRAME_S if is_new else EVERY_S)
        if self.pane.display and is_due:
            self.request_figures()

    def show_figures(self, figures: TuneFigures, fault: str) -> None:
        """Show the figures, or the fault where they could not be computed."""
        if fault:
            self._seat.say(fault, "warn")
            return
        self.figures = figures
        self.show()

    def end_figures_thread(self) -> None:
        """End the thread that computes the figures."""
        if self._watch is not None:
            self._watch.close()

    def handle_pane_request(self, message: TunePane.Wanted) -> None:
        """Run the action that a key of the pane requested."""
        if message.what == "type":
            self._type(message.begun)
            return
        {
            "try": self._preview,
            "apply": self._apply,
            "lend": self._apply_for_frames,
            "undo": self._undo,
            "save": self._save,
            "load": self._load,
            "propose": self._propose,
            "close": self.close,
        }[message.what]()

    def _type(self, begun: str) -> None:
        """Ask for a number for the chosen setting."""
        seat = self._seat
        tunable = self.tuning.tunables[self.tuning.row]
        if self.tuning.present.get(tunable.name) is None:
            return
        if tunable.choices:
            seat.say(f"{tunable.label} is chosen with ←→: {', '.join(tunable.choices)}", "warn")
            return

        def decided(text: str | None) -> None:
            if not text:
                return
            fault = self.tuning.type(text)
            if fault:
                seat.say(fault, "warn")
                return
            self._preview()

        words = f"from {tunable.low:g} to {tunable.high:g}"
        title = f"{tunable.label}{tunable.unit}: a number {words}"
        dialog = LineDialog(title, words, begun, goes_on=True)
        seat.app.push_screen(dialog, decided)

    def _preview(self) -> None:
        self._forget_trial()
        self.show()
        self.request_figures()

    def _apply(self) -> None:
        if not self._seat.check_can_act():
            return
        wanted = self.tuning.apply()
        self._set(wanted)
        self.show()
        if not wanted:
            self._seat.say("nothing is tried: ←→ changes the chosen setting")

    def _apply_for_frames(self) -> None:
        """Ask for a number of frames, and send the changed settings for that long."""
        seat = self._seat
        if not seat.check_can_act():
            return
        if not self.tuning.changes:
            seat.say("nothing is tried: ←→ changes the chosen setting")
            return

        def decided(text: str | None) -> None:
            if text is None:
                return
            if not (text.isdecimal() and 1 <= int(text) <= MAX_FRAMES):
                seat.say(f"{text!r} is no number of frames from 1 to {MAX_FRAMES}", "warn")
                return
            self._set(self.tuning.changes, int(text))

        dialog = LineDialog("apply for a number of frames", "how many", f"{USUAL_FRAMES}")
        seat.app.push_screen(dialog, decided)

    def _undo(self) -> None:
        if not self._seat.check_can_act():
            return
        had_trial = bool(self.tuning.changes)
        wanted = self.tuning.undo()
        self._set(wanted)
        if not wanted:
            self._seat.say("nothing is on trial any more" if had_trial else "nothing to undo")
        self._preview()

    def _set(self, wanted: Mapping[str, Value], frames: int | None = None) -> None:
        self._applied = []
        for name, value in wanted.items():
            self.tuning.replaced[name] = self.tuning.present.get(name)
            self._seat.send(Set(name=name, value=value, frames=frames))

    def take_applied(self, command: Command) -> str:
        """Take an accepted setting; return what was changed with it: "Q× 1 → 2.25 from the next
        frame".

        Empty for other commands, and for a setting that was not set at this console.
        """
        if not isinstance(command, Set) or command.name not in self.tuning.replaced:
            return ""
        before = self.tuning.replaced[command.name]
        self._applied.append(BY_NAME[command.name].change_words(before, command.value))
        lasts = "" if command.frames is None else f", for {command.frames} frames"
        return f"{' · '.join(self._applied)} from the next frame{lasts}"

    def _save(self) -> None:
        seat = self._seat
        present = self.tuning.present | self.tuning.changes
        path = default_config_path().with_name(PRESETS)

        def decided(name: str | None) -> None:
            if not name:
                return
            try:
                save_preset(path, name, present)
                seat.say(f"preset {name!r} is kept", "good")
            except ConfigError as error:
                seat.say(str(error), "warn")

        seat.app.push_screen(LineDialog("save as a preset", "a name"), decided)

    def _load(self) -> None:
        seat = self._seat
        try:
            presets = load_presets(default_config_path().with_name(PRESETS))
        except ConfigError as error:
            seat.say(str(error), "warn")
            return
        if not presets:
            seat.say("no preset has been kept: w keeps one")
            return
        decided = partial(self._take_preset, presets)
        words = f"one of {', '.join(presets)}"
        seat.app.push_screen(LineDialog("load a preset", words), decided)

    def _take_preset(self, presets: dict[str, dict[str, Value]], name: str | None) -> None:
        if not name:
            return
        if name not in presets:
            self._seat.say(f"no preset is called {name!r}: there are {', '.join(presets)}", "warn")
            return
        self.tuning.load(presets[name])
        self._preview()
