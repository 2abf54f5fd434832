"""A sheet of drawn fields with their truth, to be looked at: ``python -m models.contact_sheet``."""

import argparse
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.field_scene import draw_field, draw_sensor
from models.fields import KINDS, Conditions, Field
from rsoconsole.simulator import frame_rng

ByteArray = npt.NDArray[np.uint8]
_ZOOM = 2
_ASKED, _NOT_ASKED, _WORDS = (80, 255, 80), (60, 160, 255), (255, 255, 120)
_SHEETS = 90
"""First number of the generator's key, which no split of ``dataset`` has."""


def picture(field: Field) -> ByteArray:
    """Image of a field with its kind and two lines beside each true streak.

    The lines are green where the detector is expected to find the streak.
    """
    size = (field.values.shape[1] * _ZOOM, field.values.shape[0] * _ZOOM)
    grey = cv2.resize(field.values, size, interpolation=cv2.INTER_NEAREST)
    image = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for streak in field.streaks:
        length = max(streak.length, 1e-6)
        off = np.array([-(streak.y_b - streak.y_a), streak.x_b - streak.x_a]) / length * 3.0
        colour = _ASKED if streak.is_asked else _NOT_ASKED
        for side in (-1, 1):
            a = (np.array([streak.x_a, streak.y_a]) + side * off) * _ZOOM
            b = (np.array([streak.x_b, streak.y_b]) + side * off) * _ZOOM
            cv2.line(image, tuple(map(int, a)), tuple(map(int, b)), colour, 1, cv2.LINE_AA)
        place = (int(streak.x_b * _ZOOM) + 6, int(streak.y_b * _ZOOM))
        words = f"{streak.peak_snr:.1f}"
        cv2.putText(image, words, place, cv2.FONT_HERSHEY_PLAIN, 0.8, colour, 1, cv2.LINE_AA)
    words = f"{field.kind}, {field.mode}, block {field.block}"
    cv2.putText(image, words, (4, 12), cv2.FONT_HERSHEY_PLAIN, 0.9, _WORDS, 1, cv2.LINE_AA)
    return cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=(90, 90, 90))


def sheet(fields: list[Field], columns: int) -> ByteArray:
    """Image of several fields, ``columns`` in a row."""
    tiles = [picture(field) for field in fields]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    return np.vstack(rows)


def main() -> None:
    """Run the command line: draw a contact sheet and write it."""
    parser = argparse.ArgumentParser(prog="python -m models.contact_sheet", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("models/runs/contact_sheet.png"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fields", type=int, default=24)
    parser.add_argument("--columns", type=int, default=6)
    parser.add_argument("--block", type=int, choices=(2, 4, 8, 16), default=8)
    parser.add_argument("--kind", choices=KINDS, default=None)
    parser.add_argument("--ordinary-night", action="store_true", help="as the telescope meets them")
    args = parser.parse_args()
    rng = frame_rng(args.seed, _SHEETS, args.block)
    is_hard = not args.ordinary_night
    wanted = Conditions(kind=args.kind, is_hard=is_hard)
    fields = []
    for number in range(args.fields):
        if number % 4 == 0:
            sensor = draw_sensor(args.block, rng, is_hard=is_hard)
        fields.append(draw_field(sensor, args.block, wanted, rng))
    args.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(args.out), sheet(fields, args.columns))
    print(f"{len(fields)} fields in {args.out}")


if __name__ == "__main__":
    main()
