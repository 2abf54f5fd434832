"""Make the README's pictures again: the console over a running demo, and two satellites of a slot.

    python sessions/make_picture.py [--frames 30]
    python sessions/make_picture.py --pair NIGHT --frames 7

The second draws one frame of a kept session, as this makes one:

    rsoconsole demo --headless --target "AMAZONAS 2" --target "AMAZONAS 3" --tle FILE
        --site 29.19,-81.05,10 --frames 8 --keep-frames all --session NIGHT

Run from the project's root. Needs ``resvg_py`` and the font DejaVu Sans Mono beside the project's
own packages.
"""

import argparse
import asyncio
import os
import re
import tempfile
from pathlib import Path

PICTURE = Path(__file__).parent / "console.png"
RED = Path(__file__).parent / "console-red.png"
PAIR = Path(__file__).parent / "pair.png"
SIZE = (120, 40)
WIDTH_PX = 1600
SPEED = 20.0
MAX_S = 300.0


async def taken(frames: int, session: Path) -> list[str]:
    """The screen as SVG in its colours and in the night's red, after a number of frames."""
    from rsoconsole.cli.demo.demo import demo_config
    from rsoconsole.cli.demo.demo_night import NightProcess, SimulatedNight
    from rsoconsole.console.app import ConsoleApp
    from rsoconsole.console.drawing.plain import NIGHT
    from rsoconsole.control import ControlClient, Sender, Shutdown
    from rsoconsole.simulator import elements_path, scenario_named

    scenario = scenario_named("intelsat-14")
    config = demo_config(
        scenario.site, preset="adaptive", keep_frames="none", catalogue=[elements_path()]
    )
    night = SimulatedNight(
        scenario=scenario.name, seed=1, speed=SPEED, frames=None, session=session
    )
    process = NightProcess(config, night)
    app = ConsoleApp(lambda: ControlClient(process.socket, sender=Sender(name="console picture")))
    try:
        async with app.run_test(size=SIZE) as pilot:
            waited_s = 0.0
            while (app.live.engine.frame_id or 0) <= frames or app.live.engine.state != "TRACK":
                await pilot.pause(0.2)
                waited_s += 0.2
                if waited_s > MAX_S:
                    raise TimeoutError("the demo did not come so far")
            await pilot.pause(1.0)
            screens = [app.export_screenshot(title="rsoconsole")]
            app.theme = NIGHT
            await pilot.pause(1.0)
            return [*screens, app.export_screenshot(title="rsoconsole")]
    finally:
        ControlClient(process.socket, sender=Sender(name="picture")).send(Shutdown())
        process.wait_for_figures()


def draw_pair(session: Path, frame_id: int) -> None:
    """Two streaks of one frame with the numbers of their tracks."""
    from rsoconsole import open_session

    figure = open_session(session).plot_tracks(frame_id)
    axes = figure.axes[0]
    axes.set_xlim(1850, 2110)
    axes.set_ylim(1872, 1735)
    figure.set_size_inches(7.2, 4.2)
    axes.set_title("Amazonas 2 and 3, one exposure of 10 s, simulated", loc="left", fontsize=10)
    figure.savefig(PAIR, dpi=110, bbox_inches="tight")
    print(f"{PAIR}: {PAIR.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    """Run, take, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--pair", type=Path, help="a session with kept frames")
    options = parser.parse_args()
    if options.pair is not None:
        draw_pair(options.pair, options.frames)
        return
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        (place / "run").mkdir(mode=0o700)
        os.environ["XDG_RUNTIME_DIR"] = str(place / "run")
        for kind in ("DATA", "STATE", "CACHE", "CONFIG"):
            os.environ[f"XDG_{kind}_HOME"] = str(place / kind.lower())
        screens = asyncio.run(taken(options.frames, place / "night"))
    import resvg_py

    for path, svg in zip((PICTURE, RED), screens, strict=True):
        plain = re.sub(r"@font-face \{.*?\}", "", svg, flags=re.DOTALL)
        plain = plain.replace("Fira Code", "DejaVu Sans Mono")
        path.write_bytes(bytes(resvg_py.svg_to_bytes(svg_string=plain, width=WIDTH_PX)))
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
