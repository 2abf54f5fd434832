"""Words that the project does not use, in names and texts: plain ones stand for them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("rsoconsole", "models", "sessions")
PAGES = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")
AVOIDED = re.compile(
    r"(?<![a-z])(whoever|anew|afresh|fore(?:tell|tells|told|telling)|reckon(?:s|ed|ing)?)(?![a-z])",
    re.IGNORECASE,
)
ON_RECORD = "foretold_by"
"""A field of sessions: it keeps its name."""


def texts() -> list[Path]:
    found = [ROOT / page for page in PAGES]
    for folder in FOLDERS:
        for ending in ("py", "pyi", "md", "html", "js"):
            found += (ROOT / folder).rglob(f"*.{ending}")
    return sorted(found)


def avoided(text: str) -> list[str]:
    return AVOIDED.findall(text.replace(ON_RECORD, ""))


@pytest.mark.parametrize("path", texts(), ids=lambda path: str(path.relative_to(ROOT)))
def test_no_avoided_word_stands_in_it(path: Path) -> None:
    assert avoided(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("text", ["Whoever", "is_reckoned", "solves_anew = 1", "what was foretold"])
def test_one_would_be_seen(text: str) -> None:
    assert len(avoided(text)) == 1
    assert avoided(f"{ON_RECORD}: Predictor") == []
