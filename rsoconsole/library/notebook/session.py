"""Sessions in Python, live or closed: ``open_session`` for notebooks and scripts.

The record is only read, never changed; derived data go to ``branches/``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.base import SessionError
from rsoconsole.config import load_config
from rsoconsole.library.formats.tables import as_data_frame, as_table, import_notebook_extra
from rsoconsole.library.notebook import card
from rsoconsole.library.notebook._pictures import SessionPictures
from rsoconsole.night import Row, lead_summary, public_table_rows, state_spans
from rsoconsole.records import TABLES, Column
from rsoconsole.session import paths_in
from rsoconsole.session.log import schema
from rsoconsole.words import date_span_words, settings_words

if TYPE_CHECKING:
    from rsoconsole.library.notebook._what_if import WhatIf
    from rsoconsole.library.notebook.panel.panel import LivePanel
    from rsoconsole.pipeline import ReplayedFrame

BRANCHES = "branches"


def open_session(path: Path | str | None = None) -> "Session":
    """Open a session by its folder; None: your newest session (in ``session.root``).

    The folder may also be that of a branch, or of a session that is still open: ``refresh()`` reads
    what is new. Raises SessionError when the folder holds no session, when it cannot be read, and
    with None when there is no session yet.

    >>> night = open_session("sessions/intelsat-14")
    >>> night.measurements["direction"], night.plot_residuals()
    """
    if path is None:
        return Session(_newest(load_config().session.root))
    folder = Path(path).expanduser()
    return Session(folder.parent if folder.name == schema.DATABASE else folder)


def live_panel(socket: Path | str | None = None, *, read_only: bool = False) -> "LivePanel":
    """Open a panel on the running engine in a notebook: its state, picture, orders, STOP.

    ``socket``: the engine's control socket; None: that of this user's engine. ``read_only``: the
    panel sends nothing but STOP. Without an engine the panel says so and waits for one. Raises
    RsoconsoleError where the extra ``rsoconsole[notebook]`` is not installed.
    """
    import_notebook_extra("anywidget", "a live panel")
    from rsoconsole.library.notebook.panel.panel import LivePanel

    return LivePanel(socket, read_only=read_only)


def _newest(root: Path) -> Path:
    """The session that was written to last."""

    def written_ns(folder: Path) -> int:
        parts = (folder / schema.DATABASE, folder / f"{schema.DATABASE}-wal")
        return max(part.stat().st_mtime_ns for part in parts if part.exists())

    found = [folder for folder in paths_in(root) if (folder / schema.DATABASE).exists()]
    if not found:
        raise SessionError(
            f"there is no session in {root} yet: name a folder, as in "
            "open_session('sessions/intelsat-14'), or let 'rsoconsole demo' make one"
        )
    return max(found, key=written_ns)


def _table(name: str, words: str) -> Any:
    return property(lambda self: self.table(name), doc=f"{words}, an astropy QTable.")


class Session(SessionPictures):
    """One observing session, recorded or live; made by ``open_session``."""

    frames = _table("frames", "Every exposure")
    detections = _table("detections", "Every streak")
    rejections = _table("rejections", "Every candidate that was not taken, and why")
    solutions = _table("solutions", "Every plate solution")
    not_solved = _table("not_solved", "Every frame without one, and why")
    measurements = _table("measurements", "Every direction measured, with its covariance")
    not_followed = _table("not_followed", "Measurements that the track did not take, and why")
    track = _table("track", "The filter's states: predicted, initial, updated")
    slews = _table("slews", "Orders to the mount")
    misses = _table("misses", "Exposures without the object, and why")
    orbits = _table("orbits", "The orbit after each measurement")
    identifications = _table("identifications", "Which catalogued object a track is of")
    states = _table("states", "Changes of the loop's state")
    parameters = _table("parameters", "Settings that were changed")
    actions = _table("actions", "What operators wanted, and what came of it")
    events = _table("events", "The log in words")
    timings = _table("timings", "Wall time of every stage of every cycle")

    # -- tables ---------------------------------------------------------------------------------

    @property
    def table_names(self) -> tuple[str, ...]:
        """Names of the session's tables, for ``table`` and ``frame``."""
        return tuple(TABLES)

    def table(self, name: str) -> Any:
        """Return one of the session's tables as an astropy ``QTable``; floats are exact.

        Columns are named as in ``sessions/README.md`` and have their units; instants ``*_utc_ns``
        are ``Time`` columns ``*_utc``, and directions have a ``SkyCoord`` column ``direction``
        beside their degrees. Raises SessionError for an unknown name.
        """
        columns, rows = self._rows(name)
        return as_table(columns, rows, {"session": self.title, "table": name})

    def frame(self, name: str) -> Any:
        """Return one of the session's tables as a pandas ``DataFrame``, with timestamps.

        Needs ``rsoconsole[notebook]``.
        """
        return as_data_frame(*self._rows(name))

    def _rows(self, name: str) -> tuple[tuple[Column, ...], list[Row]]:
        if name not in TABLES:
            raise SessionError(f"there is no table {name!r}; there are {', '.join(TABLES)}")
        files = self._reader.view_rows("frames") if name == "frames" else ()
        return TABLES[name].columns, public_table_rows(name, self._log, files)

    # -- again, and otherwise -------------------------------------------------------------------

    def replay(self) -> "tuple[ReplayedFrame, ...]":
        """Process every recorded frame again with the session's settings; return the frames.

        A frame's ``is_as_recorded`` is True where the result has the same bits as the recorded
        result. On another processor the last digits may differ: ``is_alike`` allows for that.
        """
        from rsoconsole.pipeline import replay

        return tuple(replay((record for _, _, record in self._log), self.config))

    def what_if(
        self,
        settings: Mapping[str, float | str] | None = None,
        *,
        tau: float | None = None,
        q: float | None = None,
        sigma: float | None = None,
        r: float | None = None,
        preset: str | None = None,
        **others: float | str,
    ) -> "WhatIf":
        """Follow the night again with other settings, for comparison with the recorded night.

        ``settings``: any settings by dotted name.
        ``tau``: the confidence that a detection must exceed.
        ``q``: factor of the whole of Q.
        ``sigma``: error of a measurement as in the paper, arcsec; used with preset "paper".
        ``r``: factor of the whole of R.
        ``preset``: "adaptive", "tuned" or "paper".
        ``others``: any setting of ``[filter]`` by its name, e.g. ``gate_nis=9``.
        Raises ConfigError for an unknown setting and an invalid value.
        """
        from rsoconsole.library.notebook._what_if import WhatIf

        named = {
            "detector.tau": tau,
            "filter.q_multiplier": q,
            "filter.sigma_arcsec": sigma,
            "filter.r_multiplier": r,
            "filter.preset": preset,
        }
        changes: dict[str, float | str] = {n: v for n, v in named.items() if v is not None}
        changes |= {f"filter.{name}": value for name, value in others.items()} | dict(
            settings or {}
        )
        return WhatIf(self, changes)

    @property
    def branches(self) -> "dict[str, Session]":
        """Saved what-ifs by name; each is a session of its own."""
        root = self.path / BRANCHES
        folders = sorted(root.iterdir()) if root.is_dir() else []
        return {f.name: Session(f) for f in folders if (f / schema.DATABASE).is_file()}

    def export(
        self,
        format: str,  # noqa: A002 -- as the verb has it
        out: Path | str | None = None,
        *,
        force: bool = False,
    ) -> Path:
        """Write the session in another format, as ``rsoconsole export`` does; return the path.

        ``format``: csv, ecsv, jsonl, tdm, tdm-xml, iod, udl, fits, regions or html; for score
        ``rso.to_score`` asks for what it needs. ``force``: overwrite an existing file. Raises
        ExportError for another format, and for an existing file (unless ``force``).
        """
        from rsoconsole.library.formats.api import ExportOptions, export, save_text

        place = None if out is None else Path(out).expanduser()
        if format == "html":
            from rsoconsole.library.notebook.report.report import render_report

            report = render_report(self.path)
            made = save_text(self.path, report.html, report.made, place, is_forced=force)
        else:
            kind: Any = format
            made = export(self.path, kind, place, ExportOptions(is_forced=force))
        assert made.path is not None
        return made.path

    def live(self, socket: Path | str | None = None, *, read_only: bool = False) -> "LivePanel":
        """Open the panel on the engine that writes this session (needs ``rsoconsole[notebook]``).

        ``socket``, ``read_only``: as for ``live_panel``. Raises ControlError when no engine runs,
        or when it writes another session.
        """
        from rsoconsole.base import ControlError
        from rsoconsole.control import ControlClient, Sender, ask_status

        path = None if socket is None else Path(socket)
        written = ask_status(ControlClient(path, sender=Sender(name="notebook"))).session
        if written is None or not _is_same(written, self.path):
            raise ControlError(
                f"the running engine writes {written}, not {self.path}: live_panel() shows that one"
            )
        return live_panel(path, read_only=read_only)

    # -- what a notebook shows of it ------------------------------------------------------------

    def __repr__(self) -> str:
        return f"<Session {self.title!r}, {len(self._night().frames)} frames, {self.path}>"

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        printer.text(repr(self) if cycle else card.card_text(self._card()))

    def _repr_html_(self) -> str:
        return card.card_html(self._card())

    def _card(self) -> card.SessionCard:
        night = self._night()
        try:
            picture = self.picture()
        except SessionError:
            picture = None
        parent, changes = self._about.get("branch_of"), self._about.get("tried")
        changes = changes if isinstance(changes, Mapping) else {}
        t_first, t_last = (self._log[0][1], self._log[-1][1]) if self._log else (None, None)
        return card.SessionCard(
            title=self.title,
            folder=str(self.path),
            when=date_span_words(t_first, t_last),
            is_live=not self.is_closed,
            branch_of=None if parent is None else (self.path / str(parent)).resolve().name,
            changes=settings_words(changes),
            frames=self._reader.counts().frames,
            kept=len(self._kept()),
            summary=lead_summary(night.frames),
            spells=state_spans(self._log),
            misses=tuple(f.t_mid_utc_ns for f in night.frames if f.lead_miss_reason is not None),
            picture=picture,
        )


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return one.absolute() == other.absolute()
