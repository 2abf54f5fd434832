"""Each folder names its public things at its front door, and nothing reaches past it."""

import importlib
import re
from pathlib import Path

import grimp
import pytest

from tests.conftest import forget_handed_on
from tests.pages.private_files import PrivateFiles
from tests.pages.source_graph import ROOT, Import, door, imports, modules, package_of

LONGEST_FILE, MAX_FILES = 450, 20


def rooms() -> dict[str, Path]:
    """Every folder with a front door."""
    known = modules()
    return {name: path for name, path in known.items() if path.with_suffix(".pyi").exists()}


def reaches_past(each: Import, known: dict[str, Path]) -> bool:
    """Whether an import takes from another room a name that its front door does not hand on.

    A file may be taken as a whole (``from rsoconsole.tracking.filters import lqe``).
    """
    if each.module not in known or f"{each.module}.{each.name}" in known:
        return False
    room = room_between(each.importer, each.module, known)
    return room is not None and (each.module != room or each.name not in door(known[room]))


def room_between(importer: str, module: str, known: dict[str, Path]) -> str | None:
    """The outermost room with a front door that holds the file and not who imports it."""
    parts = module.split(".")
    for depth in range(2, len(parts) + 1):
        room = ".".join(parts[:depth])
        if known[room].with_suffix(".pyi").exists() and not f"{importer}.".startswith(f"{room}."):
            return room
    return None


def test_nothing_reaches_past_a_front_door() -> None:
    known = modules()
    past = [
        f"{each.importer}: {each.module}.{each.name}"
        for module, path in known.items()
        for each in imports(module, path)
        if reaches_past(each, known)
    ]
    assert past == []


@pytest.mark.parametrize(
    ("module", "name", "past"),
    [
        ("rsoconsole.sky", "wrap_180", False),
        ("rsoconsole.sky.angles", "wrap_180", True),
        ("rsoconsole.sky", "angles", False),
        ("rsoconsole.records", "Frame", False),
    ],
)
def test_one_that_does_would_be_seen(module: str, name: str, past: bool) -> None:
    assert reaches_past(Import("rsoconsole.cli.app", module, name), modules()) is past


@pytest.mark.parametrize(
    ("text", "past"),
    [
        ("from ..sky import wrap_180", []),
        ("from ..sky.angles import wrap_180", ["rsoconsole.sky.angles"]),
        ("def f():\n    from ..sky import angles", []),
        ("from .output import say\nfrom . import usage", []),
        ("import rsoconsole.sky.angles", ["rsoconsole.sky.angles"]),
    ],
)
@pytest.mark.parametrize("file", ["orbit_words.py", "__init__.py"])
def test_one_that_is_written_with_dots_would_be_seen(
    text: str, past: list[str], file: str, tmp_path: Path
) -> None:
    # In rsoconsole/cli/words, which is two folders below: one dot more for another room.
    (tmp_path / file).write_text(text.replace("from ..sky", "from ...sky"), encoding="utf-8")
    known = modules()
    home = "rsoconsole.cli.words"
    module = home if file == "__init__.py" else f"{home}.orbit_words"
    found = [each.module for each in imports(module, tmp_path / file) if reaches_past(each, known)]
    assert found == past


def test_a_stand_in_in_a_file_is_what_the_front_door_hands_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And the file's own thing is handed on again when the stand-in has gone."""
    sky = importlib.import_module("rsoconsole.sky")
    own = sky.wrap_180
    stand_in = object()
    with monkeypatch.context() as patch:
        patch.setattr("rsoconsole.sky.angles.wrap_180", stand_in)
        assert sky.wrap_180 is own
        forget_handed_on()
        assert sky.wrap_180 is stand_in
    assert sky.wrap_180 is stand_in
    forget_handed_on()
    assert sky.wrap_180 is own


def test_a_front_door_hands_on_what_there_is() -> None:
    for room, path in sorted(rooms().items()):
        module = importlib.import_module(room)
        assert [name for name in door(path) if not hasattr(module, name)] == [], room


def test_a_front_door_hands_on_what_somebody_asks_for() -> None:
    known = modules()
    asked: set[tuple[str, str]] = set()
    for module, path in known.items():
        asked |= {(each.module, each.name) for each in imports(module, path)}
    for path in (ROOT / "tests").rglob("*.py"):
        asked |= {(each.module, each.name) for each in imports("tests", path)}
    # The package's own door is for those who import it; tests/library asks for each name.
    public = door(known["rsoconsole"])
    asked |= {(f"rsoconsole.{room}", name) for name, room in public.items()}
    idle = [
        f"{room}.{name}"
        for room, path in rooms().items()
        if room != "rsoconsole"
        for name in door(path)
        if (room, name) not in asked
    ]
    assert idle == []


def test_files_and_folders_are_small_or_the_architecture_page_says_why() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    known = modules()
    homes = [package_of(module, known) for module in known]
    text = {path: path.read_text(encoding="utf-8") for path in known.values()}
    long = [path for path, each in text.items() if len(each.splitlines()) > LONGEST_FILE]
    large = [
        *(path.relative_to(ROOT).as_posix().removeprefix("rsoconsole/") for path in long),
        *(
            name.removeprefix("rsoconsole.").replace(".", "/")
            for name in set(homes)
            if homes.count(name) - 1 > MAX_FILES
        ),
    ]
    assert large
    assert [name for name in large if not is_excused(name, page)] == []


def is_excused(path: str, page: str) -> bool:
    """Whether the page's list of what is larger gives the path, and a reason behind it."""
    listed = page.partition("## Larger than a page")[2]
    return re.search(rf"`{re.escape(path)}` \([^()]{{10,}}\)", listed) is not None


@pytest.mark.parametrize(
    ("listed", "is_reason"),
    [
        ("`engine/loop/loop.py` (who is in charge changes here)", True),
        ("`loop.py` (who is in charge changes here)", False),
        ("`engine/loop/loop.py` is long", False),
        ("", False),
    ],
)
def test_a_name_without_a_path_and_a_reason_is_no_excuse(listed: str, is_reason: bool) -> None:
    page = f"`engine/loop/loop.py` (elsewhere on the page)\n## Larger than a page\n{listed}\n"
    assert is_excused("engine/loop/loop.py", page) is is_reason


def test_a_private_file_is_asked_for_by_its_own_folder_alone() -> None:
    graph = grimp.ImportGraph()
    graph.add_import(importer="rsoconsole.sky.sun", imported="rsoconsole.sky._series")
    contract = PrivateFiles("", {}, {})
    assert contract.check(graph, False).kept
    graph.add_import(importer="rsoconsole.orbits.fit", imported="rsoconsole.sky._series")
    assert contract.check(graph, False).metadata == {
        "past": ["rsoconsole.orbits.fit imports rsoconsole.sky._series"]
    }


def test_no_name_of_a_front_door_hides_a_file_or_folder_of_its_room() -> None:
    known = modules()
    named = [f"{room}.{name}" for room, path in rooms().items() for name in door(path)]
    assert [name for name in named if name in known] == []
