"""Pictures in block characters: in each cell two greys and the pattern that fits best.

A cell is divided into 1 x 2 parts (half blocks), 2 x 2 (quadrants), 2 x 3 (sextants, Unicode 13) or
2 x 4 (octants, Unicode 16), as far as the terminal draws them.
"""

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.console.drawing.plot import join_cells_by_key

ByteImage = npt.NDArray[np.uint8]
Name = Literal["half-blocks", "quadrants", "sextants", "octants"]
Key = tuple[int, int]
"""(grey of a character's foreground, grey of its background)."""

MIN_STEPS = 1
"""Largest range of greys in a cell that is drawn as one grey: each change of colour costs bytes."""
FULL_BLOCK = "█"
LOWER_HALF = 2
"""The pattern of half blocks whose lower half is the brighter one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockSet:
    """A set of block characters, each a cell of ``across`` x ``down`` parts."""

    name: Name
    across: int
    down: int
    glyphs: str
    """Character for each pattern of drawn parts: bit ``row * across + column`` of the index."""


_QUADRANTS = " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"
_SEXTANTS = {0: " ", 0b010101: "▌", 0b101010: "▐", 0b111111: FULL_BLOCK}
"""Characters of the patterns that Unicode's sextants leave out, as older blocks had them."""


def _octant_glyphs() -> str:
    """Return the characters of octants by pattern: from U+1CD00 on, and older ones."""
    upper_left, upper_right, lower_left, lower_right = 0x05, 0x0A, 0x50, 0xA0
    corners = (upper_left, upper_right, lower_left, lower_right)
    known = {
        sum(part for bit, part in enumerate(corners) if pattern >> bit & 1): glyph
        for pattern, glyph in enumerate(_QUADRANTS)
    }
    known |= {
        0x01: "\U0001cea8",
        0x02: "\U0001ceab",
        0x03: "\U0001fb82",
        0x14: "\U0001fbe6",
        0x28: "\U0001fbe7",
        0x3F: "\U0001fb85",
        0x40: "\U0001cea3",
        0x80: "\U0001cea0",
        0xC0: "▂",
        0xFC: "▆",
    }
    return _in_order(256, known, 0x1CD00)


def _in_order(count: int, known: dict[int, str], first: int) -> str:
    """Return a character for each pattern: the known ones, else the next from ``first`` on."""
    codes = itertools.count(first)
    return "".join(known.get(pattern) or chr(next(codes)) for pattern in range(count))


