"""Settings written into a configuration file that somebody wrote by hand."""

import tomllib
from datetime import date
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import ConfigError
from rsoconsole.config import load_config, write_settings
from rsoconsole.config.file import initial_config_text, toml_text_with_settings

BY_HAND = """\
# Our dome at the lake. Do not touch the gate: [catalogue] is tuned!

[site]
name = "Lake # 2"   # the second one
latitude_deg = 47.5

[catalogue]   # names
tle_files = [
    "a.tle",  # low ones ]
    "b.tle",
]

gate_deg = 0.3   # degrees, see the log of 3 May

# Detection, by Ana:
[detector]
tau = 0.4
"""


def test_a_setting_that_is_there_gets_another_value_and_keeps_its_comment() -> None:
    after = toml_text_with_settings(BY_HAND, {"catalogue.gate_deg": 0.5})
    assert after == BY_HAND.replace("gate_deg = 0.3 ", "gate_deg = 0.5 ")
    # its value over several lines
    after = toml_text_with_settings(BY_HAND, {"catalogue.tle_files": ["c.tle"]})
    assert 'tle_files = ["c.tle"]\n\ngate_deg = 0.3   # degrees' in after


def test_a_new_setting_stands_in_its_section_before_the_next_ones_comment() -> None:
    after = toml_text_with_settings(BY_HAND, {"site.elevation_m": 410.0})
    assert after == BY_HAND.replace(
        "latitude_deg = 47.5\n", "latitude_deg = 47.5\nelevation_m = 410.0\n"
    )
    after = toml_text_with_settings(BY_HAND, {"optics.width_px": 3000})
    assert after == BY_HAND + "\n[optics]\nwidth_px = 3000\n"


def test_in_a_file_that_config_init_wrote_it_stands_below_its_own_comment() -> None:
    after = toml_text_with_settings(initial_config_text(), {"catalogue.gate_deg": 0.5})
    assert "# gate_deg = 0.2\ngate_deg = 0.5\n" in after
    assert toml_text_with_settings(after, {"catalogue.gate_deg": None}) == initial_config_text()


def test_tables_become_blocks_and_take_the_place_of_older_ones() -> None:
    first = [{"n": 1, "day": date(2026, 11, 25), "name": 'a "b"'}, {"n": 2, "none": None}]
    once = toml_text_with_settings(BY_HAND, {"exposure.calibrated": first})
    assert once.startswith(BY_HAND)
    assert tomllib.loads(once)["exposure"]["calibrated"] == [
        {"n": 1, "day": date(2026, 11, 25), "name": 'a "b"'},
        {"n": 2},
    ]
    marked = once.replace("n = 2\n", "n = 2\n# kept for the record\n")
    twice = toml_text_with_settings(marked, {"exposure.calibrated": [{"n": 3}]})
    assert tomllib.loads(twice)["exposure"] == {"calibrated": [{"n": 3}]}
    assert twice.startswith(BY_HAND)
    assert twice.count("[[exposure.calibrated]]") == 1
    assert "# kept for the record" in twice
    inline = BY_HAND + "\n[exposure]\ncalibrated = [{n = 1}]\n"
    after = toml_text_with_settings(inline, {"exposure.calibrated": [{"n": 3}]})
    assert tomllib.loads(after)["exposure"] == {"calibrated": [{"n": 3}]}
    assert toml_text_with_settings(once, {"exposure.calibrated": None}).startswith(BY_HAND)


def test_what_stands_above_the_next_section_stays_there_when_blocks_before_it_go() -> None:
    block, after = "[[exposure.calibrated]]\nn = 1\n", "\n# Ours:\n[site]\nlatitude_deg = 47.5\n"
    moved = toml_text_with_settings(block * 2 + after, {"exposure.calibrated": [{"n": 3}]})
    assert moved == after + "\n[exposure]\n\n" + block.replace("1", "3")


