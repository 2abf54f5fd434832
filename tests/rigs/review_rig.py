"""A review in a test: a made-up night, a pilot, and what is on the screen."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from textual.pilot import Pilot

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.screens.review import ReviewScreen
from tests.rigs.seat_rig import FULL, FakeWire, opened, until

Play = Callable[[ReviewScreen, Pilot[str]], Awaitable[None]]


def is_there(review: ReviewScreen, frame_id: int | None = None) -> bool:
    """Whether the moment that is wanted is shown, whole; ``frame_id``: and is of that frame."""
    moment = review.moment
    if moment is None or moment.seq != review.seq or not moment.is_whole:
        return False
    frame = moment.view.frame
    return frame_id is None or (frame is not None and frame.frame_id == frame_id)


def frame_shown(review: ReviewScreen) -> int | None:
    """The number of the frame that is on the screen."""
    return None if review.night.frame is None else review.night.frame.frame_id


async def press(review: ReviewScreen, pilot: Pilot[str], *keys: str) -> None:
    """Keys, and wait until what they led to is shown."""
    await pilot.press(*keys)
    await pilot.pause()
    await until(pilot, lambda: is_there(review) or not review.timeline.frames)


def play_review(
    folder: Path | None,
    scene: Play,
    size: tuple[int, int] = FULL,
    *,
    start: str = "",
    wire: FakeWire | None = None,
    is_read: bool = True,
    **settings: Any,
) -> str | None:
    """Open a review, wait until the night has been read, play the scene; what it gave back."""

    async def run() -> str | None:
        def fake() -> FakeWire:
            return wire or FakeWire(Path("nowhere"))

        app = ConsoleApp(fake, review=(folder, start), **settings)
        async with opened(app, size) as pilot:
            review = app.root
            assert isinstance(review, ReviewScreen)
            if is_read:
                await until(pilot, lambda: review.timeline.is_whole and is_there(review))
            await scene(review, pilot)
        return app.return_value

    return asyncio.run(run())
