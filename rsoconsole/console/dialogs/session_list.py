"""Dialog of the recorded nights, the newest first, each with its branches."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from textual.widgets import Input

from rsoconsole.base import SessionError
from rsoconsole.config import expand_home
from rsoconsole.console.dialogs._list_dialog import ListDialog
from rsoconsole.console.drawing.plot import Ink
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.control import one_line
from rsoconsole.session import DATABASE, SessionSummary, last_write_utc_ns, paths_in, summarise
from rsoconsole.words import duration_words, file_size, utc_text

BRANCHES = "branches"
MIN_NAME_COLUMNS = 20
State = Literal["", "live", "closed", "cut off", "other version", "damaged"]
HEADS = ("when, UTC", "length", "frames", "size", "state")
STATE_INKS: dict[State, Ink] = {"live": "good", "cut off": "warn", "damaged": "alarm"}
WHEN_COLUMNS, LENGTH_COLUMNS, FRAMES_COLUMNS, SIZE_COLUMNS, STATE_COLUMNS = 16, 6, 6, 8, 8


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionEntry:
    """A row of the list: a session, or a branch of a session."""

    folder: Path
    is_branch: bool = False
    summary: SessionSummary | None = None
    """The session's contents in figures; None until read."""
    state: State = ""

    @property
    def name(self) -> str:
        """The folder's name without control characters, for display."""
        return one_line(self.folder.name)

    def has(self, words: str) -> bool:
        """Return True if all typed words are in the session's name or title."""
        title = self.summary.title or "" if self.summary is not None else ""
        text = f"{self.folder.parent.parent.name if self.is_branch else ''} {self.name} {title}"
        return all(word in text.lower() for word in words.lower().split())


def sessions_under(root: Path, present: Path | None) -> list[SessionEntry]:
    """Return every session under ``root``, the newest first, each followed by its branches.

    No session is opened. ``present``: the session shown now, listed wherever it lies. Raises
    SessionError when ``root`` cannot be read.
    """
    folders = [path for path in paths_in(root) if (path / DATABASE).exists()]
    if present is not None and present.parent.name == BRANCHES:
        present = present.parent.parent
    if present is not None and not any(_is_same(present, folder) for folder in folders):
        folders.append(present)
    newest = sorted(folders, key=last_write_utc_ns, reverse=True)
    return [entry for folder in newest for entry in _with_branches(folder)]


def add_summary(entry: SessionEntry) -> SessionEntry:
    """Return the entry with its session's summary and state ("damaged": unreadable)."""
    summary = summarise(entry.folder)
    state: State = "damaged" if summary.state == "unreadable" else summary.state
    return replace(entry, summary=summary, state=state)


def _with_branches(folder: Path) -> Iterator[SessionEntry]:
    yield SessionEntry(folder=folder)
    with contextlib.suppress(OSError):
        branches = [path for path in (folder / BRANCHES).iterdir() if (path / DATABASE).exists()]
        yield from (SessionEntry(folder=path, is_branch=True) for path in sorted(branches))


def _is_same(a: Path, b: Path) -> bool:
    with contextlib.suppress(OSError):
        return a.samefile(b)
    return a == b


def _columns(width: int) -> tuple[int, tuple[int, ...]]:
    """Return the columns of the name and of each fact; 0: no room for that fact."""
    facts = [WHEN_COLUMNS, LENGTH_COLUMNS, FRAMES_COLUMNS, SIZE_COLUMNS, STATE_COLUMNS]
    for unneeded in (3, 0, 1):
        if width - 3 - sum(n + 1 for n in facts if n) >= MIN_NAME_COLUMNS + 8:
            break
        facts[unneeded] = 0
    room = width - 3 - sum(n + 1 for n in facts if n)
    return max(room, 4), tuple(facts)


def _cells(texts: tuple[str, ...], columns: tuple[int, tuple[int, ...]]) -> str:
    *numbers, state = zip(texts, columns[1], strict=True)
    cells = [f"{text:>{n}}" for text, n in numbers if n]
    return " ".join([*cells, state[0].ljust(state[1])])