HALF_BLOCKS = BlockSet(name="half-blocks", across=1, down=2, glyphs=" ▀▄█")
QUADRANTS = BlockSet(name="quadrants", across=2, down=2, glyphs=_QUADRANTS)
SEXTANTS = BlockSet(name="sextants", across=2, down=3, glyphs=_in_order(64, _SEXTANTS, 0x1FB00))
OCTANTS = BlockSet(name="octants", across=2, down=4, glyphs=_octant_glyphs())
BY_NAME: dict[str, BlockSet] = {
    each.name: each for each in (HALF_BLOCKS, QUADRANTS, SEXTANTS, OCTANTS)
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedCells:
    """A picture fitted into cells: a pattern and two greys in each. Arrays: (rows, columns)."""

    pattern: npt.NDArray[np.intp]
    """Parts that have the brighter grey, as bits ``row * across + column``."""
    bright: ByteImage
    dark: ByteImage
    behind: ByteImage
    """Grey behind text over a cell: light that fills only a part of the cell still shows."""


def fit_to_cells(greys: ByteImage, blocks: BlockSet) -> FittedCells:
    """Fit two greys and a pattern to the parts of each cell by least squares.

    ``greys``: (rows * down, columns * across), a grey for each part. The best two groups of a
    cell's greys are separated by a threshold, so every threshold is compared.
    """
    down, across = blocks.down, blocks.across
    rows, columns = greys.shape[0] // down, greys.shape[1] // across
    by_cell = greys.reshape(rows, down, columns, across).transpose(0, 2, 1, 3)
    parts = by_cell.reshape(rows * columns, down * across).astype(np.float32)
    n = parts.shape[1]
    ordered = np.sort(parts, axis=1)
    lower = np.cumsum(ordered, axis=1)
    total = lower[:, -1:]
    counts = np.arange(1, n, dtype=np.float32)
    below = lower[:, :-1]
    # Of all divisions of the same numbers, the one whose groups' means explain most.
    explained = below**2 / counts + (total - below) ** 2 / (n - counts)
    at = np.argmax(explained, axis=1) + 1
    threshold = np.take_along_axis(ordered, at[:, None], axis=1)
    is_bright = parts >= threshold
    bright_count = is_bright.sum(axis=1)
    bright_sum = np.where(is_bright, parts, 0.0).sum(axis=1)
    bright = bright_sum / bright_count
    dark_count = n - bright_count
    dark = np.where(dark_count > 0, (total[:, 0] - bright_sum) / np.maximum(dark_count, 1), bright)
    mean = total[:, 0] / n
    is_flat = (dark_count == 0) | (ordered[:, -1] - ordered[:, 0] <= MIN_STEPS)
    bright, dark = np.where(is_flat, mean, bright), np.where(is_flat, mean, dark)
    pattern = is_bright @ (1 << np.arange(n))
    shape = rows, columns
    return FittedCells(
        pattern=np.where(is_flat, 0, pattern).reshape(shape),
        bright=np.rint(bright).astype(np.uint8).reshape(shape),
        dark=np.rint(dark).astype(np.uint8).reshape(shape),
        behind=np.rint(np.maximum(mean, 0.75 * ordered[:, -1])).astype(np.uint8).reshape(shape),
    )


Written = dict[tuple[int, int], tuple[str, str]]
"""Text over a picture: (column, row) -> (character, kind of mark)."""
RunKey = tuple[int, int] | tuple[str, int]
"""Colours of a run: (grey drawn, grey behind), or for text (kind of mark, grey behind)."""


def row_runs(
    cells: FittedCells, blocks: BlockSet, marks: Written, row: int
) -> list[tuple[str, RunKey]]:
    """Return one row of a picture as runs of (text, colours), with few changes of colour.

    ``marks``: text over the picture. Half blocks are always drawn as the upper one, which the ASCII
    form of the screen replaces by letters.
    """
    if blocks is HALF_BLOCKS:
        return join_cells_by_key(_halves(cells, marks, row))
    patterns, brights = cells.pattern[row].tolist(), cells.bright[row].tolist()
    darks, behinds = cells.dark[row].tolist(), cells.behind[row].tolist()
    glyphs, inverse = blocks.glyphs, len(blocks.glyphs) - 1
    done: list[tuple[str, RunKey]] = []
    text: list[str] = []
    front: int | None = None
    back: int | None = None

    def close() -> None:
        if text:
            assert back is not None
            done.append(("".join(text), (back if front is None else front, back)))
            text.clear()

    for column, (pattern, bright, dark) in enumerate(zip(patterns, brights, darks, strict=True)):
        written = marks.get((column, row))
        if written is not None:
            close()
            front = back = None
            done.append((written[0], (written[1], behinds[column])))
        elif bright == dark:
            if back is not None and dark == back:
                text.append(" ")
            elif front is not None and dark == front:
                text.append(FULL_BLOCK)
            else:
                close()
                front, back = None, dark
                text.append(" ")
        elif back == dark and front in {None, bright}:
            front = bright
            text.append(glyphs[pattern])
        elif back == bright and front in {None, dark}:
            front = dark
            text.append(glyphs[inverse - pattern])
        else:
            close()
            front, back = bright, dark
            text.append(glyphs[pattern])
    close()
    return join_cells_by_key(done)


def _halves(cells: FittedCells, marks: Written, row: int) -> list[tuple[str, RunKey]]:
    parts: list[tuple[str, RunKey]] = []
    for column, pattern in enumerate(cells.pattern[row].tolist()):
        at = column, row
        bright, dark = int(cells.bright[row, column]), int(cells.dark[row, column])
        if at in marks:
            text, kind = marks[at]
            parts.append((text, (kind, int(cells.behind[row, column]))))
        else:
            parts.append(("▀", (dark, bright) if pattern == LOWER_HALF else (bright, dark)))
    return parts
