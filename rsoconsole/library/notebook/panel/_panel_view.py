"""Contents of the live panel, in words and small drawings; the page only places them."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError
from rsoconsole.config import PRESETS, Config, with_setting
from rsoconsole.control import (
    Status,
    fault_words,
    limit_words,
    mount_holder_words,
    mount_words,
    shutter_words,
    to_printable,
)
from rsoconsole.library.notebook.figures.draw_time import NIS_BAND
from rsoconsole.library.notebook.night import svg
from rsoconsole.library.notebook.night.night import DrawnNight, make_drawn_night, session_title
from rsoconsole.library.notebook.night.overlay import frame_caption, overlay_svg
from rsoconsole.night import Night, NightFrame, consistency_of
from rsoconsole.records import Record
from rsoconsole.session import SessionReader
from rsoconsole.words import altaz, direction, utc_text

LOG_LINES = 12
_FRAMES = 3
"""Newest frames whose picture may be shown: it may come later than its records."""


class LiveNight:
    """Session that a panel shows while it goes on.

    Its methods raise SessionError where it cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self._reader = SessionReader(folder)
        self.folder = folder
        self.begun_with = self._reader.config()
        """The configuration of the session's beginning."""
        self.records: list[Record] = []
        self.picture: tuple[int, bytes] | None = None
        """Newest preview on disk: (frame, PNG)."""
        about = self._reader.read_meta()
        self._title = session_title(about, folder)
        self.fold = Night(folder, about, self.begun_with, newest=None)

    def read_new_records(self) -> bool:
        """Read new records and the newest preview; return True where there was anything new."""
        before = self.fold.seq
        for seq, t_utc_ns, record in self._reader.records(since_seq=before):
            self.records.append(record)
            self.fold.fold_record(t_utc_ns, record, seq)
        return self._read_picture() or self.fold.seq != before

    def night(self) -> DrawnNight:
        """Return the session's frames so far."""
        return make_drawn_night(self._title, self.begun_with, self.fold.frames.kept_frames())

    @property
    def config(self) -> Config:
        """Configuration in force now: that of the session's beginning with all changes."""
        config = self.begun_with
        for name, value in self.fold.frames.settings.items():
            try:
                config = with_setting(config, name, value)
            except ConfigError:
                continue  # a setting of a later version
        return config

    def _read_picture(self) -> bool:
        for frame_id in self.fold.newest_frame_ids()[:_FRAMES]:
            if self.picture is not None and self.picture[0] >= frame_id:
                return False
            path = self._reader.preview_path(frame_id)
            if path is None:
                continue
            try:
                self.picture = frame_id, path.read_bytes()
            except OSError:
                continue  # the next frame's may be read
            return True
        return False


SHOWN_FRAMES = 60
NIS_TOP = 14.0
TUNED = (
    ("detector.tau", "τ", ""),
    ("filter.preset", "preset", ""),
    ("filter.sigma_arcsec", "σ", "″"),
    ("filter.q_arcsec2_s3", "q", "″²/s³"),
    ("filter.q_multiplier", "Q ×", ""),
    ("filter.r_multiplier", "R ×", ""),
    ("filter.gate_nis", "gate NIS", ""),
    ("filter.max_coast_s", "lost after", "s"),
)
"""Settings that the panel can change: (dotted name, label, unit); the console has all."""
CHOICES = {"filter.preset": PRESETS}


def status_view(status: Status, reach: str, detail: str, seat: str) -> dict[str, Any]:
    """Return the engine's status in words and plain values, by name, for the page.

    ``status``: the last one received; ``reach``: "attached", "silent" or "gone"; ``detail``: fault
    in words; ``seat``: this panel's name.
    """
    is_attached = reach == "attached"
    holder, is_ours = status.holder, bool(seat) and status.seat == seat
    return {
        "reach": reach,
        "detail": detail,
        "state": status.state or "-",
        "is_held": status.is_held,
        "holder": mount_holder_words(holder, "plain"),
        "is_autonomous": holder == "autonomy",
        "wants_resuming": status.is_held or holder == "operator",
        "frame": status.frame_id,
        "clock": utc_text(status.now_utc_ns),
        "alerts": fault_words(status) if is_attached else [],
        "facts": _facts(status),
        "health": [[each.name, each.ok, each.text] for each in status.health],
        "seat": {
            "holder": status.seat or "",
            "is_ours": is_ours,
            "asker": (status.seat_asked_by or "") if is_ours else "",
            "waits": bool(seat) and status.seat_asked_by == seat,
        },
    }


def night_view(live: LiveNight) -> dict[str, Any]:
    """Return the parts of the page by name: plots, marks over the preview, log, settings."""
    night = live.night()
    frame_id = None if live.picture is None else live.picture[0]
    frame = None if frame_id is None else live.fold.frame(frame_id)
    return {
        "title": night.title,
        "plots": newest_plots_svg(night),
        "overlay": "" if frame is None else overlay_svg(frame),
        "caption": "no picture yet" if frame is None else frame_caption(frame),
        "slew": _slew_words(live),
        "nis": _nis_words(night),
        "log": [
            [utc_text(each.t_utc_ns), each.level, to_printable(each.text)]
            for each in live.fold.log[-LOG_LINES:]
        ],
        "tunables": [
            [name, label, unit, _setting(live.config, name), list(CHOICES.get(name, ()))]
            for name, label, unit in TUNED
        ],
    }


