"""Pictures of the real sky on which fields may be drawn: files, authors and licences.

The pictures are no part of the project, and training works without them. Files are known by name;
all files of a camera belong either to training or to evaluation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.vision import WIDE_PX, find_stars

Float32Array = npt.NDArray[np.float32]
Ends = tuple[float, float, float, float]
Split = Literal["real-train", "real-test"]
SPLITS: tuple[Split, Split] = ("real-train", "real-test")
Licence = Literal["MIT", "GPL-3.0"]
SUFFIXES = (".fits", ".fit", ".fz", ".tif", ".tiff", ".png")
_WANTED_PX = 3.0
SMALLEST_PX = 240
"""Least side of a picture; a smaller one would be enlarged until its noise is smooth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """One file of pictures of the real sky: its camera, licence, source and use."""

    name: str
    camera: str
    licence: Licence
    source: str
    split: Split
    images: tuple[int | str, ...] = (0,)
    """Images to use of a FITS file, by number or name."""
    inner: tuple[int, int, int, int] | None = None
    """Part of the picture that shows sky: left, top, right, bottom (px); None: all of it."""
    trails: tuple[Ends, ...] = ()
    """Ends (x, y, x, y in px) of satellites, aircraft and meteors that the picture shows.

    Candidates on them count neither as found nor as false.
    """


def _video(name: str, camera: str, split: Split, *trails: Ends) -> Background:
    return Background(
        name=name,
        camera=camera,
        licence="GPL-3.0",
        source="markmac99/MeteorTools, ukmon-pitools",
        split=split,
        images=("AVEPIXEL",),
        trails=trails,
    )


BACKGROUNDS: tuple[Background, ...] = (
    _video(
        "FF_UK0006_20220914_194911_205_0079616.fits",
        "video camera UK0006",
        "real-train",
        (498, 24, 465, 380),
    ),
    _video(
        "FF_UK0006_20230421_235707_829_0346880.fits",
        "video camera UK0006",
        "real-train",
        (727, 503, 618, 536),
    ),
    _video("FF_UK0006_20230422_014402_836_0507136.fits", "video camera UK0006", "real-train"),
    _video(
        "FF_UK000F_20230421_211420_630_0100864.fits",
        "video camera UK000F",
        "real-test",
        (970, 409, 971, 448),
        (1113, 432, 1108, 473),
        (903, 57, 840, 122),
    ),
    _video(
        "FF_UK000F_20230423_211608_437_0109056.fits",
        "video camera UK000F",
        "real-test",
        (894, 135, 899, 170),
        (659, 324, 598, 304),
        (811, 107, 875, 176),
    ),
    Background(
        name="huntsman_science_0.fits",
        camera="Huntsman lens",
        licence="MIT",
        source="AstroHuntsman/huntsman-drp",
        split="real-train",
    ),
    Background(
        name="lco_mef_raw_test_frame.fits",
        camera="LCO fa05",
        licence="GPL-3.0",
        source="LCOGT/neoexchange",
        split="real-train",
        images=(1, 2, 3, 4),
        inner=(2, 2, 510, 510),
    ),
    Background(
        name="oresat_capture-2022-09-25.png",
        camera="OreSat star tracker",
        licence="GPL-3.0",
        source="oresat",
        split="real-train",
    ),
    Background(
        name="pocs_unsolved.fits",
        camera="POCS",
        licence="MIT",
        source="panoptes/POCS",
        split="real-test",
    ),
    Background(
        name="astride_long.fits",
        camera="Apogee CCD",
        licence="MIT",
        source="dwkim78/ASTRiDE",
        split="real-test",
        trails=((22, 338, 340, 308),),
    ),
    Background(
        name="cutout_frame-i-008108-5-0025.fits",
        camera="SDSS",
        licence="MIT",
        source="dirac-institute/trailblazer",
        split="real-test",
    ),
)
"""Known files. Cameras whose frames are used in tests of the detector are for evaluation alone."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plane:
    """One picture, with its pixels binned where its stars are wide."""

    camera: str
    pixels: Float32Array
    """Pixels (height, width), ADU."""
    fwhm_px: float
    """FWHM of the picture's stars after binning."""
    trails: tuple[Ends, ...]
    """Ends of the trails in the picture, in its binned pixels."""


def find(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """The known files below ``folder`` by name, and the names of unknown pictures there.

    Raises SystemExit where no file is known.
    """
    there = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
    wanted = {each.name for each in BACKGROUNDS}
    known = {path.name: path for path in there if path.name in wanted}
    if not known:
        raise SystemExit(
            f"no known background in {folder}: models/backgrounds.py has their names; "
            "without --backgrounds training draws all its stars"
        )
    return known, sorted({path.name for path in there} - wanted)


def cameras(folder: Path, split: Split) -> tuple[str, ...]:
    """Cameras of this split that have a picture below ``folder``."""
    known, _ = find(folder)
    named = (each for each in BACKGROUNDS if each.split == split and each.name in known)
    return tuple(dict.fromkeys(each.camera for each in named))


@lru_cache(maxsize=2)
def planes(folder: Path, camera: str) -> tuple[Plane, ...]:
    """All pictures of one camera below ``folder`` that are large enough."""
    known, _ = find(folder)
    made = [
        _joined(entry, pixels)
        for entry in BACKGROUNDS
        if entry.camera == camera and entry.name in known
        for pixels in _read(known[entry.name], entry)
    ]
    return tuple(plane for plane in made if min(plane.pixels.shape) >= SMALLEST_PX)


def _read(path: Path, entry: Background) -> list[Float32Array]:
    if path.suffix.lower() in {".png", ".tif", ".tiff"}:
        import cv2

        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise SystemExit(f"{path} cannot be read: is it whole?")
        # Of a colour picture the green, which has most of the light.
        pictures: Sequence[npt.NDArray[np.generic]] = [image if image.ndim == 2 else image[..., 1]]
    else:
        from astropy.io import fits

        with fits.open(path) as hdus:
            pictures = [np.asarray(hdus[image].data) for image in entry.images]
    left, top, right, bottom = entry.inner or (0, 0, None, None)
    return [
        np.ascontiguousarray(picture[top:bottom, left:right], dtype=np.float32)
        for picture in pictures
    ]


def _joined(entry: Background, pixels: Float32Array) -> Plane:
    """Picture with pixels joined as in the working frame: until stars are about three wide."""
    import cv2

    pixels = np.nan_to_num(pixels, nan=float(np.nanmedian(pixels)))
    fwhm_px = find_stars(pixels, saturation_adu=float(pixels.max())).median_fwhm_px
    side = max(1, round(fwhm_px / _WANTED_PX)) if fwhm_px >= WIDE_PX else 1
    if side > 1:
        height, width = (size // side for size in pixels.shape)
        whole = pixels[: height * side, : width * side]
        pixels = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    left, top = (entry.inner or (0, 0))[:2]

    def at(x_px: float, y_px: float) -> tuple[float, float]:
        return (x_px - left + 0.5) / side - 0.5, (y_px - top + 0.5) / side - 0.5

    trails = tuple((*at(*ends[:2]), *at(*ends[2:])) for ends in entry.trails)
    return Plane(camera=entry.camera, pixels=pixels, fwhm_px=fwhm_px / side, trails=trails)
