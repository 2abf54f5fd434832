"""The figures of every group, as one table."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from tests.campaign.cases import GROUPS

HEADING = (
    "| nights | n | visible frames | detected | in TRACK | TRACK after lock | inside 3 sigma "
    "| identified | measured rms | predicted rms | false |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|\n"
)
BY_SCATTER = {
    "shutter": "shutter scattered by",
    "indiserver": "INDI's own simulators, streaks scattered by",
}


def row(title: str, found: Sequence[Mapping[str, Any]]) -> str:
    """One line: sums over all objects of all nights; rms figures are medians over the objects."""
    nights = [night for night in found if "error" not in night]
    objects = [each for night in nights for each in night["objects"] if each["visible_frames"]]
    visible = sum(each["visible_frames"] for each in objects)
    failed = len(found) - len(nights)
    named = [each["identified"] for each in objects if each["identified"] is not None]
    cells = [
        title,
        f"{len(nights)}" + (f" ({failed} failed)" if failed else ""),
        str(visible),
        _share(_of_visible(objects, "detections"), visible),
        _share(_of_visible(objects, "track_frames"), visible),
        *_after_lock(objects),
        f"{sum(map(bool, named))} of {len(objects)}",
        _median(each["measured_rms_arcsec"] for each in objects),
        _median(each["prediction_rms_arcsec"] for each in objects),
        str(sum(each["false_measurements"] for each in objects)),
    ]
    return "| " + " | ".join(cells) + " |\n"


def table(found: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """All groups that have an answer; those of a scattered shutter by its scatter."""
    lines = [HEADING]
    for name, group in GROUPS.items():
        answers = found.get(name, {})
        if not answers:
            continue
        if name in BY_SCATTER:
            scatters = dict.fromkeys(case.rpartition("-seed-")[0] for case in answers)
            for scatter in scatters:
                some = [each for case, each in answers.items() if case.startswith(f"{scatter}-")]
                lines.append(row(f"{BY_SCATTER[name]} {scatter.removeprefix('scatter-')} s", some))
            continue
        lines.append(row(group.title, list(answers.values())))
    return "".join(lines)


def _after_lock(objects: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Share of the frames with a detection in which the track took it; truth in the bounds."""
    locked = [each for each in objects if each.get("detected_after_lock")]
    detected = sum(each["detected_after_lock"] for each in locked)
    inside = [each["inside_3sigma"] for each in locked if each["inside_3sigma"] is not None]
    tracked = sum(each["tracked_after_lock"] for each in locked)
    return (
        _share(tracked, detected),
        f"{100.0 * statistics.fmean(inside):.0f} %" if inside else "-",
    )


def _of_visible(objects: Sequence[Mapping[str, Any]], key: str) -> int:
    """Some are found in frames that do not count as visible: none counts for more than it has."""
    return sum(min(each[key], each["visible_frames"]) for each in objects)


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.0f} %" if whole else "-"


def _median(values: Any) -> str:
    known = [value for value in values if value is not None]
    return f'{statistics.median(known):.2f}"' if known else "-"
