"""A dialog that a STOP, or any other end, puts away before it has been drawn breaks nothing."""

from collections.abc import Callable

import pytest
from textual.pilot import Pilot

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.ask import ExposureDialog, LineDialog
from rsoconsole.console.dialogs.dialogs import ConfirmDialog, Dialog, LeaveDialog
from rsoconsole.console.dialogs.help import HelpDialog
from rsoconsole.console.dialogs.tour import TourDialog
from tests.rigs.seat_rig import FakeWire, play, until

DIALOGS: dict[str, Callable[[], Dialog]] = {
    "exposure": lambda: ExposureDialog({}),
    "a line": lambda: LineDialog("note", "words"),
    "yes or no": lambda: ConfirmDialog("park", "park?", yes="Park", letter="y"),
    "leave": lambda: LeaveDialog(lambda: "it runs", proposes_staying=False),
    "help": HelpDialog,
    "tour": lambda: TourDialog({}),
}


@pytest.mark.parametrize("name", DIALOGS)
def test_stop_right_behind_a_key_that_opens_a_dialog_leaves_the_console_whole(
    wire: FakeWire, name: str
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        app.push_screen(DIALOGS[name]())
        app.live.stop()
        await until(pilot, lambda: "stop" in wire.verbs)
        await pilot.pause()
        assert app.screen is app.live
        assert app.failure is None

    play(wire, scene)
