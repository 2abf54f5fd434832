"""What the page for contributors names is there."""

import re
import subprocess
from pathlib import Path

import pytest

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


PAGES = (
    *(ROOT / name for name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "sessions").glob("*.md")),
    *sorted((ROOT / "rsoconsole").rglob("*.md")),
    *sorted((ROOT / "models").glob("*.md")),
    *sorted((ROOT / "tests").rglob("*.md")),
)


def test_what_a_page_links_to_and_shows_is_there() -> None:
    """In the repository, not only in somebody's folder."""
    kept = {path for path in tracked() if path}
    kept |= {str(parent) for path in kept for parent in Path(path).parents}
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s#]+)", page.read_text(encoding="utf-8")):
            if "://" not in link and not link.startswith("mailto:"):
                place = (page.parent / link).resolve().relative_to(ROOT)
                assert str(place) in kept, f"{page}: {link}"


@pytest.mark.parametrize("name", ["ARCHITECTURE.md", "rsoconsole/DECISIONS.md"])
def test_every_file_that_the_architecture_names_is_there(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./-]+\.(?:py|pyi|md|toml)|[\w./-]+/)`", text))
    assert len(named) > 10
    apart = {"loop.py", "__init__.pyi", "branches/"}
    assert {n for n in named - apart if not any((p / n).exists() for p in PLACES)} == set()


def tracked() -> list[str]:
    """The repository's files; all there are where this is no checkout."""
    try:
        run = subprocess.run(
            ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
        )
        return run.stdout.splitlines()
    except (OSError, subprocess.CalledProcessError):
        return [str(path.relative_to(ROOT)) for path in ROOT.rglob("*") if path.is_file()]


def test_the_version_is_written_once_and_types_go_with_the_package() -> None:
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert rsoconsole.__version__ not in project
    assert (ROOT / "rsoconsole" / "py.typed").exists()
