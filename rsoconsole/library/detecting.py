"""``rso.detect``: streaks in frames."""

from typing import TYPE_CHECKING, Any, Literal

from rsoconsole.library.columns import table_of
from rsoconsole.library.frames import Frames, frame_facts, opened
from rsoconsole.library.given import ConfigLike, Number, config_of
from rsoconsole.pipeline.single import FrameDetector
from rsoconsole.records import Detections

if TYPE_CHECKING:
    from astropy.table import QTable


def detect(
    frames: Frames,
    *,
    tau: float | None = None,
    map_mode: Literal["fast", "paper"] | None = None,
    extension: str | None = None,
    exposure: Number | None = None,
    scale: Number | None = None,
    config: ConfigLike = None,
) -> "QTable":
    """Find streaks in frames, as ``rsoconsole detect`` does.

    ``frames``: a path (FITS, also .gz, .bz2 and fpack; TIFF; PNG), an array (height, width) of
    integers or real numbers in ADU, a ``CCDData``, an HDU, or any number of these; a mask's
    pixels are filled from their neighbours. ``tau``: the confidence that a detection must exceed;
    ``map_mode``: the map that the network sees; None: as configured. ``extension``: which image
    of a FITS file that has several; ``"all"``: each. ``exposure`` (s) and ``scale`` (arcsec/pix)
    are for frames whose header does not tell them: classes and notes depend on both. ``config``:
    None for the user's own.

    Returns one table for all frames, a row a streak, frame by frame, the most confident first,
    with the columns of a session's ``detections`` (``sessions/README.md``) and ``frame``, the
    frame's name. ``x_px``, ``y_px`` in pixels from the centre of the first pixel (0, 0), x along
    a row of the array. ``meta["frames"]`` names all frames, also those without a streak;
    ``meta["notes"]`` says what is unusual about them.

    Raises FrameError for a frame that cannot be used (damaged, NaN, three axes, below 64 px),
    InputError for other input that cannot be, ConfigError, ModelError.

    >>> streaks = rso.detect("frame.fits", tau=0.2)
    >>> streaks["x_px", "y_px", "length_px", "confidence"]
    """
    settings = config_of(config, {"detector.tau": tau, "detector.map_mode": map_mode})
    said = frame_facts(extension=extension, exposure=exposure, scale=scale)
    detector = FrameDetector(settings)
    found: list[Detections] = []
    names: dict[int, str] = {}
    notes: dict[str, None] = {}
    for frame in opened(frames, said):
        detections, words = detector.detect(frame)
        found.append(detections)
        names[frame.frame_id] = frame.name
        notes |= dict.fromkeys(f"{frame.name}: {each}" for each in words)
    meta: dict[str, Any] = {"frames": list(names.values()), "notes": list(notes)}
    return table_of("detections", found, meta, names=names)
