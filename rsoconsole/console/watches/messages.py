"""How the watches' and the engine's threads reach a screen, and what panes tell the screen."""

import contextlib
from collections.abc import Callable
from typing import Any

from textual.message import Message
from textual.message_pump import MessagePump

from rsoconsole.control import StopNews


def call_in_turn(screen: MessagePump, call: Callable[..., None], *arguments: Any) -> None:
    """Have a screen make this call between two of its messages (any thread).

    Nothing comes of it once the console has ended.
    """
    with contextlib.suppress(RuntimeError):
        screen.call_later(call, *arguments)


class Pointed(Message):
    """The mouse was pressed or released in a picture, in pixels of the frame."""

    def __init__(self, x_px: float, y_px: float, px_per_square: float, *, is_release: bool) -> None:
        super().__init__()
        self.x_px, self.y_px, self.px_per_square = x_px, y_px, px_per_square
        self.is_release = is_release


class StopNewsCame(Message):
    """How a STOP stands; ``number``: which of this console's STOPs it is."""

    def __init__(self, news: StopNews, number: int | None = None) -> None:
        super().__init__()
        self.news, self.number = news, number
