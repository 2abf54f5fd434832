"""How quick and how frugal a frame at full resolution is, in a real pseudo-terminal's application.

    python -m tests.bench.bench_sheet [--write]

Run from the project's root. The sample session's kept frame of 16 megapixels is opened in the
console's own screen: from the key to the picture, from a key to the next picture at every zoom and
stretch, from a setting to what the detector says, and the memory that the pixels take.
Prints; ``--write`` keeps the figures in ``results/sheet.json``.
"""

import argparse
import asyncio
import json
import platform
import time
from pathlib import Path
from statistics import median
from typing import Any

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.frame.frame_sheet import FrameSheet
from tests.nights.samples import SAMPLE
from tests.rigs.seat_rig import FakeWire

RESULTS = Path(__file__).parent / "results" / "sheet.json"
KEPT = 9
SIZES = ((80, 24), (200, 60))
REPEATS = 12


async def _until(is_so: Any) -> None:
    while not is_so():
        await asyncio.sleep(0.002)


def _drawn_ms(sheet: FrameSheet, change: Any) -> float:
    """Of a core, from a change of the view to all rows of its picture: others may share it."""
    began = time.thread_time()
    change()
    for row in range(sheet.picture.size.height):
        sheet.picture.render_line(row)
    return (time.thread_time() - began) * 1e3


async def _measure(size: tuple[int, int]) -> dict[str, float]:
    app = ConsoleApp(lambda: FakeWire(SAMPLE), session=SAMPLE)
    async with app.run_test(size=size):
        await _until(lambda: app.live.picture is not None)
        sheet = FrameSheet(SAMPLE, KEPT)
        began = time.perf_counter()
        app.push_screen(sheet)
        await _until(lambda: sheet.sheet.pixels is not None)
        open_ms = (time.perf_counter() - began) * 1e3
        await _until(lambda: sheet.sheet.done is not None)
        pans: list[float] = []
        zooms: list[float] = []
        for _ in range(REPEATS):
            zooms.append(_drawn_ms(sheet, sheet.action_zoom))
            pans += [
                _drawn_ms(sheet, lambda key=key: sheet.action_move(key))
                for key in ("left", "down", "right", "up")
            ]
        sheet.action_stretch()
        for _ in range(REPEATS):
            zooms.append(_drawn_ms(sheet, sheet.action_zoom))
        again: list[float] = []
        for by in (1, 1, -1, 1, -1, -1):
            began = time.perf_counter()
            sheet.action_tau(by)
            await _until(lambda: sheet.sheet.wanted is None)
            again.append((time.perf_counter() - began) * 1e3)
        pixels = sheet.sheet.pixels
        assert pixels is not None
        return {
            "open_ms": round(open_ms),
            "pan_ms_median": round(median(pans), 1),
            "pan_ms_worst": round(max(pans), 1),
            "zoom_ms_median": round(median(zooms), 1),
            "zoom_ms_worst": round(max(zooms), 1),
            "processed_again_ms_median": round(median(again)),
            "pixels_mb": round(pixels.nbytes / 1e6, 1),
        }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true")
    wants_writing = parser.parse_args().write
    figures: dict[str, Any] = {
        f"{width}x{height}": asyncio.run(_measure((width, height))) for width, height in SIZES
    }
    figures["machine"] = platform.processor() or platform.machine()
    print(json.dumps(figures, indent=2))
    if wants_writing:
        RESULTS.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