def _facts(entry: SessionEntry) -> tuple[str, ...]:
    summary = entry.summary
    if summary is None:
        return ("", "", "", "", "…")
    if summary.fault is not None:
        return ("", "", "", file_size(summary.size_bytes), entry.state)
    first, length_s = summary.t_first_utc_ns, summary.duration_s
    when = "" if not first else utc_text(first, "dated minute", "")
    length = "" if length_s is None else duration_words(length_s)
    return (when, length, f"{summary.frames}", file_size(summary.size_bytes), entry.state)


def _shortened(name: str, columns: int) -> str:
    """Return the name cut in the middle: it begins with its date and ends with its subject."""
    if len(name) <= columns:
        return name.ljust(columns)
    half = (columns - 1) // 2
    return f"{name[: columns - 1 - half]}…{name[len(name) - half :] if half else ''}"


class SessionListDialog(ListDialog[Path | None, SessionEntry]):
    """Dialog of the recorded nights: typing finds one, enter opens it. Result: its folder."""

    LISTED = "sessions"
    KEYS = "↑↓ choose · enter opens · esc back"
    TO_TYPE = "type a part of a name, or a path"

    def __init__(self, root: Path, present: Path | None) -> None:
        """``root``: folder of recorded nights; ``present``: the session that is shown now."""
        super().__init__()
        self._root, self._present = root, present
        self._entries: list[SessionEntry] | None = None
        self._fault = ""
        self._is_over = False

    def on_unmount(self) -> None:
        """End the search for sessions."""
        self._is_over = True

    def load_rows(self) -> None:
        """List the sessions by name, then read their summaries one by one; runs on a thread."""
        try:
            entries = sessions_under(self._root, self._present)
        except SessionError as error:
            call_between_messages(self, self._list_entries, [], str(error))
            return
        call_between_messages(self, self._list_entries, entries)
        for entry in entries:
            if self._is_over:
                return
            call_between_messages(self, self._update_entry, add_summary(entry))

    def _list_entries(self, entries: list[SessionEntry], fault: str = "") -> None:
        """Show the sessions' names, or why they cannot be found; the present one is chosen."""
        self._entries, self._fault = entries, fault
        folders = [entry.folder for entry in entries]
        if self._present in folders and self._at == 0:
            self._at = folders.index(self._present)
        self.show()

    def _update_entry(self, entry: SessionEntry) -> None:
        """Show the summary of one session."""
        entries = self._entries or []
        self._entries = [entry if each.folder == entry.folder else each for each in entries]
        self.show()

    @property
    def matching_rows(self) -> list[SessionEntry]:
        """The sessions that match the typed words."""
        words = self.query_one(Input).value
        return [entry for entry in self._entries or [] if entry.has(words)]

    def row_result(self, row: SessionEntry) -> Path:
        """Return the session's folder."""
        return row.folder

    def handle_typed_text(self, typed: str) -> None:
        """Close with the typed path, if it is a session's folder."""
        with contextlib.suppress(ValueError, OSError):  # nobody's home, a name too long
            path = expand_home(typed.strip())
            if typed.strip() and (path / DATABASE).is_file():
                self.dismiss(path)
                return
        super().handle_typed_text(typed)

    def handle_row_click(self, number: int) -> None:
        """Choose the clicked row; if it is chosen already, open its session."""
        if number >= len(self.matching_rows):
            return
        if number == self._at:
            self.dismiss(self.matching_rows[number].folder)
        else:
            self.choose(number)

    def header_line(self, width: int) -> str:
        """Return the heads of the columns, or why no session is listed."""
        if self._entries is None:
            return f" looking into {self._root} …"
        if self._fault:
            return f" {self._fault}"
        if not self._entries:
            return f" no session lies in {self._root}: type a path, or try 'rsoconsole demo'"
        if not self.matching_rows:
            return " no name has that: enter opens it as a path"
        columns = _columns(width)
        return f"  {'session':<{columns[0]}} {_cells(HEADS, columns)}"

    def row_words(self, row: SessionEntry, width: int) -> tuple[str, Ink]:
        """Return the session's name and figures as a row, and its ink."""
        columns, name = _columns(width), f"└ {row.name}" if row.is_branch else row.name
        text = f"{_shortened(name, columns[0])} {_cells(_facts(row), columns)}"
        return text, STATE_INKS.get(row.state, "")
