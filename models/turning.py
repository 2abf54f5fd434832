"""Crops, turns and mirror images of a field with its truth: many fields from one."""

from dataclasses import replace

import numpy as np

from models.fields import Field, TrueStreak


def cropped(field: Field, left: int, top: int, side: int) -> Field:
    """A square of ``side`` cells of a field; streaks keep their length beyond its edges."""

    def moved(streak: TrueStreak) -> TrueStreak:
        return replace(
            streak,
            x_a=streak.x_a - left,
            y_a=streak.y_a - top,
            x_b=streak.x_b - left,
            y_b=streak.y_b - top,
        )

    values = field.values[top : top + side, left : left + side]
    return replace(field, values=values, streaks=tuple(moved(s) for s in field.streaks))


def turned(field: Field, turns: int, *, is_mirrored: bool) -> Field:
    """A square field after ``turns`` quarter turns counter-clockwise, then mirrored in x or not."""
    side = float(field.values.shape[0])

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
