"""The tracks' numbers in the picture: each is there, none lies on another or on a streak."""

import re

import pytest

from rsoconsole.console.drawing.plain import to_ascii
from rsoconsole.console.drawing.track_marks import NumberedTrack, place_track_numbers
from rsoconsole.console.picture.marks import Window, frame_marks, mark_characters
from tests.nights import eight_tracks as eight
from tests.nights.made_up_night import HEIGHT_PX, WIDTH_PX

FRAMES = 12
FIELDS = [(44, 14), (30, 10), (62, 20), (120, 40)]


def window(columns: int, rows: int) -> Window:
    return Window(
        x0_px=-0.5,
        y0_px=-0.5,
        width_px=float(WIDTH_PX),
        height_px=float(HEIGHT_PX),
        columns=columns,
        rows=rows,
    )


def drawn(picture: Window, missed=(3,), frames: int = FRAMES) -> list[str]:
    night = eight.night_of_eight(frames, missed=missed)
    cells = mark_characters(frame_marks(night.frame(frames)), picture)
    return [
        "".join(cells.get((column, row), (" ", ""))[0] for column in range(picture.columns))
        for row in range(picture.rows)
    ]


@pytest.mark.parametrize("size", FIELDS)
def test_every_track_of_a_slot_has_its_number_in_the_field(size: tuple[int, int]):
    said = drawn(window(*size))
    found = re.findall(r"○?\d+\*?", "\n".join(said))
    assert sorted(found) == sorted(["1", "2*", "○3", "4", "5", "6", "7", "8"])
    letters = "\n".join(to_ascii(line) for line in said)
    assert "2*" in letters
    assert "o3" in letters


def test_from_near_each_number_stands_at_its_own_streak():
    near = Window(x0_px=1900.0, y0_px=1500.0, width_px=928.0, height_px=512.0, columns=116, rows=32)
    night = eight.night_of_eight(FRAMES, missed=())
    cells = mark_characters(frame_marks(night.frame(FRAMES)), near)
    for track in range(1, eight.COUNT + 1):
        column, row = near.cell(*eight.place_px(track))
        near_by = {
            character
            for (at, line), (character, _) in cells.items()
            if abs(at - column) <= 10 and abs(line - row) <= 2
        }
        assert str(track) in near_by


def test_no_number_lies_on_a_streak_or_beside_another_number():
    crowd = [
        NumberedTrack(text=f"{n}", left=(10 + n % 3, 5), right=(11 + n % 3, 5), kind="member")
        for n in range(1, 13)
    ]
    streaks = {(column, 5) for column in range(10, 15)}
    cells = place_track_numbers(crowd, (40, 12), {}, streaks)
    assert not streaks & set(cells)
    runs: list[str] = []
    for row in range(12):
        line = "".join(cells.get((column, row), (" ", ""))[0] for column in range(40))
        runs += line.split()
    assert sorted(runs, key=int) == [f"{n}" for n in range(1, 13)]


def test_a_track_outside_the_picture_has_no_number_in_it():
    outside = NumberedTrack(text="9", left=(50, 5), right=(51, 5), kind="coasted")
    assert place_track_numbers([outside], (40, 12), {}, set()) == {}


def test_where_one_is_followed_alone_the_picture_has_no_numbers():
    night = eight.night_of_eight(1)
    for n in range(2, 4):
        for record in eight.story(n, since=1, tracks=(2,)):
            night.fold_record(n, record)
    assert not [mark for mark in frame_marks(night.frame(3)) if mark.is_numbered]
