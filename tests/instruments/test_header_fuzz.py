"""Headers with thousands of odd values: none breaks the reader, and what is not used is named."""

import random
import time
from typing import Any

import numpy as np
import pytest

from rsoconsole.instruments import NOTES_KEY, exposure_time, frame_from_array, header_site
from rsoconsole.records import Frame

HEADER: dict[str, Any] = {
    "DATE-OBS": "2023-06-23T05:31:30.300",
    "EXPTIME": 10.0,
    "RA": 313.4117471,
    "DEC": -4.669300384,
    "FOCALLEN": 620.0,
    "XPIXSZ": 15.2,
    "XBINNING": 4,
    "GAIN": 139.0,
    "XORGSUBF": 0,
    "SITELAT": "+29 11 24",
    "SITELONG": "-81 03 00",
}
"""Each fact in one card only."""
OTHERS: dict[str, Any] = {
    "DATE-OBS": "2023-06-23",
    "TIME-OBS": "05:31:30.3",
    "UT": 19890.3,
    "UTC": "05:31:30.3",
    "UT-STR": "5h 31m 30.3s",
    "UT-END": "05:31:40.3",
    "COADDS": 2,
    "CCDSUM": "4 4",
    "DATE-BEG": "2023-06-23T05:31:30.3",
    "DATE-AVG": "2023-06-23T05:31:35.3",
    "DATE-END": "2023-06-23T05:31:40.3",
    "MJD-OBS": 60118.23021180555,
    "JD": 2460118.7302118056,
    "TIMESYS": "UTC(NIST)",
    "EXPOSURE": "10,00000",
    "XPOSURE": "10.0 s",
    "OBJCTRA": "20 53 38.8",
    "OBJCTDEC": "-04 40 09",
    "PIXSIZE1": "3.8",
    "CCD-TEMP": -10.0,
    "GPS_SUTC": "2023-06-23T05:31:30.3",
    "GPS_SFLG": 51,
    "OBSGEO-X": 866_900.0,
    "OBSGEO-Y": -5_505_000.0,
    "OBSGEO-Z": 3_092_000.0,
}
PIXELS = np.zeros((64, 64), np.uint16)
COUNT, SHARE = 10_000, 10
ODD = (
    *("", " ", "'", "N/A", "nan", "inf", "-", ".", ",", ":", "T", "1e999", "1D-400", "0x10", "1/0"),
    *("12,345.6", "1.234,5", "١٢", "½", "２０２３", "\x00", "−4.7", "é" * 70, "9" * 70, "1" * 400),
    *(0, -1, 1, 10**30, 10**400, -(10**5000), 2**63, True, False, None),
    *(float("nan"), float("inf"), -float("inf"), 1e308, 5e-324, -0.0, 1e18, 24.0, 360.0, 90.0),
)
SEPARATORS = "-/.:,; TtZ+_dDeE"


def changed(value: Any, draw: random.Random) -> Any:
    """A value as somebody else, or a fault, might have written it."""
    text = str(value)
    at = draw.randrange(len(text))
    other = draw.choice(SEPARATORS)
    return draw.choice(
        (
            draw.choice(ODD),
            text[:at],
            text[at:],
            text.replace(draw.choice(text), other),
            text[:at] + other + text[at:],
            text[:at] + draw.choice("0123456789") + text[at + 1 :],
            text + draw.choice((" s", " ms", "h", "Z", "+02:00", " N", " W", "\u00b5m", "/2")),
            draw.uniform(-1.0, 1.0) * 10.0 ** draw.randint(-12, 20),
            draw.randint(-(10**6), 10**8),
            text.encode(),
        )
    )


def facts(frame: Frame) -> dict[str, Any]:
    """What is known of a frame by its header."""
    camera = frame.camera
    assert camera is not None
    return {
        "start": frame.t_start_utc_ns,
        "length": frame.exposure_s,
        "scale": frame.scale_arcsec_px,
        "pointing": frame.pointing_ra_icrs_deg,
        "binning": camera.binning,
        "gain": camera.gain,
        "corner": camera.x0_px,
        "site": header_site(frame.header).site,
    }


@pytest.fixture(scope="module")
def whole() -> set[str]:
    """Facts that the unchanged header states: all."""
    known = facts(frame_from_array(PIXELS, 1, "a", header=HEADER))
    assert None not in known.values()
    return set(known)


@pytest.mark.parametrize(
    "part",
    [
        pytest.param(n, marks=[] if n < 2 else [pytest.mark.nightly("more cases of the same")])
        for n in range(SHARE)
    ],
)
def test_no_value_breaks_the_reader_and_what_is_not_used_is_named(whole, part):
    slowest_s = 0.0
    for seed in range(part * COUNT // SHARE, (part + 1) * COUNT // SHARE):
        draw = random.Random(seed)
        base = HEADER if seed % 2 else HEADER | OTHERS
        key = draw.choice(list(base))
        header = base | {key: changed(base[key], draw)}
        began_s = time.monotonic()
        frame = frame_from_array(PIXELS, 1, "a", header=header)
        known = facts(frame)
        slowest_s = max(slowest_s, time.monotonic() - began_s)
        notes = (*frame.header[NOTES_KEY], *header_site(header).notes, exposure_time(header).fault)
        lost = [name for name in whole if known[name] is None]
        value = header[key]
        is_blank = value is None or (isinstance(value, str) and not value.strip())
        # Drivers write 0 where no focal length and no pixel size is set.
        is_blank |= key in ("FOCALLEN", "XPIXSZ", "PIXSIZE1") and value == 0
        if lost and not is_blank:
            assert any(key in note for note in notes), (seed, key, value, lost)
        elif lost and base is HEADER and key in ("DATE-OBS", "EXPTIME"):
            assert f"{key} is missing" in notes[-1], (seed, key, value)
        for note in notes:
            assert note.isprintable(), (seed, note)
            assert len(note) < 400, (seed, note)
    assert slowest_s < 2.0
