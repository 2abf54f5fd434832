"""Standard magnitudes of a night's tracks, where distance and phase are skyfield's."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.orbits import ASSUMED, ElementSet
from rsoconsole.orbits.elements.catalogue import entry_of_lines
from rsoconsole.pipeline import keep_unknown_tracks, rows_of_session
from rsoconsole.records import Identified, Measurement, Photometry, StreakLight
from rsoconsole.session import (
    ElementLedger,
    SessionWriter,
    element_ledger_path,
    read_element_ledger,
    read_ledger,
    replace_session_rows,
)
from tests.cli.test_cli_orbit import write_track
from tests.truth.lit_sphere import lambert_mag, sphere_by_skyfield
from tests.truth.seen_satellites import DAYTONA, geostationary, instants

SITE = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
STANDARD_MAG, SIGMA_MAG, COLOUR_MAG = 5.3, 0.03, 0.04
SLOT = geostationary(90001, -60.0)
FRAMES = 20
Change = Callable[[int, StreakLight], StreakLight | None]


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    (tmp_path / "none.toml").write_text("")


def light_of(measured: Measurement, mag: float) -> StreakLight:
    return StreakLight(
        measurement_id=measured.measurement_id,
        flux_adu=9000.0,
        flux_sigma_adu=90.0,
        rate_adu_s=900.0,
        rate_sigma_adu_s=9.0,
        band="V",
        mag=mag,
        mag_sigma=SIGMA_MAG,
        mag_sigma_colour=COLOUR_MAG,
    )


def night(
    folder: Path, elements: ElementSet = SLOT, *, change: Change = lambda _, light: light
) -> Path:
    """A closed session with one track of a diffuse sphere that no catalogue explains.

    ``change``: of the light of each frame, by its number from 0; None: no light is on record.
    """
    writer = SessionWriter.create(folder, Config.model_validate({"site": SITE}), {"title": "night"})
    t = instants(0.0, FRAMES)
    measured = write_track(writer, 1, elements, t)
    seen = sphere_by_skyfield(entry_of_lines(elements).record, DAYTONA, t)
    for n, each in enumerate(measured):
        mag = lambert_mag(STANDARD_MAG, seen.range_km[n], seen.phase_deg[n])
        light = change(n, light_of(each, mag))
        streaks = () if light is None else (light,)
        writer.append(Photometry(frame_id=each.frame_id, streaks=streaks), each.t_mid_utc_ns)
    unknown = Identified(
        frame_id=FRAMES,
        track_id=1,
        verdict="unknown",
        reason="",
        hint="",
        observations=FRAMES,
        catalogued=1,
        matches=(),
    )
    writer.append(unknown, int(t[-1]))
    writer.close()
    assert writer.faults == ()
    return folder


def row_of(folder: Path) -> tuple[float | None, float | None]:
    (row,) = rows_of_session(folder, [entry_of_lines(SLOT)], ASSUMED).rows
    return row.standard_mag, row.standard_mag_sigma


def test_a_catalogued_objects_track_has_the_magnitude_of_its_sphere(tmp_path: Path) -> None:
    mag, sigma = row_of(night(tmp_path / "night"))
    # Skyfield's distance is without light time; a hundredth would be 170 km.
    assert mag == pytest.approx(STANDARD_MAG, abs=0.003)
    # All magnitudes agree: the sigma is that of one of them, its colour with it.
    assert sigma == pytest.approx(0.05)


def test_scatter_is_in_the_sigma_and_a_glint_changes_neither(tmp_path: Path) -> None:
    noise = np.random.default_rng(5).normal(0.0, 0.3, FRAMES)

    def flickers(n: int, light: StreakLight) -> StreakLight:
        assert light.mag is not None
        return replace(light, mag=2.0 if n == 7 else light.mag + float(noise[n]))

    mag, sigma = row_of(night(tmp_path / "night", change=flickers))
    assert mag == pytest.approx(STANDARD_MAG, abs=3.0 * 1.25 * 0.3 / FRAMES**0.5)
    # By 20 magnitudes the scatter is known to a quarter.
    assert sigma == pytest.approx(0.3, rel=0.5)


def test_instrumental_and_saturated_light_gives_none_and_so_does_a_single_magnitude(
    tmp_path: Path,
) -> None:
    def unusable(n: int, light: StreakLight) -> StreakLight | None:
        if n == 0:
            return light
        if n == 1:
            return replace(light, band="instrumental", mag=-7.0, mag_sigma_colour=None)
        return replace(light, is_saturated=True, mag=3.0) if n == 2 else None

    def one_more(n: int, light: StreakLight) -> StreakLight | None:
        return light if n == 3 else unusable(n, light)

    assert row_of(night(tmp_path / "one", change=unusable)) == (None, None)
    mag, _ = row_of(night(tmp_path / "two", change=one_more))
    assert mag == pytest.approx(STANDARD_MAG, abs=0.003)
    assert row_of(night(tmp_path / "dark", change=lambda *_: None)) == (None, None)


def test_an_uncatalogued_objects_track_has_it_by_its_own_orbit(tmp_path: Path) -> None:
    kept = keep_unknown_tracks(night(tmp_path / "night"))
    assert [each.number for each in kept.tracks] == [1]
    known = read_ledger().object_by_number(1)
    assert known.last.orbit is not None
    assert known.standard_mag is not None
    assert known.standard_mag_sigma is not None
    # The distance is as sure as the orbit, and so is the magnitude.
    assert abs(known.standard_mag - STANDARD_MAG) < 3.0 * known.standard_mag_sigma
    assert known.standard_mag == pytest.approx(STANDARD_MAG, abs=0.05)
    assert 0.05 <= known.standard_mag_sigma < 0.1
    for words in (["ledger", "list"], ["ledger", "show", "1"]):
        said = CliRunner().invoke(app, words).stdout
        assert f"{known.standard_mag:.1f}" in said
        assert all(len(line) <= 80 for line in said.splitlines())


def test_a_track_without_light_is_kept_without_a_magnitude(tmp_path: Path) -> None:
    keep_unknown_tracks(night(tmp_path / "night", change=lambda *_: None))
    known = read_ledger().object_by_number(1)
    assert (known.standard_mag, known.standard_mag_sigma) == (None, None)
    assert "magnitude" not in CliRunner().invoke(app, ["ledger", "show", "1"]).stdout


def test_an_objects_magnitude_is_the_median_of_its_nights(tmp_path: Path) -> None:
    (row,) = rows_of_session(night(tmp_path / "night"), [entry_of_lines(SLOT)], ASSUMED).rows
    rows = [
        replace(row, session="monday", standard_mag=5.0, standard_mag_sigma=0.1),
        replace(row, session="tuesday", standard_mag=5.6, standard_mag_sigma=0.1),
        replace(row, session="friday", standard_mag=5.2, standard_mag_sigma=0.1),
        replace(row, session="sunday", standard_mag=None, standard_mag_sigma=None),
        replace(row, session="dark", norad_id=7, standard_mag=None, standard_mag_sigma=None),
    ]
    path = element_ledger_path()
    replace_session_rows([], rows, path)
    found = read_element_ledger(path)
    assert set(found.rows) == set(rows)
    (standard,) = found.standard_magnitudes().values()
    assert standard.mag == 5.2
    assert standard.sigma_mag == pytest.approx(1.4826 * 0.2)
    assert ElementLedger().standard_magnitudes() == {}
