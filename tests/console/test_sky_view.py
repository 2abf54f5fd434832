"""The sky as a disc: north up, east left, the horizon at the rim."""

import dataclasses

import pytest

from rsoconsole.config import Config
from rsoconsole.console.words.sky_view import MOON, MOUNT, TARGET, sky_cell, sky_lines
from rsoconsole.sky import geo_slot_direction_deg, icrs_of_hour_angle, icrs_to_altaz
from tests.pipeline.test_outlook import NIGHT, SIDEREAL_DEG_S, sky_outlook, track

SIZE = (58, 18)


def rows_of(config: Config, seen, size=(58, 20)) -> list[str]:
    lines = sky_lines(config, seen, *size)
    assert len(lines) == size[1]
    assert all(sum(len(text) for text, _ in line) <= size[0] for line in lines)
    return ["".join(text for text, _ in line) for line in lines]


def seen_from(config: Config, slot_off_deg: float):
    where = config.site.to_site()
    slot = geo_slot_direction_deg(where, where.longitude_deg + slot_off_deg)
    ra, dec = icrs_of_hour_angle(where, *slot, NIGHT)
    return sky_outlook(config, NIGHT, (ra, dec), track(ra, dec, SIDEREAL_DEG_S, NIGHT))


@pytest.mark.parametrize(
    ("altaz", "is_at"),
    [
        ((0.0, 0.0), (28.5, 0.0)),
        ((0.0, 180.0), (28.5, 17.0)),
        ((0.0, 90.0), (28.5 - 17.0, 8.5)),
        ((0.0, 270.0), (28.5 + 17.0, 8.5)),
        ((90.0, 123.0), (28.5, 8.5)),
        ((45.0, 180.0), (28.5, 8.5 + 4.25)),
    ],
)
def test_directions_lie_where_one_sees_them_lying_on_the_back(altaz, is_at):
    assert sky_cell(altaz, *SIZE) == pytest.approx(is_at, abs=0.6)


def test_what_is_below_the_horizon_is_not_drawn():
    assert sky_cell((-0.1, 100.0), *SIZE) is None
    config = Config()
    seen = dataclasses.replace(seen_from(config, 0.0), moon_altitude_deg=-5.0)
    assert not any(MOON in row for row in rows_of(config, seen)[:-1])


@pytest.mark.parametrize(("slot_off_deg", "side"), [(40.0, "left"), (-40.0, "right")])
def test_a_slot_to_the_east_stands_left_and_south_on_the_belt(slot_off_deg, side):
    config = Config()
    rows = rows_of(config, seen_from(config, slot_off_deg))
    (at,) = [(row, text.index(TARGET)) for row, text in enumerate(rows[:-1]) if TARGET in text]
    assert (at[1] < 28) is (side == "left")
    assert at[0] > 10
    # What hangs over the ground does not move: its way is where it stands.
    assert not any("•" in row for row in rows[:-1])


def test_a_star_goes_west_along_its_way():
    config = Config()
    where = config.site.to_site()
    ra, dec = icrs_of_hour_angle(where, -45.0, 10.0, NIGHT)
    seen = sky_outlook(config, NIGHT, (ra, dec), track(ra, dec, 0.0, NIGHT))
    assert seen.way_altaz_deg[0] == pytest.approx(icrs_to_altaz(where, ra, dec, NIGHT), abs=1e-6)
    columns = [sky_cell(altaz, *SIZE)[0] for altaz in seen.way_altaz_deg]
    assert columns == sorted(columns)
    assert columns[-1] - columns[0] >= 3
    assert any("•" in row for row in rows_of(config, seen)[:-1])


def test_without_a_target_the_mount_is_shown_and_without_a_session_nothing_breaks():
    config = Config()
    where = config.site.to_site()
    ra, dec = icrs_of_hour_angle(where, 0.0, 20.0, NIGHT)
    rows = rows_of(config, sky_outlook(config, NIGHT, (ra, dec)))
    assert sum(row.count(MOUNT) for row in rows[:-1]) == 1
    assert len(sky_lines(None, None, 58, 20)) == 1
    assert len(sky_lines(config, sky_outlook(config, NIGHT), 58, 3)) == 1
