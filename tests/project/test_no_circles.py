"""No two files need each other, not even for a type or within a function; nor do two folders."""

from pathlib import Path

import pytest

from tests.pages.source_graph import circle_in, modules, needs, package_of


def test_files_need_each_other_in_no_circle() -> None:
    known = modules()
    assert len(known) > 500
    assert circle_in(needs(known)) == []


def test_folders_need_each_other_in_no_circle() -> None:
    known = modules()

    def home_of(module: str) -> str:
        """Of the files beside the rooms each stands for itself."""
        home = package_of(module, known)
        return module if home == "rsoconsole" else home

    between: dict[str, set[str]] = {}
    for module, needed in needs(known).items():
        home = home_of(module)
        between.setdefault(home, set()).update({home_of(each) for each in needed} - {home})
    assert circle_in(between) == []


@pytest.mark.parametrize(
    "closing",
    [
        "if TYPE_CHECKING:\n    from models.a import A",
        "def f():\n    import models.a",
        "from .a import A",
        "from . import a",
    ],
)
def test_one_would_be_seen(closing: str, tmp_path: Path) -> None:
    texts = {"models.a": "from models.b import B", "models.b": closing}
    known = {}
    for name, text in texts.items():
        known[name] = tmp_path / f"{name}.py"
        known[name].write_text(text, encoding="utf-8")
    assert set(circle_in(needs(known))) == {"models.a", "models.b"}


def test_one_through_a_front_door_would_be_seen(tmp_path: Path) -> None:
    """models.room hands on what its file a has; a needs b, and b asks at the door."""
    (tmp_path / "__init__.py").write_text("", encoding="utf-8")
    (tmp_path / "__init__.pyi").write_text("from .a import A as A\n", encoding="utf-8")
    (tmp_path / "a.py").write_text("from models.b import B\n", encoding="utf-8")
    (tmp_path / "b.py").write_text("from models.room import A\n", encoding="utf-8")
    known = {
        "models.room": tmp_path / "__init__.py",
        "models.room.a": tmp_path / "a.py",
        "models.b": tmp_path / "b.py",
    }
    assert set(circle_in(needs(known))) == {"models.room.a", "models.b"}
