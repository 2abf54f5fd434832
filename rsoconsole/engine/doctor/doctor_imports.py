"""Which libraries load, tried in a process of its own that may crash."""

import json
import subprocess
import sys
from collections.abc import Sequence

_IMPORT_ALL = """
import importlib, json, sys
for name in sys.argv[1:]:
    print(json.dumps([name, "it ends the process"]), flush=True)
    try:
        importlib.import_module(name)
        fault = None
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}"
    print(json.dumps([name, fault]), flush=True)
"""
_PATIENCE_S = 120


def import_faults(names: Sequence[str]) -> dict[str, str]:
    """Why modules do not load, by their names; those that load are left out."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", _IMPORT_ALL, *names],
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
        check=False,
    )
    faults: dict[str, str | None] = {}
    for line in done.stdout.splitlines():
        if line.startswith("["):
            name, fault = json.loads(line)
            faults[name] = fault
    return {name: why for name in names if (why := faults.get(name, "not tried"))}
