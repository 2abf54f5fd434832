"""The title over a frame at full resolution, and what is at the cross in it."""

import math
import time

from rsoconsole.console.frame.sheet import Sheet
from rsoconsole.console.picture import STEPS, View
from rsoconsole.pipeline.frame import HELD
from rsoconsole.words import direction


def title_parts(sheet: Sheet) -> list[str]:
    """Which frame, how close, in which light."""
    parts = [f"frame {sheet.frame_id:04d}", *([sheet.end_words] if sheet.is_marking else [])]
    opened = sheet.opened
    if opened is not None and sheet.pixels is None and not sheet.fault:
        seconds = time.monotonic() - sheet.began_s
        parts.append(f"reading {opened.bytes / 1e6:.1f} MB … {seconds:.1f} s")
    if sheet.pixels is None or sheet.view is None:
        return [*parts, "preview"]
    parts.append(scale_words(sheet.view))
    if sheet.map is not None:
        return [*parts, "network's map", f"{sheet.map.block} px a cell"]
    if sheet.sees_as_network:
        return [*parts, "making the map …"]
    if opened is not None and opened.recorded.taken.exposure_s is not None:
        parts.append(f"{opened.recorded.taken.exposure_s:g} s")
    return [*parts, sheet.stretch]


def step_px(sheet: Sheet) -> float:
    """Pixels that an arrow goes."""
    squares = STEPS[sheet.step]
    return squares * (1.0 if sheet.view is None else sheet.view.px_per_square)


def step_words(sheet: Sheet) -> str:
    """How far an arrow goes: step 4 squares = 16 px."""
    squares, px = STEPS[sheet.step], step_px(sheet)
    if squares == px:
        return f"step {px:g} px"
    return f"step {squares} square{'s' if squares > 1 else ''} = {px:.3g} px"


def mark_words(sheet: Sheet) -> str:
    """How a mark that is being made goes on."""
    keys = "arrows move ╋ (shift: far), enter sets it"
    kept = f"frame {sheet.frame_id} stays markable meanwhile, for {HELD} frames"
    return f"{sheet.end_words}: {keys}; {step_words(sheet)}, [ ] changes it; {kept}"


def scale_words(view: View) -> str:
    """How close."""
    if view.zoom is None:
        return "whole field"
    if view.zoom < 0:
        return f"{2**-view.zoom}×{2**-view.zoom} squares a px"
    return "pixel by pixel" if view.zoom == 0 else f"{2**view.zoom} px a square"


def readout_parts(sheet: Sheet) -> list[str]:
    """What is at the cross: pixel, light, direction."""
    view, pixels = sheet.view, sheet.pixels
    if view is None or pixels is None:
        return []
    x, y = math.floor(view.x_px + 0.5), math.floor(view.y_px + 0.5)
    parts = [f"╋ {x},{y}", f"step {step_px(sheet):.3g} px"]
    frame_map = sheet.map
    if frame_map is not None and frame_map.mode == "fast":
        from rsoconsole.console.picture import map_sigma

        parts.append(f"{map_sigma(frame_map, x, y):.1f}σ")
    else:
        parts.append(f"{pixels.adu(x, y):g} ADU")
    solution = sheet.solution
    if solution is None:
        parts.append("not solved")
    else:
        from rsoconsole.sky import pixel_to_sky

        ra, dec = (float(angle) for angle in pixel_to_sky(solution.wcs, x, y))
        parts.append(direction(ra, dec))
    return parts
