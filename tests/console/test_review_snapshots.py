"""The screens of a review, as pictures that somebody has looked at.

``RSOCONSOLE_WRITE_SNAPSHOTS=1`` writes them again; look at the diff then.
"""

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.console.dialogs.session_list import SessionListDialog
from rsoconsole.console.drawing.pane_layout import has_tuning_column
from rsoconsole.console.screens._compare import CompareDialog
from rsoconsole.console.screens.review import ReviewScreen
from tests.console.test_console_snapshots import SIZES
from tests.nights import eventful_night
from tests.rigs.review_rig import play_review, press
from tests.rigs.screen_text import expect_as_agreed, screen_text
from tests.rigs.seat_rig import until
from tests.tiers import plain_first

FRAMES, SHOWN = 110, 51
Act = Callable[[ReviewScreen, Pilot[str]], Awaitable[None]]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A root with one night in it, with a picture of one missed frame."""
    root = tmp_path_factory.mktemp("sessions")
    folder = root / "night"
    eventful_night.write(folder, FRAMES, pictures=range(SHOWN, SHOWN + 1)).close()
    return root


async def moment(_review: ReviewScreen, _pilot: Pilot[str]) -> None:
    """A missed frame."""


async def compare(review: ReviewScreen, pilot: Pilot[str]) -> None:
    await pilot.press("K")
    await press(review, pilot, "g", *"95", "enter")
    await pilot.press("K")
    await until(pilot, lambda: isinstance(pilot.app.screen, CompareDialog))


async def log(review: ReviewScreen, pilot: Pilot[str]) -> None:
    await pilot.press("l", "down")


async def sessions(review: ReviewScreen, pilot: Pilot[str]) -> None:
    await pilot.press("r")
    await until(pilot, lambda: isinstance(pilot.app.screen, SessionListDialog))
    dialog = pilot.app.screen
    assert isinstance(dialog, SessionListDialog)
    await until(
        pilot,
        lambda: bool(dialog.matching_rows) and all(each.state for each in dialog.matching_rows),
    )


STATES: dict[str, Act] = {"moment": moment, "compare": compare, "log": log, "sessions": sessions}


async def settled(review: ReviewScreen, pilot: Pilot[str], size: tuple[int, int]) -> None:
    """What other threads compute has come."""
    await until(pilot, lambda: review.outlook is not None)
    if has_tuning_column(*size):
        await until(pilot, lambda: review.tune.figures[0] is not None)
    await pilot.pause(0.05)


@pytest.mark.slow("opens the night for each of its screens")
@pytest.mark.parametrize(
    "size", plain_first(2, zip(SIZES)), ids=lambda size: f"{size[0]}x{size[1]}"
)
def test_the_review_looks_as_it_was_agreed(root: Path, impatient_seat: None, size: tuple[int, int]):
    for state, act in STATES.items():
        seen = ""

        async def scene(review: ReviewScreen, pilot: Pilot[str], act: Act = act) -> None:
            nonlocal seen
            await settled(review, pilot, size)
            await act(review, pilot)
            await settled(review, pilot, size)
            if review.notice[0]:
                review.say("")  # it stays for some seconds, on a slow machine for fewer keys
                await pilot.pause(0.05)
            seen = screen_text(pilot.app)

        play_review(root / "night", scene, size, start=f"{SHOWN}", sessions_root=root)
        expect_as_agreed(seen, f"review-{state}_{size[0]}x{size[1]}")


def test_in_the_smallest_terminal_state_time_and_place_stay(root: Path, impatient_seat: None):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        strips = review._compositor.render_strips()
        lines = ["".join(segment.text for segment in strip).rstrip() for strip in strips]
        assert len(lines) == 12
        assert lines[0].split() == ["REVIEW", "COAST", "0s", "02:38:50Z"]
        assert lines[1].split() == ["AUTO", "had", "the", "mount", "night"]
        assert any(line.startswith(" conf × .62") for line in lines)
        assert lines[-2].startswith(f" frame {SHOWN} of {FRAMES} ")
        assert "┃" in lines[-2]
        assert lines[-1].startswith(" x STOP  space Play")
        assert "F1 Help" in lines[-1]
        assert all(len(line) <= 40 for line in lines)

    play_review(root / "night", scene, (40, 12), start=f"{SHOWN}", sessions_root=root)


def test_without_signs_beyond_ascii_the_time_line_tells_as_much(root: Path, impatient_seat: None):
    from rsoconsole.config import ConsoleConfig

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        from rsoconsole.console.drawing.plain import to_ascii
        from rsoconsole.console.panes.panes import LinesPane

        text = to_ascii(review.query_one("#timeline", LinesPane).text)
        assert text.isascii()
        assert "TRACK-" in text
        assert "|" in text
        assert "x" in text.splitlines()[0]

    settings = ConsoleConfig(ascii=True)
    play_review(root / "night", scene, (120, 40), start=f"{SHOWN}", settings=settings)
