"""Frames with headers of others, as a shell sees them: what is measured, and what is said."""

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from astropy.io import fits
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.instruments import read_frame
from rsoconsole.session import compress_frame
from rsoconsole.simulator import elements_path
from tests.pages.json_page import expect_documented

FRAME = Path(__file__).parents[2] / "sessions" / "frames" / "frame-04.fits.fz"
"""Began at 05:31:30.300 UTC on 23 June 2023; 10 s, 620 mm, 15.2 um after binning by 4."""
MIDDLE = "2023-06-23T05:31:35.300Z"
ONE_ARCSEC = 1 / 3600


def written(path: Path, **cards: Any) -> str:
    """Write the frame with some cards changed; those that are None are left out."""
    frame = read_frame(FRAME, 1)
    header = fits.Header()
    kept = ("DATE-OBS", "EXPTIME", "RA", "DEC", "FOCALLEN", "XPIXSZ", "XBINNING", "YBINNING")
    known = {key: frame.header[key] for key in kept if key in frame.header}
    for key, value in (known | {k.replace("__", "-"): v for k, v in cards.items()}).items():
        if value is not None:
            header[key] = value
    fits.PrimaryHDU(frame.pixels, header).writeto(path)
    return str(path)


def run(*words: str, code: int = 0) -> tuple[list[dict[str, Any]], str]:
    """The objects on standard output, and what is on standard error."""
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == code, result.output
    return [json.loads(line) for line in result.stdout.splitlines()], result.stderr


def lines(*words: str) -> str:
    return CliRunner().invoke(app, list(words)).output


@pytest.fixture(scope="module")
def measured() -> dict[str, Any]:
    """The frame as it is."""
    ((found), _) = run("process", str(FRAME))
    assert found[0]["t_mid_utc"] == MIDDLE
    return dict(found[0]["measurement"])


def test_times_in_other_forms_give_the_same_measurement(measured, tmp_path):
    forms: list[dict[str, Any]] = [
        {"EXPTIME": "10,00000"},
        {"EXPTIME": None, "XPOSURE": "10.0 s"},
        {"DATE__OBS": "2023-06-23 05:31:30.300"},
        {"DATE__OBS": "2023/06/23", "TIME__OBS": "05:31:30.300"},
        {"TIMESYS": "UTC(NIST)"},
        {"TIMESYS": "TAI", "DATE__OBS": "2023-06-23T05:32:07.300"},
        {"DATE__OBS": None, "MJD__OBS": 60118.230211805552},
    ]
    names = [written(tmp_path / f"{n}.fits", **form) for n, form in enumerate(forms)]
    for name in names:
        (found,), said = run("process", name)
        assert found["t_mid_utc"] == MIDDLE
        assert found["no_time"] is None
        assert found["measurement"]["ra"] == pytest.approx(measured["ra"], abs=ONE_ARCSEC)
        assert found["measurement"]["dec"] == pytest.approx(measured["dec"], abs=ONE_ARCSEC)
        assert said == ""


def test_a_card_that_is_no_fits_value_does_not_lose_the_frame(tmp_path):
    path = Path(written(tmp_path / "comma.fits"))
    content = path.read_bytes()
    at = content.index(b"EXPTIME =")
    path.write_bytes(
        content[:at] + b"EXPTIME =             10,00000".ljust(80) + content[at + 80 :]
    )
    (found,), _ = run("process", str(path))
    assert found["t_mid_utc"] == MIDDLE


@pytest.mark.parametrize(
    ("cards", "cause"),
    [
        ({"DATE__OBS": None}, "DATE-OBS is missing"),
        ({"EXPTIME": "ten"}, "EXPTIME 'ten' is not used"),
        ({"TIMESYS": "LOCAL"}, "TIMESYS 'LOCAL' is no time scale"),
        ({"DATE__OBS": "2023-06-23"}, "DATE-OBS '2023-06-23' names no time of day"),
    ],
)
def test_a_frame_without_a_time_says_why_everywhere(cards, cause, tmp_path):
    name = written(tmp_path / "a.fits", SITELAT=29.19, SITELONG=-81.05, **cards)
    (found,), _ = run("process", name)
    expect_documented("process", found)
    assert found["t_mid_utc"] is None
    assert cause in found["no_time"]
    assert f"not measured: no time of exposure: {found['no_time']}" in lines("process", name)
    words = ("identify", "--field", name, "--tle", str(elements_path()))
    (found,), _ = run(*words, code=1)
    assert "no time of exposure" in found["error"]
    assert cause in found["error"]


def test_times_that_contradict_each_other_are_noted_and_measured(tmp_path):
    (found,), said = run("process", written(tmp_path / "a.fits", MJD__OBS=60118.3))
    assert found["t_mid_utc"] == MIDDLE
    (note,) = found["notes"]
    assert "DATE-OBS is used" in note
    assert note in said


