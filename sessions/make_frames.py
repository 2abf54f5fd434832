"""Make the frames of own-frames.ipynb again: six of a simulated night, cut to their middle.

    python sessions/make_frames.py [--out FOLDER]

Run from the project's root; it takes half a minute. Scenario, world and seed are fixed: the same
frames come every time. What is kept of a header is what any camera's driver writes.
"""

import argparse
import shutil
import tempfile
from pathlib import Path

import numpy as np
from astropy.io import fits

from rsoconsole.cli.demo.demo import config_for_world, demo_config
from rsoconsole.cli.demo.demo_night import SimulatedNight, run_night
from rsoconsole.simulator import scenario_named, world_from

FRAMES = Path(__file__).parent / "frames"
SCENARIO, SEED = "intelsat-14", 119
WORLD = {"seeing": {"fwhm_arcsec": 4.0}, "sensor": {"binning": 4}}
TAKEN, KEPT = 9, range(4, 10)
"""Frames of the night, and which are kept: the telescope follows in these."""
WIDTH_PX, HEIGHT_PX = 960, 768
CARDS = ("DATE-OBS", "EXPTIME", "RA", "DEC", "FOCALLEN", "XPIXSZ", "YPIXSZ", "XBINNING", "YBINNING")


def record(folder: Path) -> None:
    """The night, with the pixels of all frames."""
    config = demo_config(
        scenario_named(SCENARIO).site, preset="adaptive", keep_frames="all", catalogue=[]
    )
    world = world_from(WORLD)
    night = SimulatedNight(
        scenario=SCENARIO,
        seed=SEED,
        speed=0.0,
        frames=TAKEN,
        session=folder,
        world=world.non_default_settings(),
    )
    run_night(config_for_world(world, config), night)


def cut(source: Path, target: Path) -> None:
    """The middle of a frame."""
    with fits.open(source) as hdus:
        hdu = next(each for each in hdus if each.data is not None)
        height, width = hdu.data.shape
        y0, x0 = (height - HEIGHT_PX) // 2, (width - WIDTH_PX) // 2
        pixels = np.asarray(hdu.data)[y0 : y0 + HEIGHT_PX, x0 : x0 + WIDTH_PX].astype(np.uint16)
        pixels >>= 4  # its converter has 12 bits
        header = fits.Header(
            [(key, hdu.header[key], hdu.header.comments[key]) for key in CARDS if key in hdu.header]
        )
    made = fits.CompImageHDU(pixels, header=header, compression_type="RICE_1")
    made.writeto(target, overwrite=True, checksum=False)


def main() -> None:
    """Make them, put them in place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=FRAMES)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "night"
        record(folder)
        shutil.rmtree(options.out, ignore_errors=True)
        options.out.mkdir(parents=True)
        for number in KEPT:
            (source,) = (folder / "frames").glob(f"{number:06d}.*")
            cut(source, options.out / f"frame-{number:02d}.fits.fz")
    sizes = [path.stat().st_size for path in options.out.iterdir()]
    print(f"{options.out}: {len(sizes)} frames, {sum(sizes) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
