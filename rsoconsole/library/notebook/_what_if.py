"""A recorded night followed again with other settings, beside the recorded result."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.config import Config, with_changes
from rsoconsole.library.notebook._recorded import RecordedSession
from rsoconsole.library.notebook.figures.figures import NightPlots
from rsoconsole.library.notebook.night.night import DrawnNight, make_drawn_night
from rsoconsole.library.notebook.night.svg import escape_markup
from rsoconsole.night import LeadSummary, NightFrames, lead_summary, merit
from rsoconsole.pipeline import ReplayedFrame, replay
from rsoconsole.records import FrameTaken, ParameterChange
from rsoconsole.words import settings_words

_CELL = "padding:1px 14px 1px 0;text-align:left"
_TABLE = "border-collapse:collapse;margin:4px 0;color:inherit;font-size:inherit"


class WhatIf(NightPlots):
    """A night followed again with other settings (``Session.what_if``); plots show both nights."""

    def __init__(self, session: RecordedSession, changes: Mapping[str, float | str]) -> None:
        """Follow the night again with ``changes``, settings by dotted name.

        Raises ConfigError for a setting that is not valid.
        """
        self.session = session
        self.settings = dict(changes)
        log = session.records
        self.frames = tuple(replay((r for _, _, r in log), session.config, changes=changes))
        """Frames followed again: ``recorded`` is the result on record, ``records`` the new one."""
        config = with_changes(session.config, changes)
        title = f"tried {self.words}" if changes else "as recorded"
        self._night = _night_of(title, config, log, self.frames)
        self._recorded = session.nights()[0]

    @property
    def words(self) -> str:
        """The changed settings, in words."""
        return settings_words(self.settings)

    @property
    def recorded(self) -> LeadSummary:
        """Figures of merit of the night as recorded."""
        return self.session.summary

    @property
    def changed(self) -> LeadSummary:
        """Figures of merit of the night with the changed settings."""
        return lead_summary(self._night.frames)

    def nights(self) -> tuple[DrawnNight, ...]:
        """Return the night as recorded, and the night with the changed settings."""
        return self._recorded, self._night

    def save(self, name: str, *, force: bool = False) -> Path:
        """Save the result as a branch of the session, ``branches/NAME``; return its folder.

        The session's own record is not changed. ``force``: overwrite a branch of that name. Raises
        SessionError for a name that exists (unless ``force``) or is not allowed, and where the
        branch cannot be written.
        """
        from rsoconsole.pipeline import save_branch, what_if_session

        return save_branch(what_if_session(self.session.path, self.settings), name, force=force)

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield rows of text: name of a figure of merit, value as recorded, value as changed."""
        old, new = self.recorded, self.changed
        for each in merit.NIGHT:
            yield each.label, each.words(old), each.words(new)

    def __repr__(self) -> str:
        lines = [f"what if {self.words or 'nothing were changed'}: {self.session.title}"]
        lines.append(f"  {'':<15}{'as recorded':>16}{'if tried':>16}")
        lines += [f"  {what:<15}{old:>16}{new:>16}" for what, old, new in self.rows()]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr style="background:none"><th scope="row" style="{_CELL};font-weight:normal;'
            f'opacity:0.72">{escape_markup(what)}</th><td style="{_CELL}">{escape_markup(old)}</td>'
            f'<td style="{_CELL};{"font-weight:600" if old != new else ""}">'
            f"{escape_markup(new)}</td></tr>"
            for what, old, new in self.rows()
        )
        return (
            '<div class="rsoconsole-what-if" style="color:var(--jp-ui-font-color1,inherit);'
            'font-size:13px"><div style="font-weight:600">What if '
            f"{escape_markup(self.words or 'nothing were changed')}?"
            f" {escape_markup(self.session.title)}</div>"
            f'<table style="{_TABLE}"><tr style="background:none"><td></td>'
            f'<th style="{_CELL}">as recorded</th><th style="{_CELL}">if tried</th></tr>'
            f"{rows}</table></div>"
        )


def _night_of(
    title: str,
    config: Config,
    log: tuple[tuple[int, int, Any], ...],
    frames: tuple[ReplayedFrame, ...],
) -> DrawnNight:
    """The night as followed again; what was not followed keeps its place in time."""
    fold = NightFrames(config)
    for _, _, record in log:
        if isinstance(record, FrameTaken):
            fold.fold_record(record)
    for each in frames:
        tau = each.config.detector.tau
        fold.fold_record(ParameterChange(name="detector.tau", before=tau, after=tau, by="what-if"))
        for record in (each.taken, *each.observations.measurements, *each.records):
            fold.fold_record(record)
    return make_drawn_night(title, config, fold.kept_frames())
