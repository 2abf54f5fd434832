"""Dialogs that list a frame's streaks, and the last measurements to reject one of them."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.events import Key
from textual.widgets import Button, Static

from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.dialogs.dialogs import Dialog, PagedDialog, dialog_box
from rsoconsole.night import (
    NightFrame,
    RecentMeasurement,
    is_measurement_of,
    light_of_streak,
)
from rsoconsole.records import Detection, Measurement, StreakLight, is_mark_id
from rsoconsole.words import (
    angle,
    light_detail_words,
    magnitude_words,
    short_figure,
    streak_name,
    streak_pulse_words,
    streak_size_words,
    text,
    utc_text,
)

COLUMNS = 70
MARKED = "the frame you marked"
SAME_STREAK_PX = 25.0
"""A mark and a streak this near, middle to middle in pixels, are the same; or half its length."""
MAX_REJECTED = 12


class CandidatesDialog(PagedDialog[None]):
    """Dialog of a frame's streaks, the likeliest first; or of two frames' streaks, a page each."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("v,q", "put_away", "Back", show=False),
        Binding("tab", "other_frame", "Other frame", show=False),
    ]

    def __init__(
        self,
        frames: Sequence[tuple[NightFrame, str]],
        tau: float,
        keymap: Mapping[str, str] | None = None,
    ) -> None:
        """Make the dialog.

        ``frames``: one or two of (frame, note on it); the note of the shown frame is empty.
        ``tau``: the confidence from which on candidates are detections.
        ``keymap``: other keys for commands, by the command's name.
        """
        super().__init__()
        self._frames, self._tau, self._at = frames, tau, 0
        self._keys = [first_key(name, keymap) for name in ("follow_next", "accept", "reject")]

    def action_other_frame(self) -> None:
        """Show the other frame's streaks."""
        self._at = (self._at + 1) % len(self._frames)
        self.show()

    def page(self) -> tuple[str, str, str]:
        """Return the title, the keys and the text of the shown frame's page."""
        detail, which = self._frames[self._at]
        taken = detail.taken
        number = "" if taken is None else f" of frame {taken.frame_id:04d}"
        title = f"streaks{number}{f', {which}' if which else ''}"
        other = self._frames[(self._at + 1) % len(self._frames)][1] or "the newest frame"
        keys = f"tab {other} · esc back" if len(self._frames) > 1 else "esc back"
        help_ = (
            "Back on the screen, in the newest frame: {} follows the next one,"
            " {} takes the likeliest, {} rejects.".format(*self._keys)
        )
        return title, keys, "\n".join([*candidate_lines(detail, self._tau), "", help_])


def candidate_lines(detail: NightFrame, tau: float) -> list[str]:
    """Return a frame's streaks as text: a line for each, then its reason if there is one.

    ``tau``: confidence that a detection must exceed.
    """
    found = detail.detections
    if found is None:
        return ["It is not known yet what the frame shows."]
    lines: list[str] = []
    for each in sorted(found.detections, key=lambda d: -d.confidence):
        light = light_of_streak(detail, each)
        lines += _lines(each, *detection_outcome(each, detail), light=light)
    rejected = sorted(found.rejected, key=lambda r: -r.detection.confidence)
    for one in rejected[:MAX_REJECTED]:
        light = light_of_streak(detail, one.detection)
        lines += _lines(one.detection, "rejected", text(one.reason), light=light)
    for each_mark in _by_hand(detail):
        place = f"at {each_mark.x_px:.0f}, {each_mark.y_px:.0f}"
        lines.append(f"  by your hand, {place}: {_sigmas(each_mark)}")
        magnitude = magnitude_words(detail.light_of(each_mark.measurement_id))
        lines += [f"        {magnitude}"] if magnitude else []
    if not lines:
        lines = ["  None: the network proposed nothing."]
    left = len(rejected) - MAX_REJECTED
    if left > 0:
        lines.append(f"  and {left} less likely ones, rejected")
    head = f"confidence against τ {short_figure(tau)}; x, y in pixels of the frame"
    return [head, "", *lines]


def _by_hand(detail: NightFrame) -> list[Measurement]:
    """Return the operator's marks in the frame, each once."""
    found = (
        m
        for m in detail.all_measurements
        if m.source == "operator" and is_mark_id(m.measurement_id)
    )
    return list({m.measurement_id: m for m in found}.values())


def _sigmas(measured: Measurement) -> str:
    east, _, north = measured.cov_sky_arcsec2
    return f"±{short_figure(east**0.5)}″ RA ±{short_figure(north**0.5)}″ Dec"


