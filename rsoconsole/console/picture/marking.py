"""A mark by hand in a picture: a cursor that sets a streak's two ends, square by square."""

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
"""Squares that a shifted arrow moves the cursor by."""


@dataclass(slots=True, kw_only=True)
class Marking:
    """The cursor and the first end, in pixels of the frame."""

    frame_id: int
    px_per_square: float
    low_px: tuple[float, float]
    high_px: tuple[float, float]
    cursor_px: tuple[float, float]
    first_px: tuple[float, float] | None = None
    shows_signs: bool = False
    """True where the marks of streaks stay over the picture."""
    coarsest_px: float = 0.0
    """Side of the largest square in which an end was set: its uncertainty."""

    @classmethod
    def begin(cls, frame_id: int, drawing: DrawnPicture) -> "Marking":
        """Begin in the middle of the drawn view."""
        low, high = _bounds(drawing)
        return cls(
            frame_id=frame_id,
            px_per_square=drawing.px_per_square,
            low_px=low,
            high_px=high,
            cursor_px=((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0),
        )

    def look(self, drawing: DrawnPicture) -> None:
        """Continue in another view of the same frame."""
        self.low_px, self.high_px = _bounds(drawing)
        self.px_per_square = drawing.px_per_square
        self._go(*self.cursor_px)

    def _go(self, x_px: float, y_px: float) -> None:
        """Move the cursor to that place, or as near as the view allows."""
        x, y = (
            min(max(value, low), high)
            for value, low, high in zip((x_px, y_px), self.low_px, self.high_px, strict=True)
        )
        self.cursor_px = (x, y)

    def move(self, key: str) -> bool:
        """Move the cursor by a key; False when the key is for something else."""
        plain = key.removeprefix("shift+")
        if plain not in MOVES:
            return False
        far = (FAR if plain != key else 1) * self.px_per_square
        x, y = (at + step * far for at, step in zip(self.cursor_px, MOVES[plain], strict=True))
        self._go(x, y)
        return True

    def is_drag(self) -> bool:
        """True where the cursor has left the square of the first end."""
        if self.first_px is None:
            return False
        away = max(abs(a - b) for a, b in zip(self.first_px, self.cursor_px, strict=True))
        return away > self.px_per_square

    def set_end(
        self, px_per_square: float | None = None
    ) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Set an end at the cursor; returns both ends once the second is set.

        ``px_per_square``: pixels a square in the view in which it was set; None: in the present
        view.
        """
        self.coarsest_px = max(self.coarsest_px, px_per_square or self.px_per_square)
        if self.first_px is None:
            self.first_px = self.cursor_px
            return None
        return self.first_px, self.cursor_px

    def marks(self) -> tuple[Mark, ...]:
        """Return the marks that draw the cursor and the first end."""
        x, y = self.cursor_px
        cursor = Mark(x_px=x, y_px=y, kind="cursor")
        if self.first_px is None:
            return (cursor,)
        a, b = self.first_px
        return Mark(x_px=a, y_px=b, kind="cursor", label="1"), cursor


def _bounds(drawing: DrawnPicture) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the first and the last pixel of the drawn view."""
    window = drawing.window
    low = window.x0_px + 0.5, window.y0_px + 0.5
    return low, (low[0] + window.width_px - 1.0, low[1] + window.height_px - 1.0)
