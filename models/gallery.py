"""A contact sheet of the worst misses and false alarms, to be looked at beside the figures."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from models.figures import Alarm, Outcome, Trail
from models.frames import Kind, draw

ByteArray = npt.NDArray[np.uint8]

COLUMNS, ROWS = 6, 2
"""Number of columns and rows of misses; the false alarms below have as many."""
SHORTEST_PX = 30.0
_TILE_PX, _CAPTION_PX = 140, 30
_LEVELS = 24
_DARKEST, _BRIGHTEST = -2.0, 8.0
"""Black and white, in sigma of the sky."""


def contact_sheet(seen: Outcome, tau: float, path: Path) -> None:
    """Write a grey PNG: the brightest missed streaks above, the likeliest false alarms below."""
    count = COLUMNS * ROWS
    missed = [t for t in seen.trails if not t.is_found(tau) and t.true["length_px"] >= SHORTEST_PX]
    missed = sorted(missed, key=lambda t: -t.true["peak_snr"])[:count]
    alarms = sorted((a for a in seen.alarms if a.confidence > tau), key=lambda a: -a.confidence)
    tiles = [_of_miss(trail) for trail in missed] + [_blank()] * (count - len(missed))
    tiles += [_of_alarm(alarm) for alarm in _one_a_frame(alarms)[:count]]
    tiles += [_blank()] * (2 * count - len(tiles))
    lines = [np.hstack(tiles[at : at + COLUMNS]) for at in range(0, len(tiles), COLUMNS)]
    lines = [line for line in lines if line.any()] or lines[:1]
    cv2.imwrite(str(path), np.vstack(lines), [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _one_a_frame(alarms: Sequence[Alarm]) -> list[Alarm]:
    first = {(alarm.kind, alarm.number): alarm for alarm in reversed(alarms)}
    return sorted(first.values(), key=lambda a: -a.confidence)


def _of_miss(trail: Trail) -> ByteArray:
    true = trail.true
    caption = f"missed: SNR {true['peak_snr']:.1f}, {true['length_px']:.0f} px", trail.lost()
    place = true["x_px"], true["y_px"]
    return _tile(trail.kind, trail.number, place, true["length_px"], caption)


def _of_alarm(alarm: Alarm) -> ByteArray:
    caption = f"false: {alarm.confidence:.2f}, {alarm.length_px:.0f} px", alarm.kind
    return _tile(alarm.kind, alarm.number, (alarm.x_px, alarm.y_px), alarm.length_px, caption)


def _tile(
    kind: Kind, number: int, place: tuple[float, float], length_px: float, caption: tuple[str, str]
) -> ByteArray:
    """A cut-out about a place, as wide as shows all of it, with two lines of words below."""
    pixels = draw("test", kind, number).frame.pixels
    side = int(np.clip(1.3 * length_px, _TILE_PX, min(pixels.shape)))
    x0 = int(np.clip(place[0] - side / 2, 0, pixels.shape[1] - side))
    y0 = int(np.clip(place[1] - side / 2, 0, pixels.shape[0] - side))
    cut = pixels[y0 : y0 + side, x0 : x0 + side].astype(np.float32)
    sky = float(np.median(cut))
    sigma = 1.4826 * float(np.median(np.abs(cut - sky))) + 1e-6
    size = (_TILE_PX - 4, _TILE_PX - 4)
    small = cv2.resize((cut - sky) / sigma, size, interpolation=cv2.INTER_AREA)
    share = np.clip((small - _DARKEST) / (_BRIGHTEST - _DARKEST), 0.0, 1.0)
    tile = _blank()
    grey = np.rint(share * (_LEVELS - 1)) * (255 // (_LEVELS - 1))
    tile[2 : 2 + size[1], 2 : 2 + size[0]] = grey.astype(np.uint8)
    for line, text in enumerate(caption):
        at = (3, _TILE_PX + 10 + 13 * line)
        cv2.putText(tile, text[:30], at, cv2.FONT_HERSHEY_SIMPLEX, 0.3, 230, 1)
    return tile


def _blank() -> ByteArray:
    return np.zeros((_TILE_PX + _CAPTION_PX, _TILE_PX), dtype=np.uint8)
