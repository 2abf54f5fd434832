"""The lock: every package pinned and hashed, none missing; and which files its renewal takes."""

import importlib.metadata
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests.hash_requirements import (
    FILES,
    MACHINES,
    PIN,
    PYTHONS,
    ROOT,
    canonical,
    chosen,
    entries,
    targets_of,
)

PROJECT = ROOT / "pyproject.toml"
pytestmark = pytest.mark.skipif(
    not (ROOT / FILES[0]).exists(), reason="no checkout: the lock is not here"
)
NEVER_IMPORTED = frozenset({"bottle", "dbus-python"})
"""What pyindi-client declares and this program leaves out."""


def pinned(name: str) -> dict[str, str]:
    """Version by canonical name."""
    found = {}
    for entry in entries((ROOT / name).read_text(encoding="utf-8")):
        pin = PIN.match(entry)
        assert pin is not None, entry
        assert canonical(pin["name"]) not in found, entry
        found[canonical(pin["name"])] = pin["version"]
    return found


def declared(extra: str = "") -> list[Requirement]:
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    own = project["optional-dependencies"][extra] if extra else project["dependencies"]
    wanted = [Requirement(each) for each in own]
    nested = [x for each in wanted if each.name == "rsoconsole" for x in sorted(each.extras)]
    plain = [each for each in wanted if each.name != "rsoconsole"]
    return [*plain, *(each for extra in nested for each in declared(extra))]


def declared_by(name: str) -> list[str]:
    """What an installed package needs; nothing is known of what is left out of an installation."""
    try:
        return importlib.metadata.requires(name) or []
    except importlib.metadata.PackageNotFoundError:
        if name in NEVER_IMPORTED:
            return []
        raise


def everything_below(
    wanted: list[Requirement], left_out: frozenset[str] = NEVER_IMPORTED
) -> set[str]:
    """Names of what is needed, and of what that needs, as the installed packages declare it."""
    found: set[str] = set()
    waiting = [(each, extra) for each in wanted for extra in ("", *each.extras)]
    seen: set[tuple[str, str]] = set()
    while waiting:
        each, extra = waiting.pop()
        name = canonical(each.name)
        if name in left_out or (name, extra) in seen:
            continue
        seen.add((name, extra))
        found.add(name)
        for line in declared_by(name):
            needed = Requirement(line)
            if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                waiting += [(needed, inner) for inner in ("", *needed.extras)]
    return found


@pytest.mark.parametrize("name", FILES)
def test_every_package_is_pinned_and_hashed(name):
    for entry in entries((ROOT / name).read_text(encoding="utf-8")):
        pin, *hashes = entry.split()
        assert PIN.fullmatch(pin), entry
        assert hashes, entry
        for each in hashes:
            kind, _, digest = each.partition("sha256:")
            assert kind == "--hash="
            assert len(digest) == 64
            assert set(digest) <= set("0123456789abcdef")


@pytest.mark.parametrize(("names", "extra"), [(FILES[:1], ""), (FILES, "test")])
def test_what_the_project_declares_is_locked_within_its_range(names, extra):
    locked = {name: version for file in names for name, version in pinned(file).items()}
    for each in declared(extra):
        if each.marker is None or each.marker.evaluate():
            assert Version(locked[canonical(each.name)]) in each.specifier, str(each)


def test_the_lock_holds_all_that_is_needed_and_nothing_else():
    product, beside = pinned(FILES[0]), pinned(FILES[1])
    assert not product.keys() & beside.keys()
    # The README's command installs libindi's client, too; a plain installation does without.
    needed = everything_below([*declared(), *declared("pyindi")])
    assert product.keys() == needed
    assert beside.keys() >= everything_below(declared("test")) - needed


def test_a_plain_installation_needs_no_header_of_the_system():
    """`pip install .`, with or without an extra: nothing that it pulls declares dbus-python."""
    wanted = [each for extra in ("", "notebook", "dask", "test") for each in declared(extra)]
    needed = everything_below(wanted, left_out=frozenset())
    assert {"indipyclient", "indipydriver"} <= needed
    assert not needed & (NEVER_IMPORTED | {"pyindi-client"})


def test_it_would_show_if_one_did():
    needed = everything_below(declared("pyindi"), left_out=frozenset())
    assert needed >= {"pyindi-client", "dbus-python"}


def test_those_that_need_headers_of_the_system_are_left_out():
    assert not NEVER_IMPORTED & (pinned(FILES[0]).keys() | pinned(FILES[1]).keys())


@pytest.mark.parametrize(
    ("wheel", "pythons", "machines"),
    [
        ("rich-15.0.0-py3-none-any.whl", PYTHONS, MACHINES),
        ("six-1.17.0-py2.py3-none-any.whl", PYTHONS, MACHINES),
        (
            "numpy-2.4.6-cp312-cp312-manylinux_2_27_x86_64.manylinux_2_28_x86_64.whl",
            (12,),
            ("x86_64",),
        ),
        ("pillow-13.0.0-cp311-cp311-musllinux_1_2_aarch64.whl", (), ()),
        ("numpy-2.4.6-cp314-cp314-manylinux_2_27_aarch64.whl", (), ()),
        ("numpy-2.4.6-cp313-cp313t-manylinux_2_27_aarch64.whl", (), ()),
        ("opencv-5.0.0.93-cp37-abi3-manylinux_2_28_aarch64.whl", PYTHONS, ("aarch64",)),
        ("psutil-7.2.2-cp312-abi3-manylinux2014_x86_64.whl", (12, 13), ("x86_64",)),
        ("protobuf-7.36.2-cp310-abi3-win_amd64.whl", (), ()),
        ("astrometry-4.3.0.tar.gz", (), ()),
    ],
)
def test_which_wheels_a_system_of_the_readme_installs(wheel, pythons, machines):
    assert targets_of(wheel) == {(python, machine) for python in pythons for machine in machines}


def listed(*names: str) -> list[dict[str, object]]:
    return [{"filename": name, "hashes": {"sha256": f"{n:064x}"}} for n, name in enumerate(names)]


def test_the_source_is_taken_where_a_system_finds_no_wheel():
    files = listed(
        "astrometry-4.3.0-cp311-cp311-manylinux2014_x86_64.whl",
        "astrometry-4.2.0.tar.gz",
        "astrometry-4.3.0.tar.gz",
        "astrometry-4.3.0-cp311-cp311-macosx_11_0_arm64.whl",
    )
    assert chosen(files, "4.3.0") == [f"{0:064x}", f"{2:064x}"]
    with pytest.raises(LookupError):
        chosen(files, "4.4.0")


def test_no_source_is_taken_where_every_system_finds_a_wheel():
    files = listed("rich-15.0.0.tar.gz", "rich-15.0.0-py3-none-any.whl")
    assert chosen(files, "15.0") == [f"{1:064x}"]
