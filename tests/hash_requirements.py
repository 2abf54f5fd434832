"""Renews the hashes of the pinned packages; what is pinned is written by hand.

    python -m tests.hash_requirements

For each ``name==version`` of the two files the package index is asked, by its own JSON (PEP 691),
for the files of that release. Kept are the wheels that a system of the README can install, and the
source where one of these systems finds no wheel. ``--index-url``, else pip's own setting, names
the index. Nothing but pip is needed.
"""

import argparse
import json
import re
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILES = ("requirements.txt", "requirements-test.txt")
PYTHONS = (11, 12, 13)
"""Minor versions of Python 3 that the README's systems have."""
MACHINES = ("x86_64", "aarch64")
DEFAULT_INDEX = "https://pypi.org/simple"
ACCEPT = "application/vnd.pypi.simple.v1+json"
PATIENCE_S = 60.0
AT_A_TIME = 4
PIN = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>[^\s;\\#]+)")
_WHEEL = re.compile(
    r"^(?P<name>.+?)-(?P<version>[^-]+)(-\d[^-]*)?-(?P<tags>[^-]+-[^-]+-[^-]+)\.whl$"
)


@dataclass(frozen=True, slots=True)
class Pin:
    """One package of a file: ``name`` as it is written there."""

    name: str
    version: str


def canonical(name: str) -> str:
    """A package's name as indexes write it. Source: PEP 503."""
    return re.sub(r"[-_.]+", "-", name).lower()


def entries(text: str) -> list[str]:
    """The logical lines of a file, without comments: what ends in a backslash goes on."""
    lines = (line for line in text.splitlines() if not line.lstrip().startswith("#"))
    joined = "\n".join(lines).replace("\\\n", " ")
    return [" ".join(line.split()) for line in joined.splitlines() if line.strip()]


def targets_of(filename: str) -> set[tuple[int, str]]:
    """(minor version of Python, machine) of the README's systems that can install a wheel."""
    wheel = _WHEEL.match(filename)
    if wheel is None:
        return set()
    pythons, abis, platforms = (part.split(".") for part in wheel["tags"].split("-"))
    machines = {machine for name in platforms for machine in _machines(name)}
    return {
        (minor, machine)
        for minor in PYTHONS
        for machine in machines
        if any(_is_for(minor, python, abi) for python in pythons for abi in abis)
    }


def _machines(platform: str) -> Iterable[str]:
    if platform == "any":
        return MACHINES
    return [
        m for m in MACHINES if platform.startswith(("manylinux", "linux")) and platform.endswith(m)
    ]


def _is_for(minor: int, python: str, abi: str) -> bool:
    if python in ("py3", f"py3{minor}"):
        return abi == "none"
    if not python.startswith("cp3") or not python[3:].isdigit():
        return False
    is_later = minor >= int(python[3:])
    return (abi == "abi3" and is_later) or (
        python == f"cp3{minor}" and abi in (f"cp3{minor}", "none")
    )


def chosen(files: Iterable[dict[str, object]], version: str) -> list[str]:
    """SHA-256 of the files of a release that the README's systems install, in order.

    ``files``: as the index lists them. Raises LookupError where no system could install it.
    """
    from pip._vendor.packaging.version import InvalidVersion, Version

    wanted = Version(version)
    hashes: set[str] = set()
    covered: set[tuple[int, str]] = set()
    source: set[str] = set()
    for each in files:
        name, sha256 = str(each["filename"]), dict(each["hashes"]).get("sha256")  # type: ignore[call-overload]
        wheel = _WHEEL.match(name)
        told = wheel["version"] if wheel else name.removesuffix(".tar.gz").rpartition("-")[2]
        try:
            is_it = Version(told) == wanted and sha256 is not None
        except InvalidVersion:
            continue
        if not is_it:
            continue
        if wheel is None:
            source |= {str(sha256)} if name.endswith(".tar.gz") else set()
        elif targets := targets_of(name):
            covered |= targets
            hashes.add(str(sha256))
    if covered < {(minor, machine) for minor in PYTHONS for machine in MACHINES}:
        hashes |= source
    if not hashes:
        raise LookupError(f"no file of version {version} can be installed")
    return sorted(hashes)


def index_of_pip() -> str:
    """Where this pip looks for packages."""
    asked = [sys.executable, "-m", "pip", "config", "get", "global.index-url"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
    return found or DEFAULT_INDEX


def hashes_of(pin: Pin, index: str) -> list[str]:
    """What the index says of one release. Raises OSError, ValueError, LookupError."""
    url = f"{index.rstrip('/')}/{urllib.parse.quote(canonical(pin.name))}/"
    request = urllib.request.Request(url, headers={"Accept": ACCEPT})
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return chosen(json.load(answer)["files"], pin.version)


def renewed(text: str, index: str) -> str:
    """The file with the hashes of today; comments stay. Raises SystemExit, with what is wrong."""
    comments = [line for line in text.splitlines() if line.lstrip().startswith("#")]
    pins = []
    for entry in entries(text):
        found = PIN.match(entry)
        if found is None:
            raise SystemExit(f"{entry!r} is not pinned: write name==version")
        pins.append(Pin(found["name"], found["version"]))

    def lines_of(pin: Pin) -> str:
        try:
            hashes = hashes_of(pin, index)
        except (OSError, ValueError, LookupError) as error:
            raise SystemExit(f"{pin.name}=={pin.version}: {error}") from error
        return " \\\n".join(
            [f"{pin.name}=={pin.version}", *(f"    --hash=sha256:{each}" for each in hashes)]
        )

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        return "\n".join([*comments, *pool.map(lines_of, pins)]) + "\n"


def main() -> None:
    """Write both files again."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--index-url", default=None, help="of the index's simple API")
    asked = parser.parse_args()
    index = asked.index_url or index_of_pip()
    for name in FILES:
        path = ROOT / name
        before = path.read_text(encoding="utf-8")
        after = renewed(before, index)
        path.write_text(after, encoding="utf-8")
        print(
            f"{name}: {after.count('--hash=')} hashes, {'new' if after != before else 'as before'}"
        )


if __name__ == "__main__":
    main()
