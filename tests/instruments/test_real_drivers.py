"""Real mount drivers, each in its own simulation: what is said of them is so."""

import shutil
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.real_sky.drivers import DRIVERS, FASTEST, Row, table, try_driver

pytestmark = pytest.mark.indi_bin


@pytest.fixture(scope="module")
def rows() -> dict[str, Row]:
    """Those of the fastest drivers that this machine has, side by side."""
    there = [each for each in DRIVERS if each.program in FASTEST and shutil.which(each.program)]
    if shutil.which("indiserver") is None or not there:
        pytest.skip("needs indiserver and drivers: apt install indi-bin indi-eqmod")
    with ThreadPoolExecutor(len(there)) as pool:
        return {row.driver.program: row for row in pool.map(try_driver, there)}


@pytest.mark.parametrize("program", FASTEST)
def test_a_driver_goes_stops_tracks_and_parks_as_it_is_said_to(rows: dict[str, Row], program: str):
    if program not in rows:
        pytest.skip(f"needs {program}: apt install indi-bin indi-eqmod")
    row = rows[program]
    assert row.fault == ""
    assert row.cells["goes"] == "yes"
    assert row.cells["STOP"].startswith("tracks in ")
    assert row.cells["tracks"] == "on and off"
    assert row.cells["parks"] == "and unparks"
    assert not [cell for cell in row.cells.values() if cell.startswith("WRONG")]


def test_the_table_has_a_line_for_each(rows: dict[str, Row]):
    lines = table(list(rows.values())).splitlines()
    assert len(lines) == 2 + len(rows)
    assert all(line.count("|") == lines[0].count("|") for line in lines)
