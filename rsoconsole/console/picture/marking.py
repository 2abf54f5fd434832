"""An unfinished mark by hand in a picture: a cursor that sets a streak's two ends."""

from dataclasses import dataclass

from rsoconsole.console.picture.marks import Mark
from rsoconsole.console.picture.picture import DrawnPicture

MOVES: dict[str, tuple[int, int]] = {
    "up": (0, -1),
    "down": (0, 1),
    "left": (-1, 0),
    "right": (1, 0),
}
FAR = 5
"""Squares that an arrow with shift moves the cursor by."""


@dataclass(slots=True, kw_only=True)
class UnfinishedMark:
    """Unfinished mark by hand: cursor, first end and view's bounds in pixels of the frame."""

    frame_id: int
    px_per_square: float
    low_px: tuple[float, float]
    high_px: tuple[float, float]
    cursor_px: tuple[float, float]
    first_px: tuple[float, float] | None = None
    shows_signs: bool = False
    """True where the signs of streaks stay over the picture meanwhile."""
    coarsest_px: float = 0.0
    """Side of the largest square in which an end was set, pixels: the mark's uncertainty."""

    @classmethod
    def begin(cls, frame_id: int, drawing: DrawnPicture) -> "UnfinishedMark":
        """Begin a mark with its cursor in the middle of the drawn view."""
        low, high = _bounds(drawing)
        return cls(
            frame_id=frame_id,
            px_per_square=drawing.px_per_square,
            low_px=low,
            high_px=high,
            cursor_px=((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0),
        )

    def look(self, drawing: DrawnPicture) -> None:
        """Continue the mark in another view of the same frame, the cursor kept within it."""
        self.low_px, self.high_px = _bounds(drawing)
        self.px_per_square = drawing.px_per_square
        self._go(*self.cursor_px)

    def _go(self, x_px: float, y_px: float) -> None:
        """Move the cursor to a place, or as near as the view allows."""
        x, y = (
            min(max(value, low), high)
            for value, low, high in zip((x_px, y_px), self.low_px, self.high_px, strict=True)
        )
        self.cursor_px = (x, y)

    def move(self, key: str) -> bool:
        """Move the cursor by an arrow key; False for any other key."""
        plain = key.removeprefix("shift+")
        if plain not in MOVES:
            return False
        far = (FAR if plain != key else 1) * self.px_per_square
        x, y = (at + step * far for at, step in zip(self.cursor_px, MOVES[plain], strict=True))
        self._go(x, y)
        return True

    def is_dragged(self) -> bool:
        """Return True if the first end is set and the cursor is more than a square away from it."""
        if self.first_px is None:
            return False
        away = max(abs(a - b) for a, b in zip(self.first_px, self.cursor_px, strict=True))
        return away > self.px_per_square

    def set_end(
        self, px_per_square: float | None = None
    ) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Set an end at the cursor; return both ends once the second is set, before that None.

        ``px_per_square``: pixels of the frame along a square's side, in the view in which the end
        was set; None: in the present view.
        """
        self.coarsest_px = max(self.coarsest_px, px_per_square or self.px_per_square)
        if self.first_px is None:
            self.first_px = self.cursor_px
            return None
        return self.first_px, self.cursor_px

    def marks(self) -> tuple[Mark, ...]:
        """Return the marks that draw the cursor and, once set, the first end."""
        x, y = self.cursor_px
        cursor = Mark(x_px=x, y_px=y, kind="cursor")
        if self.first_px is None:
            return (cursor,)
        a, b = self.first_px
        return Mark(x_px=a, y_px=b, kind="cursor", label="1"), cursor


def _bounds(drawing: DrawnPicture) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the centres of the drawn view's first and last pixel, (x, y) each."""
    window = drawing.window
    low = window.x0_px + 0.5, window.y0_px + 0.5
    return low, (low[0] + window.width_px - 1.0, low[1] + window.height_px - 1.0)
