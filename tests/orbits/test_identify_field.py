"""identify --field as a shell sees it: rendered frames, their catalogue, what goes wrong."""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from astropy.io import fits
from sgp4.api import SatrecArray
from sgp4.exporter import export_tle
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import CatalogueEntry, parse_element_sets
from rsoconsole.orbits.elements.sky_paths import Observer
from rsoconsole.simulator import elements_path
from rsoconsole.simulator.camera.truth import FrameTruth
from rsoconsole.sky import separation_deg, unit_to_direction
from rsoconsole.words import NS_PER_S
from tests.pages.json_page import expect_documented
from tests.truth.fields_of_truth import SITE, behind, passing
from tests.truth.seen_satellites import SHARED
from tests.truth.simulated_fields import HIGH_MAG, LOW_MAG, rendered

OPTICS = OpticsConfig(width_px=1164, height_px=880, pixel_um=7.6, focal_length_mm=620.0)
T_UTC_NS = 1_687_399_200 * NS_PER_S
"""22 June 2023, 02:00: low objects over Florida are lit."""
SES_10, SES_17 = 42432, 49332
LATE_S = {901: 0.0, 902: 25.0, 903: -30.0}
"""Low objects: how far behind their elements they are."""
STRANGER = 904
"""A low object that is in no catalogue."""


MOSAIC = SHARED / "field" / "stars" / "lco_mef_raw_test_frame.fits"
"""A real frame of another observatory: four images in one file."""


class Night(NamedTuple):
    """Files."""

    folder: Path
    truth: FrameTruth

    @property
    def whole(self) -> list[str]:
        """The verb with its catalogue and its site."""
        at = self.folder
        return ["identify", "--field", "--tle", str(at / "cat.tle"), "--config", str(at / "c.toml")]


def belt(*numbers: int) -> list[CatalogueEntry]:
    entries = parse_element_sets(Path(elements_path()).read_text(encoding="ascii")).entries
    return [each for each in entries if each.norad_id in numbers]


def lines_of(entry: CatalogueEntry) -> str:
    entry.record.intldesg = "23001A"
    return "\n".join([entry.name, *export_tle(entry.record)])


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Night:
    """Two geostationary objects and four low ones cross a frame of 4 s; five of 0.2 s follow."""
    folder = tmp_path_factory.mktemp("field")
    high = belt(SES_10, SES_17)
    seen = Observer(SITE, T_UTC_NS).places_at_leads(SatrecArray([high[0].record]), np.zeros(1))
    ra, dec = (float(x) for x in unit_to_direction(seen.u[0, 0]))
    places = {901: (0.1, 0.12), 902: (-0.15, 0.15), 903: (0.08, -0.08), STRANGER: (-0.2, -0.15)}
    orbits = {
        901: (800.0, 98.0),
        902: (1400.0, 52.0),
        903: (1000.0, 82.0),
        STRANGER: (1200.0, 66.0),
    }
    low = []
    for number, (east, north) in places.items():
        u = np.array(
            [
                np.cos(np.radians(dec + north)) * np.cos(np.radians(ra + east)),
                np.cos(np.radians(dec + north)) * np.sin(np.radians(ra + east)),
                np.sin(np.radians(dec + north)),
            ]
        )
        height, tilt = orbits[number]
        low.append(passing(number, u, T_UTC_NS, height_km=height, inclination_deg=tilt))
    there = [*((each, HIGH_MAG) for each in high), *((each, LOW_MAG) for each in low)]
    truth = rendered(folder / "long.fits", there, (ra, dec), (T_UTC_NS, 1.0), optics=OPTICS)
    for k in range(5):
        when = (T_UTC_NS + (60 + 6 * k) * NS_PER_S, 0.2)
        there = [(each, HIGH_MAG - 1.5) for each in high]
        rendered(folder / f"short_{k}.fits", there, (ra + 0.3, dec), when, optics=OPTICS)
    known = [behind(each, -LATE_S[each.norad_id]) for each in low if each.norad_id in LATE_S]
    (folder / "cat.tle").write_text("\n".join(map(lines_of, [*high, *known])) + "\n")
    (folder / "c.toml").write_text(
        f"[site]\nlatitude_deg = {SITE.latitude_deg}\nlongitude_deg = {SITE.longitude_deg}\n"
        f"elevation_m = {SITE.elevation_m}\n"
    )
    return Night(folder, truth)


