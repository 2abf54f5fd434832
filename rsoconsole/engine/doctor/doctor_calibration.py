"""The doctor's look at the master frames: whether each can be read and belongs to the camera."""

from collections.abc import Iterator, Sequence

from rsoconsole.config import Config
from rsoconsole.engine.doctor.doctor_check import Check, well
from rsoconsole.pipeline.frame import Master, Traits, is_same_exposure, nearest_dark, read_masters
from rsoconsole.words import TAKE_DARK

BIAS_GONE = 0.5
"""Of the bias's level: a dark below it has had its bias taken off."""


def check_calibration(config: Config) -> Check:
    """The configured master frames are there, have the camera's size and the exposure's length."""
    if not config.calibration.files:
        return well("no master frames: frames are used as they come")
    masters, faults = read_masters(config.calibration)
    camera = Traits(
        width_px=config.optics.width_px,
        height_px=config.optics.height_px,
        exposure_s=config.exposure.exposure_s,
        temperature_c=None,
    )
    doubts = list(_doubts(masters, camera))
    loaded = [f"{each.setting.removesuffix('s')} {each.words}" for each in masters]
    return Check(
        ok=False if faults else None if doubts else True,
        detail="; ".join([*loaded, *faults, *(words for words, _ in doubts)]),
        remedy="; ".join(
            [
                *(["correct the paths in calibration, or leave them out"] if faults else []),
                *dict.fromkeys(remedy for _, remedy in doubts),
            ]
        ),
    )


def _doubts(masters: Sequence[Master], camera: Traits) -> Iterator[tuple[str, str]]:
    """Why a master would not be used, or not be right, and what to do."""
    for each in masters:
        if not each.traits.has_pixels_of(camera):
            yield (
                f"{each.path.name} does not fit the camera's {camera.size_words}",
                "give masters of the camera's binning, or correct optics.width_px and"
                " optics.height_px",
            )
    fitting = [each for each in masters if each.traits.has_pixels_of(camera)]
    bias = next((each for each in fitting if each.setting == "bias"), None)
    dark = nearest_dark(fitting, camera)
    if dark is None and bias is None and any(each.setting == "flat" for each in fitting):
        yield (
            "the flat is not used without a dark or bias of its size",
            "name one in calibration.darks or calibration.bias",
        )
    if dark is None:
        return
    if bias is None and not is_same_exposure(dark.traits.exposure_s, camera.exposure_s):
        yield (
            f"no dark is known to be of {camera.exposure_s:g} s: {dark.path.name} is used as it is",
            f"{TAKE_DARK}, or calibration.bias to scale it",
        )
    if bias is not None and dark.level_adu < BIAS_GONE * bias.level_adu:
        yield (
            f"{dark.path.name} ({dark.level_adu:.0f} ADU) lies below the bias"
            f" ({bias.level_adu:.0f} ADU)",
            "give a dark with the camera's offset still in it",
        )
