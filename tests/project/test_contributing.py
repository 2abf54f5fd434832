"""What the page for contributors names is there."""

import re
from pathlib import Path

import rsoconsole

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PLACES = (ROOT, ROOT / "rsoconsole", ROOT / "tests")
PLACEHOLDERS = {"cli/telescope/NAME.py"}


def test_every_file_that_it_names_is_there() -> None:
    named = set(re.findall(r"`([\w./-]+\.(?:py|md|toml)|[\w./-]+/)`", PAGE))
    named |= set(re.findall(r"\]\(([\w./-]+)", PAGE))
    assert len(named) > 30
    missing = {n for n in named - PLACEHOLDERS if not any((p / n).exists() for p in PLACES)}
    assert missing == set()


def test_the_version_is_written_once_and_types_go_with_the_package() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert rsoconsole.__version__ not in project
    assert (ROOT / "rsoconsole" / "py.typed").exists()
