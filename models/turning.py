"""A field turned and mirrored with its truth: eight fields out of each."""

from dataclasses import replace

import numpy as np

from models.fields import FIELD_CELLS, Field, TrueStreak


def turned(field: Field, turns: int, *, is_mirrored: bool) -> Field:
    """The field turned by quarter turns counter-clockwise as displayed, then mirrored in x."""
    side = float(FIELD_CELLS)

    def place(x: float, y: float) -> tuple[float, float]:
        for _ in range(turns):
            x, y = y, side - x
        return (side - x if is_mirrored else x), y

    def moved(streak: TrueStreak) -> TrueStreak:
        (x_a, y_a), (x_b, y_b) = place(streak.x_a, streak.y_a), place(streak.x_b, streak.y_b)
        return replace(streak, x_a=x_a, y_a=y_a, x_b=x_b, y_b=y_b)

    values = np.rot90(field.values, turns)
    values = values[:, ::-1] if is_mirrored else values
    return replace(field, values=values, streaks=tuple(moved(s) for s in field.streaks))
