"""What the plots draw of residuals and bounds, against the numbers, at every scale."""

import math
from typing import Any

import numpy as np
import pytest

from rsoconsole.console.drawing.plot import AXIS_COLUMNS, SHADE
from rsoconsole.console.words.panels import nis_lines, residual_lines
from rsoconsole.night import FrameRow, NightView

STATES, FRAMES = 500, 30
WIDTH, HEIGHT = AXIS_COLUMNS + FRAMES, 12
"""One cell a frame, so that each column is one of them; the first line is the title."""


def rows(seed: int) -> tuple[FrameRow, ...]:
    """Frames whose residuals and bounds span decades, as after misses and changes of R."""
    random = np.random.default_rng(seed)
    scale = 10.0 ** random.uniform(-2.0, math.log10(36_000.0))
    sigmas = scale * 10.0 ** random.normal(0.0, random.uniform(0.0, 0.7), (FRAMES, 2))
    residuals = sigmas * random.normal(0.0, random.uniform(0.1, 3.0), (FRAMES, 2))
    is_measured = random.random(FRAMES) < 0.8
    return tuple(
        FrameRow(
            frame_id=n,
            sigma_arcsec=tuple(sigmas[n].tolist()),
            residual_arcsec=tuple(residuals[n].tolist()) if is_measured[n] else None,
            miss=None if is_measured[n] else "no detection",
        )
        for n in range(FRAMES)
    )


def drawn(seed: int, axis: str) -> tuple[list[str], float]:
    """The plot's cells by row, and the upper end of its axis as its label says."""
    lines = residual_lines(NightView(rows=rows(seed)), axis, WIDTH, HEIGHT)
    texts = ["".join(text for text, _ in line) for line in lines[1:]]
    limit, low = (arcsec(text[: AXIS_COLUMNS - 1]) for text in (texts[0], texts[-1]))
    assert low == -limit
    return [text[AXIS_COLUMNS:] for text in texts], limit


def arcsec(label: str) -> float:
    unit = {"°": 3600.0, "′": 60.0}.get(label[-1])
    return float(label) if unit is None else float(label[:-1]) * unit


def row_of(value: float, limit: float, count: int) -> float:
    return (limit - value) / (2.0 * limit) * (count - 1)


@pytest.mark.parametrize("axis", ["east", "north"])
def test_bounds_and_residuals_are_where_the_numbers_say_or_an_arrow_says_they_are_not(axis: str):
    for seed in range(STATES):
        cells, limit = drawn(seed, axis)
        place, count = ("east", "north").index(axis), len(cells)
        for n, row in enumerate(rows(seed)):
            column = [line[n] for line in cells]
            assert row.sigma_arcsec is not None
            bound = 3.0 * row.sigma_arcsec[place]
            value = None if row.residual_arcsec is None else row.residual_arcsec[place]
            what = f"seed {seed}, frame {n}: bound {bound}, value {value}, axis {limit}: {column}"
            if value is not None and abs(value) > limit:
                assert column[0 if value > 0 else -1] == ("▲" if value > 0 else "▼"), what
            elif value is not None:
                (at,) = [k for k, sign in enumerate(column) if sign == "●"]
                assert abs(at - row_of(value, limit, count)) <= 1.0, what
            else:
                assert abs(column.index("○") - row_of(0.0, limit, count)) <= 1.0, what
            if bound > limit:
                # A value in an outermost row hides one of the arrows, never both.
                assert {column[0], column[-1]} & {"△", "▽"}, what
                assert column[0] in "△●▲", what
                assert column[-1] in "▽●▼", what
                continue
            assert not {"△", "▽"} & set(column), what
            # A value hides the cell that it lies in, also where that is the last of the band.
            hides = value is None or abs(value) <= bound
            if value is not None and abs(value) <= limit:
                edge = round(row_of(math.copysign(bound, value), limit, count))
                hides = hides or abs(column.index("●") - edge) == 0
            inside = SHADE + ("●○" if hides else "")
            band = [k for k, sign in enumerate(column) if sign in inside]
            assert abs(min(band) - row_of(bound, limit, count)) <= 1.0, what
            assert abs(max(band) - row_of(-bound, limit, count)) <= 1.0, what


def test_a_night_without_any_track_has_no_axis_astray() -> None:
    """As of foreign frames in which nothing was found."""
    night = NightView(rows=tuple(FrameRow(frame_id=n, is_reduced=True) for n in range(3)))
    lines = residual_lines(night, "east", WIDTH, HEIGHT)
    assert len(lines) == HEIGHT
    assert not "".join(text for line in lines[1:] for text, _ in line).strip()


def changes_drawn(*frames: FrameRow) -> str:
    lines = residual_lines(NightView(rows=frames), "east", WIDTH, HEIGHT)
    return "\n".join("".join(text for text, _ in line) for line in lines)


def test_a_change_of_settings_is_drawn_and_a_frame_that_was_not_processed_is_none():
    def row(number: int, **of: Any) -> FrameRow:
        return FrameRow(
            frame_id=number, residual_arcsec=(0.1, 0.1), sigma_arcsec=(0.2, 0.2), nis=1.0, **of
        )

    before, after = {"filter.q_multiplier": 1.0}, {"filter.q_multiplier": 100.0}
    first = row(1, settings=before, is_reduced=True)
    gap = FrameRow(frame_id=2)  # by hand: nothing is processed, no setting is on record
    unchanged = row(3, settings=dict(before), is_reduced=True)
    changed = row(4, settings=after, is_reduced=True)
    assert "Q×" not in changes_drawn(first, gap, unchanged)
    assert "Q×100" in changes_drawn(first, gap, unchanged, changed)


def test_nis_is_judged_over_the_present_track_alone():
    frames = [
        FrameRow(frame_id=n, residual_arcsec=(0.1, 0.1), sigma_arcsec=(0.2, 0.2), nis=2.0)
        for n in range(1, 13)
    ]
    for begun, count in ((1, 12), (10, 3)):
        night = NightView(rows=tuple(frames), track_frame_id=begun)
        title = "".join(text for text, _ in nis_lines(night, 80, 8)[0])
        assert f"NIS 2.0 /{count} " in title


@pytest.mark.parametrize("terminal", [(1, 1), (20, 5), (80, 24)])
def test_plots_have_the_size_of_their_pane_whatever_terminal_is_found(
    monkeypatch: pytest.MonkeyPatch, terminal: tuple[int, int]
):
    """Where a terminal is made smaller, its panes have their old size for a moment."""
    monkeypatch.setenv("COLUMNS", str(terminal[0]))
    monkeypatch.setenv("LINES", str(terminal[1]))
    night = NightView(rows=rows(1))
    for width, height in ((AXIS_COLUMNS + 120, 40), (80, 3), (24, 2)):
        lines = residual_lines(night, "east", width, height)
        assert [sum(len(text) for text, _ in line) for line in lines] == [width] * height
    [strip] = residual_lines(night, "east", 80, 1)
    assert len("".join(text for text, _ in strip).split("3σ")[1].rstrip()) > FRAMES