@pytest.mark.parametrize(
    "text",
    [
        "[catalogue.gate_deg]\na = 1\n",
        '[site]\nname = """\n[catalogue]\n"""\n[catalogue]\ngate_deg.a = 1\n',
        'catalogue."gate_deg" = {a = 1}\n[site]\n[catalogue.more]\nb = 1\n',
    ],
)
def test_a_form_that_can_be_edited_says_what_was_set_and_nothing_else(text: str) -> None:
    before = tomllib.loads(text)
    before["catalogue"]["gate_deg"] = 0.5
    assert tomllib.loads(toml_text_with_settings(text, {"catalogue.gate_deg": 0.5})) == before


@pytest.mark.parametrize(
    "text",
    [
        "catalogue = {gate_deg = 0.3}\n",
        "catalogue = 3\n",
        "[[a.k]]\n[b]\n[a.k.c]\n[[a.k]]\n[catalogue]\n",
        f"[catalogue]\nx = {'[' * 300}{']' * 300}\n",
        "[catalogue]\ngate_deg = 0.1\n[catalogue]\n",
    ],
)
def test_a_form_that_cannot_be_edited_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"by hand|is no section|declare"):
        toml_text_with_settings(text, {"catalogue.gate_deg": 0.5})


_WORDS = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=12)


@given(
    st.lists(st.sampled_from(BY_HAND.split("\n\n")), unique=True),
    st.one_of(_WORDS, st.floats(-9, 9), st.booleans(), st.lists(_WORDS, max_size=3)),
    st.sampled_from(["site.name", "catalogue.tle_files", "detector.tau", "new.one"]),
)
def test_nothing_else_of_a_file_changes(parts: list[str], value: object, name: str) -> None:
    text = "\n".join(parts)
    section, key = name.split(".")
    after = toml_text_with_settings(text, {name: value})
    wanted = tomllib.loads(text)
    wanted.setdefault(section, {})[key] = value
    assert tomllib.loads(after) == wanted
    comments = [line for line in text.split("\n") if line.startswith("#")]
    assert [line for line in after.split("\n") if line.startswith("#")] == comments


def test_the_file_is_replaced_whole_with_its_rights_its_link_and_its_line_ends(
    tmp_path: Path,
) -> None:
    real, link = tmp_path / "real.toml", tmp_path / "config.toml"
    real.write_bytes(BY_HAND.replace("\n", "\r\n").encode())
    real.chmod(0o640)
    link.symlink_to(real)
    write_settings(link, {"catalogue.gate_deg": 0.5, "site.elevation_m": 410})
    assert link.is_symlink()
    assert real.stat().st_mode & 0o777 == 0o640
    assert real.read_bytes().count(b"\n") == real.read_bytes().count(b"\r\n") > 10
    assert load_config(link).catalogue.gate_deg == 0.5
    assert not list(tmp_path.glob("*.part"))


def test_a_file_that_is_not_there_is_begun(tmp_path: Path) -> None:
    path = tmp_path / "new" / "config.toml"
    write_settings(path, {"catalogue.gate_deg": 0.5})
    assert load_config(path).catalogue.gate_deg == 0.5
    assert "# tau = " in path.read_text()


@pytest.mark.parametrize(
    ("text", "value", "words"),
    [
        (BY_HAND, 900.0, "is not sound, nothing is written: catalogue.gate_deg: must be at most 5"),
        ("[catalogue\n", 0.5, "cannot be written to as it is"),
        ("[catalogue]\ngate_rad = 1\n", 0.5, "is not sound"),
    ],
)
def test_a_file_is_left_as_it_was_where_the_result_would_not_be_sound(
    tmp_path: Path, text: str, value: float, words: str
) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        write_settings(path, {"catalogue.gate_deg": value})
    assert path.read_text() == text


def test_a_place_that_takes_no_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        write_settings(tmp_path / "file" / "config.toml", {"catalogue.gate_deg": 0.5})
