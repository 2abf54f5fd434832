"""Pictures in block characters: the characters, the fit, what is sent, what a terminal has."""

import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.console.drawing.blocks import (
    BY_NAME,
    HALF_BLOCKS,
    OCTANTS,
    QUADRANTS,
    SEXTANTS,
    BlockSet,
    fit_to_cells,
    row_runs,
)
from rsoconsole.console.drawing.terminal_query import TerminalAnswer, finest_blocks, parse_answer
from rsoconsole.console.picture.graphics import choose_drawing_mode

ALL = tuple(BY_NAME.values())


def _picture_of(
    cells_text: list[list[tuple[str, tuple[int, int]]]], blocks: BlockSet
) -> np.ndarray:
    """The greys that a terminal shows for what is written."""
    rows = []
    for row in cells_text:
        cells = []
        for text, (front, back) in row:
            for character in text:
                pattern = blocks.glyphs.index(character)
                bits = np.arange(blocks.across * blocks.down).reshape(blocks.down, blocks.across)
                cells.append(np.where(pattern >> bits & 1, front, back))
        rows.append(np.hstack(cells))
    return np.vstack(rows)


def test_the_characters_are_those_of_their_names():
    for pattern in range(1, 63):
        parts = "".join(str(part + 1) for part in range(6) if pattern >> part & 1)
        name = unicodedata.name(SEXTANTS.glyphs[pattern])
        halves = {"135": "LEFT HALF BLOCK", "246": "RIGHT HALF BLOCK"}
        assert name == halves.get(parts, f"BLOCK SEXTANT-{parts}")
    names = {1: "UPPER LEFT", 2: "UPPER RIGHT", 4: "LOWER LEFT", 8: "LOWER RIGHT"}
    for pattern, name in names.items():
        assert unicodedata.name(QUADRANTS.glyphs[pattern]) == f"QUADRANT {name}"


def test_octants_fill_their_block_of_unicode_once():
    """230 of the 256 patterns are new in Unicode 16; the first is octant 3, the last all but 1."""
    new = [ord(c) for c in OCTANTS.glyphs if 0x1CD00 <= ord(c) <= 0x1CDE5]
    assert new == list(range(0x1CD00, 0x1CDE6))
    assert len(set(OCTANTS.glyphs)) == 256
    assert OCTANTS.glyphs[0b100] == "\U0001cd00"
    assert OCTANTS.glyphs[0b11111110] == "\U0001cde5"
    assert OCTANTS.glyphs[0x0F] == "▀"


@pytest.mark.parametrize("blocks", ALL, ids=lambda b: b.name)
def test_two_greys_in_a_cell_are_shown_as_they_are(blocks: BlockSet):
    rng = np.random.default_rng(3)
    cells = np.where(rng.random((4 * blocks.down, 9 * blocks.across)) < 0.4, 20, 5)
    shown = fit_to_cells(cells.astype(np.uint8), blocks)
    written = [row_runs(shown, blocks, {}, row) for row in range(4)]
    assert np.array_equal(_picture_of(written, blocks), cells)


@given(st.lists(st.integers(0, 23), min_size=8, max_size=8))
def test_no_other_two_groups_lie_nearer(values: list[int]):
    parts = np.array(values, np.uint8).reshape(4, 2)
    cells = fit_to_cells(parts, OCTANTS)
    pattern, flat = int(cells.pattern[0, 0]), np.array(values, float)
    if parts.max() - parts.min() <= 1:
        assert cells.bright[0, 0] == cells.dark[0, 0]
        return

    def misfit(chosen: int) -> float:
        mask = np.array([chosen >> bit & 1 for bit in range(8)], bool)
        groups = [group for group in (flat[mask], flat[~mask]) if group.size]
        return sum(float(((group - group.mean()) ** 2).sum()) for group in groups)

    assert misfit(pattern) <= min(misfit(chosen) for chosen in range(256)) + 1e-3


@pytest.mark.parametrize("blocks", ALL, ids=lambda b: b.name)
def test_one_bright_part_in_a_dark_cell_stays_bright(blocks: BlockSet):
    greys = np.full((blocks.down, blocks.across), 2, np.uint8)
    greys[-1, -1] = 23
    cells = fit_to_cells(greys, blocks)
    assert cells.bright[0, 0] == 23
    assert cells.dark[0, 0] == 2
    # Under a sign it still shows.
    assert cells.behind[0, 0] >= 12


def test_neighbours_share_their_colours_where_they_can():
    """A change of colour is twenty bytes down a slow line."""
    greys = np.full((2, 8), 3, np.uint8)
    greys[:, 2:4] = 20
    greys[0, 5] = 20
    parts = row_runs(fit_to_cells(greys, QUADRANTS), QUADRANTS, {}, 0)
    assert [(len(text), set(key)) for text, key in parts] == [(1, {3}), (3, {3, 20})]


def test_a_sign_keeps_the_light_below_it():
    greys = np.full((2, 6), 3, np.uint8)
    greys[:, 2:4] = 20
    parts = row_runs(fit_to_cells(greys, QUADRANTS), QUADRANTS, {(1, 0): ("·", "predicted")}, 0)
    assert ("·", ("predicted", 20)) in parts


@pytest.mark.parametrize(
    ("kind", "answer", "blocks", "graphics"),
    [
        ("xterm-kitty", "\x1bP>|kitty(0.42.1)\x1b\\\x1b_Gi=31;OK\x1b\\\x1b[?62c", OCTANTS, "kitty"),
        ("xterm-kitty", "\x1b[?62c", SEXTANTS, ""),
        ("foot", "\x1bP>|foot(1.21.0)\x1b\\\x1b[?62;4;22c", OCTANTS, "sixel"),
        ("foot", "\x1bP>|foot(1.13.1)\x1b\\\x1b[?62;4;22c", SEXTANTS, "sixel"),
        ("xterm-256color", "\x1bP>|WezTerm 20240203-110809\x1b\\\x1b[?65;4c", SEXTANTS, "sixel"),
        ("xterm-ghostty", "\x1bP>|ghostty 1.2.0\x1b\\\x1b[?62;22c", OCTANTS, ""),
        ("xterm-256color", "\x1bP>|VTE(7402)\x1b\\\x1b[?65;1;9c", SEXTANTS, ""),
        ("xterm-256color", "\x1bP>|VTE(5202)\x1b\\\x1b[?65;1;9c", QUADRANTS, ""),
        ("xterm-256color", "\x1bP>|XTerm(390)\x1b\\\x1b[?64;1;2c", QUADRANTS, ""),
        ("tmux-256color", "\x1bP>|tmux 3.4\x1b\\\x1b[?1;2;4c", QUADRANTS, "sixel"),
        ("xterm-256color", "", QUADRANTS, ""),
        ("linux", "", HALF_BLOCKS, ""),
    ],
)
def test_a_terminal_gets_the_finest_that_it_surely_draws(
    kind: str, answer: str, blocks: BlockSet, graphics: str
):
    said = parse_answer(answer, kind)
    assert finest_blocks(said, {"TERM": kind}) is blocks
    assert said.has_kitty == (graphics == "kitty")
    assert said.has_sixel == (graphics == "sixel")


def test_what_is_configured_is_not_asked_about(monkeypatch: pytest.MonkeyPatch):
    def never() -> TerminalAnswer:
        raise AssertionError("the terminal was asked")

    monkeypatch.setattr("rsoconsole.console.picture.graphics.query_terminal", never)
    for name, blocks in BY_NAME.items():
        drawn = choose_drawing_mode(name)  # type: ignore[arg-type]
        assert (drawn.graphics, drawn.blocks) == (None, blocks)
