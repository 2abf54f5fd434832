"""Every way of installing, each into an empty environment, then a demo and the notebooks.

    python -m tests.fresh_installs [readme|plain|notebook|wheel|sdist|uv|uv-sync|pipx ...]

Run in a checkout; what is installed is its last commit. No header of the system is to be found
(``PKG_CONFIG_LIBDIR``), as on a fresh Debian. Takes some minutes and gigabytes a way; uv and pipx
are got by pip. Prints seconds and megabytes; exit 1 where a way fails.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DEMO = ("demo", "--headless", "--frames", "6")
KEPT = ("PATH", "PIP_", "UV_", "HTTP", "http", "NO_PROXY", "no_proxy", "SSL_", "REQUESTS_CA")
NOTEBOOKS = "sessions/execute_notebooks.py"


@dataclass(frozen=True)
class Place:
    """Where one way of installing is tried."""

    python: str
    source: Path
    """A fresh clone."""
    folder: Path
    environ: Mapping[str, str]

    def run(self, *command: str | Path, cwd: Path | None = None) -> str:
        """A command that must succeed; what it printed."""
        done = subprocess.run(
            [str(word) for word in command],
            cwd=cwd or self.source,
            env=dict(self.environ),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{' '.join(map(str, command))}\n{done.stdout[-3000:]}")
        return done.stdout

    def new_python(self, name: str) -> Path:
        """The Python of an empty environment."""
        self.run(self.python, "-m", "venv", self.folder / name)
        return self.folder / name / "bin" / "python"

    def built(self, *what: str) -> Path:
        """The package as ``build`` makes it: wheel and sdist, each from the one before."""
        builder = self.new_python("builder")
        self.run(builder, "-m", "pip", "install", "-q", "build")
        self.run(builder, "-m", "build", *what, "-o", self.folder / "dist")
        return self.folder / "dist"


def by_pip(place: Place, what: str | Path) -> Path:
    """Installed by pip; its Python."""
    python = place.new_python("environment")
    place.run(python, "-m", "pip", "install", "-q", what)
    return python


def by_sdist(place: Place) -> Path:
    """From the source distribution."""
    (source,) = place.built("--sdist").glob("*.tar.gz")
    return by_pip(place, source)


def by_wheel(place: Place) -> Path:
    """From the wheel, which is made of the source distribution."""
    (wheel,) = place.built().glob("*.whl")
    return by_pip(place, wheel)


def by_uv(place: Place) -> Path:
    """As a tool of uv."""
    tools = place.new_python("tools")
    place.run(tools, "-m", "pip", "install", "-q", "uv")
    place.run(tools.parent / "uv", "tool", "install", "-q", "--python", place.python, ".")
    return Path(place.environ["UV_TOOL_DIR"]) / "rsoconsole" / "bin" / "python"


def by_pipx(place: Place) -> Path:
    """As an application of pipx."""
    tools = place.new_python("tools")
    place.run(tools, "-m", "pip", "install", "-q", "pipx")
    place.run(tools.parent / "pipx", "install", "-q", "--python", place.python, ".")
    return Path(place.environ["PIPX_HOME"]) / "venvs" / "rsoconsole" / "bin" / "python"


def by_readme(place: Place) -> Path:
    """By the README's first command, as it is printed, but for the demo at its end."""
    (first, _) = re.findall(r"```sh\n(.*?)```", (place.source / "README.md").read_text(), re.DOTALL)
    command, _, demo = first.strip().rpartition(" && ")
    if demo != ".venv/bin/rsoconsole demo":
        raise RuntimeError(f"the README's first command ends with {demo!r}")
    path = f"{Path(place.python).parent}:{place.environ['PATH']}"
    place.run("env", f"PATH={path}", "bash", "-euo", "pipefail", "-c", command)
    return place.source / ".venv" / "bin" / "python"


def by_uv_sync(place: Place) -> Path:
    """By ``uv sync`` in a checkout."""
    tools = place.new_python("tools")
    place.run(tools, "-m", "pip", "install", "-q", "uv")
    place.run(tools.parent / "uv", "sync", "-q", "--python", place.python)
    return place.source / ".venv" / "bin" / "python"


WAYS: dict[str, Callable[[Place], Path]] = {
    "readme": by_readme,
    "uv-sync": by_uv_sync,
    "plain": lambda place: by_pip(place, "."),
    "notebook": lambda place: by_pip(place, ".[notebook]"),
    "wheel": by_wheel,
    "sdist": by_sdist,
    "uv": by_uv,
    "pipx": by_pipx,
}


def try_way(name: str, python: str) -> str:
    """One way from nothing to a demo; what it took, in a line. Raises RuntimeError."""
    with tempfile.TemporaryDirectory(prefix="rsoconsole-fresh-") as scratch:
        folder = Path(scratch)
        environ = {
            # Where packages are got from, and nothing of this environment's Python.
            **{name: value for name, value in os.environ.items() if name.startswith(KEPT)},
            "HOME": str(folder / "home"),
            "LANG": "C.UTF-8",
            "PKG_CONFIG_LIBDIR": "/nonexistent",
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "UV_TOOL_DIR": str(folder / "uv"),
            "UV_TOOL_BIN_DIR": str(folder / "bin"),
            "PIPX_HOME": str(folder / "pipx"),
            "PIPX_BIN_DIR": str(folder / "bin"),
        }
        (folder / "home").mkdir()
        place = Place(python, folder / "source", folder, environ)
        place.run("git", "clone", "-q", ROOT, place.source, cwd=ROOT)
        begun_s = time.monotonic()
        installed = WAYS[name](place)
        took_s = time.monotonic() - begun_s
        where = "import sysconfig; print(sysconfig.get_paths()['purelib'])"
        packages = Path(place.run(installed, "-c", where, cwd=folder).strip())
        size = sum(each.lstat().st_size for each in packages.rglob("*") if each.is_file())
        line = f"{name:9} installed in {took_s:4.0f} s, {size / 1e6:5.0f} MB"
        begun_s = time.monotonic()
        program = installed.parent / "rsoconsole"
        place.run(program, *DEMO, cwd=folder)
        line += f", demo {time.monotonic() - begun_s:3.0f} s"
        checks = place.run("bash", "-c", f"{program} doctor --json || true", cwd=folder)
        line += "".join(
            f", {json.loads(each)['detail']}"
            for each in checks.splitlines()
            if "INDI client" in each
        )
        if name == "notebook":
            begun_s = time.monotonic()
            place.run(installed, NOTEBOOKS, "--out", folder)
            line += f", notebooks {time.monotonic() - begun_s:3.0f} s"
        return line


def main() -> int:
    """Try them one after another."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ways", nargs="*", metavar="WAY", help=", ".join(WAYS))
    parser.add_argument("--python", default=sys.executable, help="that the environments are of")
    asked = parser.parse_args()
    if unknown := set(asked.ways) - WAYS.keys():
        parser.error(f"no way of installing: {', '.join(sorted(unknown))}")
    python = shutil.which(asked.python) or asked.python
    failed = 0
    for name in asked.ways or WAYS:
        try:
            print(try_way(name, python), flush=True)
        except RuntimeError as error:
            failed += 1
            print(f"{name:9} FAILED: {error}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
