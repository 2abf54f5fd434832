"""Make the sample session anew: a simulated night of Intelsat 14, small enough to ship.

    python sessions/make_sample.py [--frames 22]

Run from the project's root. The night is the demo's own, with seed 1. One frame keeps its pixels,
coded by HCOMPRESS instead of Rice (4 % smaller, as exact); all keep their pictures, in half as
many greys as the engine writes.
"""

import argparse
import io
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from astropy.io import fits

from rsoconsole.session.digest import sha256_of
from rsoconsole.session.frame_files import encode_preview

SAMPLE = Path(__file__).parent / "intelsat-14"
KEPT_FRAME = 9
MOST_BYTES = 10_000_000
GREYS = 0xF0
TILE_ROWS = 220
_RUN = "from rsoconsole.cli import main; main()"


def record(folder: Path, frames: int, place: Path) -> None:
    """One night of the demo, in an environment of its own."""
    home = {name: str(place / name.lower()) for name in ("XDG_DATA_HOME", "XDG_STATE_HOME")}
    runtime = place / "run"
    runtime.mkdir(mode=0o700)
    subprocess.run(
        [
            *(sys.executable, "-c", _RUN, "demo", "--headless", "--scenario", "intelsat-14"),
            *("--seed", "1", "--frames", str(frames), "--session", str(folder)),
            *("--keep-frames", "all"),
        ],
        check=True,
        env={**os.environ, **home, "XDG_RUNTIME_DIR": str(runtime)},
    )


def trim(folder: Path) -> None:
    """Leave one frame's pixels, and nothing of the machine it was made on."""
    for path in (folder / "frames").iterdir():
        if path.stem.split(".")[0] != f"{KEPT_FRAME:06d}":
            path.unlink()
        else:
            _code_smaller(path)
    for path in (*(folder / "previews").iterdir(), *(folder / "closeups").iterdir()):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        path.write_bytes(encode_preview(picture & np.uint8(GREYS)))
    with sqlite3.connect(folder / "session.db") as database:
        database.execute(
            "UPDATE files SET path = NULL, bytes = NULL, sha256 = NULL,"
            " reason = 'left out of the sample' WHERE role = 'frame' AND frame_id != ?",
            (KEPT_FRAME,),
        )
        for (path,) in database.execute("SELECT path FROM files WHERE path IS NOT NULL").fetchall():
            content = (folder / path).read_bytes()
            database.execute(
                "UPDATE files SET bytes = ?, sha256 = ? WHERE path = ?",
                (len(content), sha256_of(content), path),
            )
        ((text,),) = database.execute("SELECT value FROM meta WHERE key = 'config'")
        config = json.loads(text)
        config["session"]["root"] = "sessions"
        database.execute("UPDATE meta SET value = ? WHERE key = 'config'", (json.dumps(config),))
        database.execute("DELETE FROM meta WHERE key IN ('pid', 'writer')")
    with sqlite3.connect(folder / "session.db") as database:
        database.execute("PRAGMA journal_mode=DELETE")
        database.execute("VACUUM")
    lines = (folder / "config.toml").read_text(encoding="utf-8").splitlines()
    kept = ['root = "sessions"' if line.startswith("root = ") else line for line in lines]
    (folder / "config.toml").write_text("\n".join(kept) + "\n", encoding="utf-8")


def _code_smaller(path: Path) -> None:
    """The same pixels and cards in fewer bytes."""
    with fits.open(path, do_not_scale_image_data=True) as hdus:
        stored, header = np.array(hdus[1].data), hdus[1].header.copy()
    scale = header.pop("BSCALE", None), header.pop("BZERO", None)
    hdu = fits.CompImageHDU(
        data=stored.astype(np.int16),
        header=header,
        compression_type="HCOMPRESS_1",
        hcomp_scale=0,
        tile_shape=(TILE_ROWS, stored.shape[1]),
    )
    hdu.header["BSCALE"], hdu.header["BZERO"] = scale[0] or 1.0, scale[1] or 0.0
    buffer = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(buffer)
    with fits.open(path) as before, fits.open(io.BytesIO(buffer.getvalue())) as after:
        assert np.array_equal(before[1].data, after[1].data)
    path.write_bytes(buffer.getvalue())


def main() -> None:
    """Record, trim, put in place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=22)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "night"
        record(folder, options.frames, Path(name))
        trim(folder)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        print(f"{size / 1e6:.2f} MB")
        if size > MOST_BYTES:
            raise SystemExit(f"more than {MOST_BYTES / 1e6:.0f} MB: fewer frames")
        shutil.rmtree(SAMPLE, ignore_errors=True)
        shutil.copytree(folder, SAMPLE)


if __name__ == "__main__":
    main()