def test_the_site_is_the_headers_where_the_configuration_sets_none(tmp_path):
    place = {"SITELAT": "+45 12 30", "SITELONG": "9:15:00 W", "SITEELEV": 120}
    name = written(tmp_path / "a.fits", **place)
    folder = tmp_path / "session"
    (found,), _ = run("process", name, "--session", str(folder))
    assert found["site"]["source"] == "header"
    assert found["site"]["latitude_deg"] == pytest.approx(45.208333, abs=1e-6)
    assert found["site"]["longitude_deg"] == pytest.approx(-9.25)
    assert "by SITELAT and SITELONG of the header" in found["notes"][0]
    recorded = tomllib.loads((folder / "config.toml").read_text())["site"]
    assert recorded["longitude_deg"] == pytest.approx(-9.25)
    assert recorded["elevation_m"] == 120.0

    own = tmp_path / "own.toml"
    own.write_text("[site]\nlatitude_deg = 45.2\nlongitude_deg = -9.25\nelevation_m = 120\n")
    (found,), _ = run("process", name, "--config", str(own))
    assert found["site"]["source"] == "configuration"
    assert found["notes"] == []  # 0.9 km away
    own.write_text("[site]\nlatitude_deg = 44.2\nlongitude_deg = -9.25\n")
    (found,), _ = run("process", name, "--config", str(own))
    assert found["site"]["latitude_deg"] == 44.2
    assert "is 112 km from the configured" in found["notes"][0]


def test_no_place_is_not_taken_for_one(tmp_path):
    name = written(tmp_path / "a.fits", SITELAT=0.0, SITELONG=0.0)
    (found,), _ = run("process", name)
    assert found["site"]["source"] == "default"
    assert "are both 0 and not used" in found["notes"][0]


@pytest.mark.parametrize(
    ("cards", "hint", "cause"),
    [
        ({"XPIXSZ": 3.8}, "scale", "XPIXSZ 3.8 um is the size before binning by 4"),
        ({"RA": 20.894}, "position", "RA is in hours"),
        ({"RA": 0.0, "DEC": 0.0}, "position", "no mount is connected"),
        ({"FOCALLEN": 62.0}, "scale", "FOCALLEN 62 is in cm"),
    ],
)
def test_a_wrong_hint_is_solved_and_its_cause_named(cards, hint, cause, tmp_path):
    (found,), _ = run("solve", written(tmp_path / "a.fits", **cards))
    assert found["solved"]
    assert found["scale_arcsec_px"] == pytest.approx(5.0566, rel=1e-3)
    (wrong,) = found["wrong_hints"]
    assert wrong["hint"] == hint
    assert cause in wrong["reason"]
    assert "155" not in wrong["reason"]


def test_detect_names_what_it_does_not_use(tmp_path):
    (found,), said = run("detect", written(tmp_path / "a.fits", EXPTIME="ten"))
    assert len(found["detections"]) == 1
    assert found["notes"][0].startswith("EXPTIME 'ten' is not used")
    assert found["notes"][0] in said


def test_a_night_counts_its_frames_without_a_time(tmp_path):
    folder = tmp_path / "night"
    folder.mkdir()
    written(folder / "1.fits")
    written(folder / "2.fits", DATE__OBS=None)
    (found,), _ = run("process", str(folder), "--session", str(tmp_path / "made"))
    assert (found["frames"], found["without_time"]) == (2, 1)


@pytest.mark.parametrize(
    ("cards", "cause"),
    [
        ({"SITELAT": "N/A", "SITELONG": "N/A"}, "SITELAT 'N/A' is not used: it is not a latitude"),
        ({"SITELAT": 29.19}, "there is no SITELONG"),
        ({"SITELAT": 0.0, "SITELONG": 0.0}, "are both 0 and not used"),
        ({}, "nor do the headers of the first frames"),
    ],
)
def test_the_objects_of_a_frame_need_a_site_and_the_reason_for_none_is_named(
    cards, cause, tmp_path
):
    name = written(tmp_path / "a.fits", **cards)
    words = ["identify", "--field", name, "--tle", str(elements_path())]
    error = str(CliRunner().invoke(app, words).exception)
    assert "the configuration sets no site" in error
    assert cause in error


def test_a_frame_without_a_site_of_its_own_names_the_frame_that_has_it(tmp_path):
    first = written(tmp_path / "a.fits", SITELAT=29.19, SITELONG=-81.05)
    other = written(tmp_path / "b.fits", SITELAT="N/A", SITELONG="N/A")
    (_, found), _ = run("process", first, other)
    assert any("by SITELAT and SITELONG" in note for note in found["notes"])
    assert any("of the header of a.fits" in note for note in found["notes"])


def test_a_unit_in_a_comment_is_kept_in_a_session(tmp_path):
    name = written(tmp_path / "a.fits", EXPTIME=None)
    with fits.open(name, mode="update") as file:
        file[0].header["EXPTIME"] = (10_000.0, "[ms] exposure time")
    frame = read_frame(Path(name), 1)
    assert frame.exposure_s == 10.0
    kept = tmp_path / "kept.fits.fz"
    kept.write_bytes(compress_frame(frame))
    assert read_frame(kept, 1).exposure_s == 10.0
