"""Calls from other threads to a screen, and the messages that panes post to it."""

import contextlib
from collections.abc import Callable
from typing import Any

from textual.message import Message
from textual.message_pump import MessagePump

from rsoconsole.control import StopNews


def call_between_messages(screen: MessagePump, call: Callable[..., None], *arguments: Any) -> None:
    """Have a screen make this call between two of its messages; may be called from any thread.

    Does nothing once the console has ended.
    """
    with contextlib.suppress(RuntimeError):
        screen.call_later(call, *arguments)


class Pointed(Message):
    """Posted when the mouse was pressed or released in a picture, at a pixel of the frame.

    ``px_per_square``: pixels of the frame along a side of the picture's squares, two to a cell.
    """

    def __init__(self, x_px: float, y_px: float, px_per_square: float, *, is_release: bool) -> None:
        super().__init__()
        self.x_px, self.y_px, self.px_per_square = x_px, y_px, px_per_square
        self.is_release = is_release


class StopNewsCame(Message):
    """Posted for a STOP's new state; ``number``: which of this console's STOPs, None: the last."""

    def __init__(self, news: StopNews, number: int | None = None) -> None:
        super().__init__()
        self.news, self.number = news, number