def answers(*arguments: str, code: int = 0) -> list[dict[str, Any]]:
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == code, done.output
    return [json.loads(line) for line in done.stdout.splitlines()]


def said(*arguments: str, code: int = 1) -> str:
    done = CliRunner().invoke(app, [*arguments])
    assert done.exit_code == code, done.output
    return " ".join(done.output.split())


def test_low_and_high_objects_of_a_frame_are_each_named_and_a_stranger_is_not(night):
    (found,) = answers(*night.whole, "--plate", "header", str(night.folder / "long.fits"))
    expect_documented("identify --field", found)
    names = {}
    for streak in found["streaks"]:
        (truth,) = [
            each
            for each in night.truth.satellites
            if np.hypot(each.x_px - streak["x"], each.y_px - streak["y"]) < 25.0
        ]
        names[truth.norad_id] = streak
    for number, late_s in LATE_S.items():
        assert names[number]["verdict"] == "identified", number
        (match,) = names[number]["matches"]
        assert match["norad_id"] == number
        assert match["along_track_s"] == pytest.approx(-late_s, abs=0.15)
        assert abs(match["cross_track_arcsec"]) < 30.0
    assert names[STRANGER]["verdict"] == "unknown"
    assert names[STRANGER]["matches"] == []
    assert {each["norad_id"] for each in found["matches"]} >= set(LATE_S)
    assert all(each["probability"] > 0.9 and each["streak"] for each in found["matches"])
    unmatched = {each["streak"] for each in found["unmatched_detections"]}
    assert names[STRANGER]["streak"] in unmatched
    assert unmatched.isdisjoint(each["streak"] for each in found["matches"])
    high = {each["norad_id"]: each for each in found["crossed"]}
    missed = [each["norad_id"] for each in found["expected_not_seen"]]
    assert missed == [n for n in high if high[n]["streak"] is None and high[n]["chance"] >= 0.5]
    # 15 arcsec are too short for a streak here: it is said, and nothing else is called so.
    for number in (SES_10, SES_17):
        if high[number]["streak"] is None:
            assert high[number]["unseen_because"] is not None
    for number in LATE_S:
        assert high[number]["streak"] is not None
        assert high[number]["unseen_because"] is None


