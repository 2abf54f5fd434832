"""Wrong usage is one line on stderr with the remedy, in plain words, and exit 2."""

import itertools
import sys

import pytest

from rsoconsole.base import nearest_name, plain_fault
from rsoconsole.cli.app import main
from rsoconsole.cli.words.usage import unwrapped_paragraphs


def said(capsys, monkeypatch, *words: str) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["rsoconsole", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    shown = capsys.readouterr()
    return ended.value.code, shown.out, shown.err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["gotoo"], "rsoconsole: no such command 'gotoo': did you mean 'goto'?"),
        (["detect", "a.fits", "--taw", "3"], "rsoconsole detect: no such option: --taw: did you"),
        (["set", "tau", "0.2"], "rsoconsole set: invalid value: there is no setting 'tau': did "
         "you mean detector.tau?"),
        (["set", "site.latitude_deg", "5"], "does not change while the engine runs: write it"),
        (["set", "detector.tau"], "missing argument 'value': 'rsoconsole set --help' shows"),
        (["demo", "--speed", "abc"], "invalid value for '--speed': must be a number: "),
        (["demo", "--frames", "0"], "must be at least 1"),
        (["export", "x", "--format", "xls"], "'xls' is not one of 'csv'"),
    ],
)  # fmt: skip
def test_it_is_one_line_with_what_to_write(words, line, capsys, monkeypatch):
    code, out, err = said(capsys, monkeypatch, *words)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert line in err
    assert "Input should" not in err


def test_help_is_help_and_no_complaint(capsys, monkeypatch):
    code, out, err = said(capsys, monkeypatch)
    assert code == 2
    assert "Start with: rsoconsole" in out + err
    assert said(capsys, monkeypatch, "--version")[0] == 0


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("tau", "detector.tau"),
        ("detector.taw", "detector.tau"),
        ("exposure", "exposure.exposure_s"),
        ("quux", None),
    ],
)
def test_the_setting_that_was_meant(name, meant):
    from rsoconsole.engine import TUNABLE

    assert nearest_name(name, sorted(TUNABLE)) == meant


def test_a_value_out_of_bounds_is_said_in_the_settings_own_terms():
    from rsoconsole.config import Config
    from rsoconsole.engine.tasks.pace import config_with_setting

    with pytest.raises(ValueError, match=r"^detector\.tau = 2\.0: must be below 1$"):
        config_with_setting(Config(), "detector.tau", 2.0)
    assert plain_fault("Input should be greater than or equal to 3") == "must be at least 3"


def test_help_is_broken_where_the_terminal_ends_and_keeps_its_brackets(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = said(capsys, monkeypatch, "demo", "--help")
    words = out.partition("╭")[0]
    assert "drift_px = 12 under [stars]" in " ".join(words.split())
    _, out, _ = said(capsys, monkeypatch, "sessions", "--help")
    assert "Rescue sessions, which continue a session" in " ".join(out.split())
    lines = [line.strip() for line in out.partition("╭")[0].splitlines()]
    # A line that ends early is the last one of its paragraph, or has no room for the next word.
    for line, after in itertools.pairwise(lines[3:]):
        assert not (line and after) or len(f"{line} {after.split()[0]}") > 78


def test_lines_of_help_that_stand_for_themselves_stay():
    text = "What it\nis.\n\ntdm, iod: messages\nto others\nhtml: a report\nExample: it --out [x]"
    assert unwrapped_paragraphs(text) == (
        "What it is.\n\ntdm, iod: messages to others\nhtml: a report\nExample: it --out \\[x]"
    )
