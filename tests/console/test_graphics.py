"""Pictures by the terminal's own graphics: what goes down the line, and what is in it."""

import base64
import io
import os
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rsoconsole.console.picture.graphics import paint_picture
from rsoconsole.console.picture.marks import Mark, Window
from rsoconsole.records import ChartStar
from tests.nights import made_up_night as night
from tests.rigs.terminal import Terminal
from tests.rigs.whole_engine import wait_for

COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "console"]
KITTY = re.compile(rb"\x1b_G([^;\x1b]*);([^\x1b]*)\x1b\\")
YELLOW = (255, 215, 95)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "night"
    writer = night.begin(folder)
    night.armed(writer)
    night.add_frames(writer, range(1, 9))
    night.add_previews(writer, range(8, 9))
    writer.close()
    return folder


def kitty_pictures(written: bytes) -> list[Image.Image]:
    """Every picture that was sent, put together from its pieces."""
    pictures, pieces = [], b""
    for keys, piece in KITTY.findall(written):
        pieces += piece
        if b"m=1" in keys or not pieces:
            continue
        data, pieces = base64.b64decode(pieces), b""
        if data.startswith(b"\x89PNG"):
            pictures.append(Image.open(io.BytesIO(data)).convert("RGB"))
    return pictures


def test_kitty_is_sent_the_frame_with_its_marks(session: Path):
    command = [*COMMAND, "--session", str(session), "--graphics", "kitty"]
    with Terminal(command, os.environ, (120, 40)) as terminal:
        wait_for(lambda: kitty_pictures(terminal.written), "a picture")
        # The streak is marked in the colour of what is followed.
        wait_for(
            lambda: any(
                (np.asarray(picture) == YELLOW).all(axis=2).sum() > 20
                for picture in kitty_pictures(terminal.written)
            ),
            "the mark of the followed streak",
        )
        assert terminal.shows("frame 0008")


def test_sixels_are_sent_where_they_are_asked_for(session: Path):
    command = [*COMMAND, "--session", str(session), "--graphics", "sixel"]
    with Terminal(command, os.environ, (120, 40)) as terminal:
        wait_for(lambda: re.search(rb"\x1bP[0-9;]*q", terminal.written), "sixels")


@pytest.mark.nightly("drives a terminal")
def test_a_terminal_that_offers_none_gets_quadrants(session: Path):
    command = [*COMMAND, "--session", str(session)]
    with Terminal(command, os.environ, (120, 40)) as terminal:
        wait_for(lambda: terminal.shows("frame 0008", "▞"), "quadrants")
        assert not re.search("[\U0001cd00-\U0001cde5\U0001fb00-\U0001fb3b]", terminal.text)
        assert not kitty_pictures(terminal.written)


def test_marks_lie_where_their_pixels_are():
    window = Window(x0_px=99.5, y0_px=199.5, width_px=40.0, height_px=20.0, columns=20, rows=5)
    grey = np.zeros((20, 40), np.float32)
    mark = Mark(x_px=120.0, y_px=210.0, kind="predicted")
    picture = np.asarray(
        paint_picture(grey, window, (mark,), {"predicted": (1, 2, 250)}, cell=(8, 16))
    )
    assert picture.shape == (80, 160, 3)
    rows, columns = np.nonzero((picture == (1, 2, 250)).all(axis=2))
    assert (columns.mean(), rows.mean()) == pytest.approx((82.0, 42.0), abs=1.0)


def test_in_the_night_colours_a_picture_is_red():
    window = Window(x0_px=-0.5, y0_px=-0.5, width_px=4.0, height_px=4.0, columns=4, rows=2)
    picture = np.asarray(
        paint_picture(np.ones((4, 4), np.float32), window, (), {}, cell=(8, 16), is_red=True)
    )
    red, green, blue = picture[0, 0]
    assert red > 3 * green > 3 * blue


def sizes(terminal: Terminal) -> set[tuple[int, int]]:
    """Sizes of the pictures that were sent: each pane has its own."""
    return {picture.size for picture in kitty_pictures(terminal.written)}


def test_a_chart_is_written_where_pixels_are_drawn_by_kitty_too(tmp_path: Path):
    writer = night.begin(tmp_path / "night")
    night.armed(writer)
    night.add_frames(writer, range(1, 9))
    stars = [ChartStar(300.0 + 400.0 * k, 3000.0, 900.0 * 2.0**k) for k in range(8)]
    night.add_previews(writer, range(8, 9), stars)
    writer.close()
    command = [*COMMAND, "--session", str(tmp_path / "night"), "--graphics", "kitty"]
    with Terminal(command, os.environ, (120, 40)) as terminal:
        wait_for(lambda: terminal.shows("─ field", "✶"), "the chart's stars")
        wait_for(lambda: kitty_pictures(terminal.written), "the close-up")
        assert len(sizes(terminal)) == 1
        terminal.press("f")
        wait_for(lambda: len(sizes(terminal)) == 2, "the field's pixels")
