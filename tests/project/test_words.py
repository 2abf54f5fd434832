"""Words that the project does not use, in names and texts: plain ones stand for them."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("rsoconsole", "models", "sessions")
PAGES = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")
IN_TEXTS = re.compile(
    r"(?<![a-z])(whoever|anew|afresh|fore(?:tell|tells|told|telling)|reckon(?:s|ed|ing)?"
    r"|so\s+many|the\s+one\s+that|he|his)(?![a-z’'])",
    re.IGNORECASE,
)
IN_NAMES = re.compile(
    r"anew|afresh|beforehand|chronicles?|company|crews?|desks?|fore(?:tell|told)|grant(?:s|ed)?"
    r"|guards?|hands|happen(?:s|ed|ings?)?|hear(?:s|d|ing)?|intentions?|lookers?|mouths?|otherwise"
    r"|promise[sd]?|reckon(?:s|ed|ing)?|re(?:tell|told)|rulings?|tell(?:s|ing)?|told"
    r"|tried|verdicts?|whoever|wish(?:es|ed)?"
)
"""Words of names. A score of statistics, a pixel's charge and what a lock holds are the field's."""
ANYWHERE = re.compile(IN_NAMES.pattern, re.IGNORECASE)
"""What a source must hold to be worth parsing."""
KEPT = {
    "Ruling": "a kind of record in sessions",
    "foretold_by": "a field of records in sessions",
    "verdict": "a field of records in sessions, and a key of --json",
    "Verdict": "the type of that field",
    "_verdict": "makes that field",
    "action_verdicts": "Textual's name for the key command `verdicts`, which settings may name",
}
"""Names that stay, and why."""
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def files(*endings: str) -> list[Path]:
    found = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    return sorted(path for path in found if path.suffix in endings)


def texts() -> list[Path]:
    return [*(ROOT / page for page in PAGES), *files(".py", ".pyi", ".md", ".html", ".js")]


def avoided(text: str) -> list[str]:
    return IN_TEXTS.findall(text.replace("foretold_by", ""))


def names(source: str) -> set[str]:
    """What a module defines, assigns or imports by another name."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                found.add(node.name)
            case ast.arg():
                found.add(node.arg)
            case ast.Name(ctx=ast.Store()):
                found.add(node.id)
            case ast.Attribute(ctx=ast.Store()):
                found.add(node.attr)
            case ast.alias(asname=str(name)) | ast.ExceptHandler(name=str(name)):
                found.add(name)
    return found


def riddles(name: str) -> set[str]:
    """The avoided words of a name."""
    if name in KEPT:
        return set()
    words = (word.lower() for word in _WORDS.findall(name))
    return {word for word in words if IN_NAMES.fullmatch(word)}


def test_no_avoided_word_stands_anywhere() -> None:
    found: dict[str, list[str]] = {}
    for path in texts():
        text = path.read_text(encoding="utf-8")
        words = avoided(text)
        if path.suffix == ".py" and (riddles(path.stem) or ANYWHERE.search(text)):
            words += [name for name in {path.stem, *names(text)} if riddles(name)]
        if words:
            found[str(path.relative_to(ROOT))] = words
    assert found == {}


@pytest.mark.parametrize(
    "text",
    ["Whoever", "is_reckoned", "solves_anew = 1", "what was foretold", "of so\n    many", "of his"],
)
def test_one_would_be_seen(text: str) -> None:
    assert len(avoided(text)) == 1
    assert avoided("foretold_by: Predictor; the others; they, this; whose") == []


@pytest.mark.parametrize(
    "source",
    [
        "def hear(): ...",
        "class Desk: ...",
        "def act(told): ...",
        "self._hands = 1",
        "import session as chronicle",
        "for wish in (): ...",
        "IS_HAPPENING: bool = True",
    ],
)
def test_one_in_a_name_would_be_seen(source: str) -> None:
    (name,) = {each for each in names(source) if riddles(each)}
    assert name not in KEPT


def test_what_only_contains_one_is_a_name_like_any_other() -> None:
    assert not any(
        map(riddles, ("shear", "by_hand", "handset", "is_satellite", "desktop", "score"))
    )