def newest_plots_svg(night: DrawnNight) -> dict[str, str]:
    """Return plots of the newest frames as SVG, by name: confidence, both residuals, NIS."""
    newest = [(night.seconds_since_start(frame), frame) for frame in night.frames[-SHOWN_FRAMES:]]
    if not newest:
        return {}
    t_0, t_1 = newest[0][0], newest[-1][0]
    span = (t_0, t_1 if t_1 > t_0 else t_0 + 1.0)
    ends = utc_text(newest[0][1].t_mid_utc_ns), utc_text(newest[-1][1].t_mid_utc_ns)
    return {
        "confidence": _confidence(newest, span, ends),
        "east": _residual(newest, span, ends, 0, "Δα cos δ"),
        "north": _residual(newest, span, ends, 1, "Δδ"),
        "nis": _nis(newest, span, ends),
    }


_Timed = Sequence[tuple[float, NightFrame]]
"""Frames with their seconds since the night's first."""


def _confidence(newest: _Timed, span: tuple[float, float], ends: tuple[str, str]) -> str:
    axis = svg.PlotAxes(x=span, y=(0.0, 1.0))
    taken = [
        (t_s, f.lead_measured.confidence, f"frame {f.frame_id}: {f.lead_measured.confidence:.2f}")
        for t_s, f in newest
        if f.lead_measured is not None
    ]
    missed = [
        (t_s, 0.0, f"frame {f.frame_id}: {f.lead_miss_reason}")
        for t_s, f in newest
        if f.lead_miss_reason
    ]
    tau = svg.line_svg(axis, [(t_s, f.tau) for t_s, f in newest], colour=svg.GREY, dashed=True)
    marks = svg.dots_svg(axis, taken, colour=svg.RED)
    holes = svg.dots_svg(axis, missed, colour=svg.AMBER, hollow=True)
    tau_now = newest[-1][1].tau
    label = f"confidence of {len(taken)} measurements, {len(missed)} missed, tau {tau_now:g}"
    return svg.plot_svg(axis, (tau, marks, holes), label=label, ends=ends)


def _residual(
    newest: _Timed, span: tuple[float, float], ends: tuple[str, str], index: int, what: str
) -> str:
    points: list[tuple[float, float, str]] = []
    bounds: list[tuple[float, float]] = []
    for t_s, frame in newest:
        state = frame.updated
        if state is None or not state.innovation_arcsec or not state.sigma_innovation_arcsec:
            bounds.append((t_s, math.nan))
            continue
        value = state.innovation_arcsec[index]
        points.append((t_s, value, f"frame {frame.frame_id}: {value:+.2f}″"))
        bounds.append((t_s, 3.0 * state.sigma_innovation_arcsec[index]))
    widths = sorted(bound for _, bound in bounds if math.isfinite(bound)) or [1.0]
    # A single far wider bound, after a poor measurement, may leave the plot.
    usual = min(2.0 * widths[len(widths) // 2], widths[-1])
    reach = 1.15 * max([usual, *(abs(value) for _, value, _ in points)])
    axis = svg.PlotAxes(x=span, y=(-reach, reach))
    parts = (
        svg.line_svg(axis, [(span[0], 0.0), (span[1], 0.0)], colour=svg.GREY, dashed=False),
        svg.line_svg(axis, bounds, colour=svg.GREY, dashed=True),
        svg.line_svg(axis, [(t, -bound) for t, bound in bounds], colour=svg.GREY, dashed=True),
        svg.dots_svg(axis, points, colour=svg.RED),
    )
    label = f"residuals {what} of {len(points)} updates in their 3 sigma bounds, arcseconds"
    return svg.plot_svg(axis, parts, label=label, ends=ends)


def _nis(newest: _Timed, span: tuple[float, float], ends: tuple[str, str]) -> str:
    axis = svg.PlotAxes(x=span, y=(0.0, NIS_TOP))
    points = [
        (t_s, f.updated.nis, f"frame {f.frame_id}: NIS {f.updated.nis:.2f}")
        for t_s, f in newest
        if f.updated is not None and f.updated.nis is not None
    ]
    ideal = svg.line_svg(axis, [(span[0], 2.0), (span[1], 2.0)], colour=svg.GREY, dashed=False)
    parts = (svg.band_svg(axis, *NIS_BAND), ideal, svg.dots_svg(axis, points, colour=svg.BLUE))
    label = f"NIS of {len(points)} updates against its 95 % band"
    return svg.plot_svg(axis, parts, label=label, ends=ends)


def _nis_words(night: DrawnNight) -> str:
    said = consistency_of(night.frames)
    mean = "" if said.mean is None else f"NIS {said.mean:.2f} (ideal 2), "
    return f"{mean}{said.words}"


def _facts(status: Status) -> list[list[str]]:
    rows = []
    ra, dec = status.ra_icrs_deg, status.dec_icrs_deg
    if ra is not None and dec is not None:
        high = altaz(status.alt_deg, status.az_deg)
        rows.append(["track", f"{direction(ra, dec)}  {high}".rstrip()])
    if mount := mount_words(status, name=""):
        pier = (f"{status.pier_side} of the pier",) if status.pier_side else ()
        rows.append(["mount", " · ".join((*mount, *pier))])
    rows.append(["next limit", limit_words(status) or "none in sight"])
    rows.append(["shutter", shutter_words(status) or "closed"])
    return rows


def _slew_words(live: LiveNight) -> str:
    slew = live.fold.last_slew
    if slew is None:
        return "none ordered yet"
    place = direction(slew.ra_icrs_deg, slew.dec_icrs_deg)
    return f"{place} for {utc_text(slew.t_aim_utc_ns)}, {to_printable(slew.reason)}"


def _setting(config: Any, name: str) -> Any:
    section, _, key = name.partition(".")
    return getattr(getattr(config, section), key)