def detection_outcome(streak: Detection, detail: NightFrame) -> tuple[str, str]:
    """Return a detection's (outcome, reason), such as ("not taken", why) or ("followed", NIS)."""
    followed = detail.accepted_measurement
    if followed is not None and is_mark_id(followed.measurement_id):
        if _is_same(streak, followed, detail):
            return "set aside", "your mark in its place is followed"
    elif is_measurement_of(streak, followed):
        nis = detail.updated.nis if detail.updated is not None else None
        return "followed", "" if nis is None else f"NIS {nis:.1f}"
    for refused in detail.not_followed:
        if is_measurement_of(streak, refused.measurement):
            return "not taken", text(refused.reason)
    if any(is_measurement_of(streak, m) for m in detail.measurements):
        return "measured", ""
    return "not measured", "the frame has no place on the sky"


def _is_same(streak: Detection, mark: Measurement, detail: NightFrame) -> bool:
    """Return True if ``streak`` is what ``mark`` marked: the nearest detection, and near."""
    found = () if detail.detections is None else detail.detections.detections

    def away(each: Detection) -> float:
        return math.hypot(each.x_px - mark.x_px, each.y_px - mark.y_px)

    is_nearest = away(streak) == min(map(away, found), default=math.inf)
    return is_nearest and away(streak) < max(SAME_STREAK_PX, 0.5 * streak.length_px)


def _lines(
    streak: Detection, fate: str, reason: str, *, light: StreakLight | None = None
) -> list[str]:
    size = streak_size_words(streak) if streak.length_px else ""
    place = f"at {streak.x_px:.0f}, {streak.y_px:.0f}"
    snr = f"SNR {streak.snr:.0f}" if streak.snr else ""
    confidence = short_figure(streak.confidence)
    head = f"  {confidence:>4}  {fate:<12}  {place:<14}  {snr:<8}  {size}".rstrip()
    bright = light_detail_words(light, with_colour=False)
    parts = (*bright, streak_name(streak), streak_pulse_words(streak))
    named = "; ".join(words for words in parts if words)
    return [
        head,
        *textwrap.wrap(named, COLUMNS, initial_indent=" " * 8, subsequent_indent=" " * 8),
        *textwrap.wrap(reason, COLUMNS, initial_indent=" " * 8, subsequent_indent=" " * 8),
    ]


SOURCES = {"network": "detector", "operator": "by hand"}


def measurement_words(each: RecentMeasurement) -> str:
    """Return a measurement in words: frame, time, source, sigma, NIS."""
    sigma = f"±{angle(each.sigma_arcsec)}"
    nis = "" if each.nis is None else f"NIS {each.nis:.1f}"
    source = SOURCES.get(each.source, each.source)
    time = utc_text(each.t_utc_ns)
    return f"frame {each.frame_id:04d}  {time}  {source:<8}  {sigma:>7}  {nis}".rstrip()


class RejectDialog(Dialog[int | None]):
    """Dialog of the last measurements, to reject one. Result: the measurement's frame, or None."""

    ANSWERS = None

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "newest", "The newest", show=False),
        Binding("q", "put_away", "Back", show=False),
    ]

    def __init__(self, measured: Sequence[RecentMeasurement]) -> None:
        super().__init__()
        self._measured = measured

    def compose(self) -> ComposeResult:
        """Make one button for each measurement, the newest first."""
        with dialog_box("reject a measurement", "1-9 or enter rejects · esc back"):
            words = "Which one was something else? The track is as if without it."
            yield Static(words, markup=False)
            with Vertical(classes="choices"):
                for number, each in enumerate(self._measured, start=1):
                    yield Button(
                        f"{number}  {measurement_words(each)}",
                        id=f"measured-{number}",
                        compact=True,
                    )

    def on_mount(self) -> None:
        """Give the focus to the newest measurement."""
        self.query(Button).first().focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Close with the frame number of the measurement whose button was pressed."""
        event.stop()
        self._choose(int(str(event.button.id).removeprefix("measured-")))

    def on_key(self, event: Key) -> None:
        """Close with the frame number of the measurement whose digit was typed."""
        if event.key.isdigit() and 1 <= int(event.key) <= len(self._measured):
            event.stop()
            self._choose(int(event.key))

    def action_newest(self) -> None:
        """Close with the newest measurement; bound to the key that also opens the dialog."""
        self._choose(1)

    def _choose(self, number: int) -> None:
        self.dismiss(self._measured[number - 1].frame_id)
