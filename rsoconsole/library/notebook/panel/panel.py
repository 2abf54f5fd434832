"""The widget ``LivePanel``: a seat on the running engine in a notebook. Needs anywidget."""

import contextlib
import os
import threading
import time
from collections.abc import Callable
from contextvars import Context, copy_context
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import anywidget
import traitlets

from rsoconsole.base import resource_path
from rsoconsole.control import ControlClient, Found, Sender
from rsoconsole.instruments import stop_without_engine
from rsoconsole.library.notebook.panel._panel_orders import PanelOrders
from rsoconsole.library.notebook.panel.link import PanelLink

UNSEEN_S = 12.0
"""Silence of the page after which it counts as closed and the panel releases the engine, s."""
SUBSHELLS_SINCE = 7
"""First major version of ipykernel that serves a page while a cell runs."""


class LivePanel(anywidget.AnyWidget):  # type: ignore[misc]
    """Notebook widget that shows the running engine and sends it orders.

    It polls the engine on a thread of its own while its page is open, until ``close()``. Orders go
    through the control socket; the engine decides on control, checklist and limits. Where the
    engine does not answer, STOP goes directly to the mount. While a cell runs, the page is served
    only where both ends support subshells (JupyterLab 4.4 and ipykernel 7, or later); elsewhere
    STOP would wait for the cell, and the page says so at once.
    """

    _esm = resource_path("library", "notebook", "static", "panel.js")
    _css = resource_path("library", "notebook", "static", "panel.css")

    read_only = traitlets.Bool(False).tag(sync=True)
    answers_while_busy = traitlets.Bool(True).tag(sync=True)
    status = traitlets.Dict().tag(sync=True)
    """The engine's status in words, sent at every poll."""
    night = traitlets.Dict().tag(sync=True)
    """View of the record: plots, marks, log; sent whenever it has changed."""
    picture = traitlets.Bytes(b"").tag(sync=True)
    said = traitlets.Dict().tag(sync=True)
    asked = traitlets.Dict().tag(sync=True)
    stop_news = traitlets.Dict().tag(sync=True)
    goto = traitlets.Dict().tag(sync=True)
    effect = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        socket: Path | str | None = None,
        *,
        read_only: bool = False,
        wire: ControlClient | None = None,
    ) -> None:
        """Open a panel; ``socket``: the engine's control socket, None: that of this user's engine.

        ``read_only``: the panel sends nothing but STOP; ``wire``: client to use instead of one for
        ``socket``.
        """
        sender = Sender.at(f"notebook-{os.getpid()}")
        path = None if socket is None else Path(socket).expanduser()
        client = wire or ControlClient(path, sender=sender)
        self._seen_s = time.monotonic()
        self._ticks = 0
        self._lock = threading.RLock()
        self._answering: Context | None = None
        """Context of the page's last message; None before the first one."""
        self._unsent: dict[str, Any] = {}
        self._link = PanelLink(
            client,
            seat=sender.name,
            is_watched=lambda: time.monotonic() - self._seen_s < UNSEEN_S,
            on_status=self._show_status,
            on_night=self._show_night,
        )
        self._orders = PanelOrders(
            client, self._link, self._put, read_only=read_only, stop_directly=self._stop_directly
        )
        super().__init__(read_only=read_only, answers_while_busy=_answers_while_busy())
        _release_reply_subshell(self.comm)
        self.on_msg(self._receive)
        self._link.start()

    def stop(self) -> None:
        """Send STOP, as the page's button does; return at once: ``stop_news`` gives the result."""
        self._orders.stop()

    def close(self) -> None:
        """Close the panel: polling ends, the page goes blank."""
        self._link.close()
        super().close()

    @property
    def is_running(self) -> bool:
        """True while the panel's thread polls the engine."""
        return self._link.is_running

    def _receive(self, _widget: Any, content: Any, _buffers: Any) -> None:
        if not isinstance(content, dict):
            return
        with self._lock:
            # What is told from now on answers this message: its subshell, not the main shell,
            # then goes on hearing the page, also while a cell runs.
            self._answering = copy_context()
            untold, self._unsent = self._unsent, {}
            for name, value in untold.items():
                self._put(name, value)
        was_unseen = time.monotonic() - self._seen_s >= UNSEEN_S
        self._seen_s = time.monotonic()
        if content.get("kind") != "here":
            self._orders.receive(content)
        elif was_unseen:
            self._link.poll_now()

    def _stop_directly(self, on_found: Callable[[Found], None]) -> None:
        live = self._link.live
        stop_without_engine(on_found, None if live is None else live.begun_with.indi)

    def _show_status(self, view: dict[str, Any]) -> None:
        self._ticks += 1
        self._put("status", {**view, "tick": self._ticks})

    def _show_night(self, view: dict[str, Any], picture: bytes) -> None:
        self._put("night", view)
        if picture != self.picture:
            self._put("picture", picture)

    def _put(self, name: str, value: Any) -> None:
        """Send the page a value, from any thread, as an answer to its last message.

        Before the first message nothing is sent: ipykernel would give its answer to the main shell.
        """
        with self._lock:
            if self._answering is None:
                self._unsent[name] = value
            else:
                self._answering.copy().run(setattr, self, name, value)
                _release_reply_subshell(self.comm)


def _release_reply_subshell(comm: Any) -> None:
    """Let every message of the page go to the subshell that it names.

    ipykernel 7.4 sends it instead to the shell of the message that was answered last: the main
    shell, where the page has not spoken yet or its own subshell was not there when it did.
    """
    with contextlib.suppress(AttributeError):
        del comm._reply_subshell_id


def _answers_while_busy() -> bool:
    try:
        return int(version("ipykernel").partition(".")[0]) >= SUBSHELLS_SINCE
    except (PackageNotFoundError, ValueError):
        return False
