"""The columns of the public tables: declared once, and true of the records."""

import pytest

from rsoconsole.records import TABLES, PairMotion, Rejection, StreakLight, Table, UnseenMember
from rsoconsole.records.columns import HEAD, tables_markdown

ALL = list(TABLES.values())


@pytest.mark.parametrize("table", ALL, ids=TABLES)
def test_every_column_begins_at_a_member_of_its_record(table: Table) -> None:
    members = set(table.kind.__dataclass_fields__)
    if table.parts:
        assert table.parts in members
        members = {"#", "=", *_members_of_a_part(table)}
    for column in table.own:
        if column.source == "log":
            assert column.record_path.split(".")[0] in members, column


def _members_of_a_part(table: Table) -> set[str]:
    from rsoconsole.records import Detection

    of_parts = {
        "detections": Detection,
        "rejected": Rejection,
        "pairs": PairMotion,
        "unseen": UnseenMember,
        "streaks": StreakLight,
    }
    part = of_parts.get(table.parts)
    return set() if part is None else set(part.__dataclass_fields__)


@pytest.mark.parametrize("table", ALL, ids=TABLES)
def test_names_are_unique_and_each_column_says_what_it_means(table: Table) -> None:
    names = [column.name for column in table.columns]
    assert len(set(names)) == len(names)
    assert tuple(names[:3]) == tuple(column.name for column in HEAD)
    assert all(column.meaning for column in table.columns)


def test_a_unit_is_that_in_the_name() -> None:
    units = {column.name: column.unit for table in ALL for column in table.columns}
    assert units["scale_arcsec_px"] == "arcsec / pix"
    assert units["vx_gcrs_km_s"] == "km / s"
    assert units["cov_ee_arcsec2"] == "arcsec2"
    assert units["probability"] is None
    assert units["ms"] == "ms"


def test_the_documentation_has_a_line_a_table() -> None:
    lines = tables_markdown().splitlines()
    assert len(lines) == 2 + len(TABLES)
    assert all(f"| `{name}` |" in line for name, line in zip(TABLES, lines[2:], strict=True))