def test_what_it_prints_of_frames_goes_into_the_ledger_of_element_errors(
    night, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    file = tmp_path / "field.jsonl"
    shorts = [f"short_{k}.fits" for k in range(5)]
    with file.open("w") as lines:
        for names in (["long.fits"], shorts):
            frames = [str(night.folder / name) for name in names]
            done = CliRunner().invoke(app, [*night.whole, "--plate", "header", *frames, "--json"])
            lines.write(done.stdout)
    (found,) = answers("calibrate-elements", str(file), "--config", str(night.folder / "c.toml"))
    (one,) = found["nights"]
    rows = {(each["norad_id"], each["track"].split()[0]): each for each in one["rows"]}
    for number, late_s in LATE_S.items():
        row = rows[number, "streak"]
        assert row["along_s"] == pytest.approx(-late_s, abs=0.15)
        assert row["along_km"] == pytest.approx(-late_s * 7.3, abs=12.0)
        assert 0.0 < row["sigma_along_s"] < 0.15
        assert row["age_days"] == pytest.approx(0.5, abs=0.01)
        assert row["regime"] == "LEO"
    assert abs(rows[SES_10, "mover"]["along_km"]) < 5.0
    assert {each["regime"] for each in found["regimes"]} >= {"LEO", "GEO"}


def test_points_of_short_frames_are_movers_with_their_names(night):
    paths = [str(night.folder / f"short_{k}.fits") for k in range(5)]
    *frames, last = answers(*night.whole, "--plate", "header", *paths)
    assert [each["frame"] for each in frames] == paths
    expect_documented("identify --field, movers", last)
    named = {each["matches"][0]["norad_id"]: each for each in last["movers"] if each["matches"]}
    assert SES_10 in named
    mover = named[SES_10]
    assert mover["verdict"] == "identified"
    assert mover["rate_arcsec_s"] == pytest.approx(15.04, abs=0.15)
    assert mover["position_angle_deg"] == pytest.approx(90.0, abs=2.0)
    assert len(mover["places"]) >= 4
    assert all("2023-06-22T02:01" in each["t_utc"] for each in mover["places"])
    (crossed,) = [each for each in frames[0]["crossed"] if each["norad_id"] == SES_10]
    assert crossed["mover"] == mover["mover"]
    assert crossed["unseen_because"] is None


def test_a_page_for_people_has_names_errors_and_what_was_not_seen(night):
    page = said(*night.whole, "--plate", "header", str(night.folder / "long.fits"), code=0)
    assert "LOW 902 (902)" in page
    assert "s behind its elements" in page
    assert "not in catalogue" in page


def test_what_cannot_be_used_is_said_in_a_line_and_the_others_go_on(night, tmp_path):
    broken = tmp_path / "broken.fits"
    broken.write_bytes(b"SIMPLE  =                    T")
    timeless = tmp_path / "timeless.fits"
    shutil.copy(night.folder / "short_0.fits", timeless)
    with fits.open(timeless, mode="update") as file:
        del file[0].header["DATE-OBS"]
    no_plate = tmp_path / "no_plate.fits"
    shutil.copy(night.folder / "short_0.fits", no_plate)
    with fits.open(no_plate, mode="update") as file:
        del file[0].header["CTYPE1"]
    paths = [broken, timeless, no_plate, night.folder / "short_1.fits"]
    found = answers(*night.whole, "--plate", "header", *map(str, paths), code=1)
    errors = [each["error"] for each in found if "error" in each]
    assert len(errors) == 3
    assert "no time of exposure: DATE-OBS is missing" in errors[1]
    assert "no plate" in errors[2]
    assert found[-1]["frame"] == str(paths[-1])
    assert found[-1]["streaks"] is not None


def test_without_a_site_or_a_catalogue_it_says_what_to_set(night, tmp_path):
    frame = str(night.folder / "short_0.fits")
    nowhere = tmp_path / "nowhere.toml"
    nowhere.write_text("")
    cat = str(night.folder / "cat.tle")
    words = ["identify", "--field", frame]
    assert "sets no site (site.latitude_deg, site.longitude_deg)" in failed(
        *words, "--tle", cat, "--config", str(nowhere)
    )
    here = str(night.folder / "c.toml")
    assert "no catalogue: name element sets with --tle" in failed(*words, "--config", here)
    gone = str(tmp_path / "gone.tle")
    assert "gone.tle does not exist" in failed(*words, "--tle", gone, "--config", here)
    assert "frames need --field" in said("identify", frame, frame, code=2)


@pytest.mark.skipif(not MOSAIC.exists(), reason="real frames are not there")
def test_of_a_file_with_several_images_another_may_be_asked_for(night):
    words = [*night.whole, "--plate", "header", str(MOSAIC)]
    assert "--extension takes another" in " ".join(answers(*words)[0]["notes"])
    second = answers(*words, "--extension", "SCI,2")[0]
    assert second["frame"] == f"{MOSAIC}[SCI,2]"
    assert "only frames have images" in said("identify", "x", "--extension", "2", code=2)


def failed(*arguments: str) -> str:
    done = CliRunner().invoke(app, [*arguments])
    assert done.exit_code == 1
    return str(done.exception)


def test_where_solving_fails_the_plate_of_the_header_is_taken_and_said(night, tmp_path):
    """A frame whose stars are gone can only be placed by its header."""
    starless = tmp_path / "starless.fits"
    shutil.copy(night.folder / "short_0.fits", starless)
    with fits.open(starless, mode="update") as file:
        rng = np.random.default_rng(1)
        file[0].data = rng.normal(1000.0, 10.0, file[0].data.shape).astype(np.uint16)
        file[0].header["RA"], file[0].header["DEC"] = 10.0, -4.0
    (found,) = answers(*night.whole, str(starless))
    assert found["plate"] == "header"
    assert any("the header's plate is taken" in each for each in found["notes"])
    (refused,) = answers(*night.whole, "--plate", "solve", str(starless), code=1)
    assert "no plate" in refused["error"]
    off_deg = separation_deg(
        found["ra"],
        found["dec"],
        night.truth.boresight_ra_icrs_deg + 0.3,
        night.truth.boresight_dec_icrs_deg,
    )
    assert off_deg < 0.01
