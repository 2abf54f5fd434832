"""Put the measured figures into the model card, so that none is typed by hand.

    python -m models.card

Rewrites the text between two marks in ``models/README.md`` from ``models/figures.json``, the
network's card, and the results of ``bench_vision.py`` and ``bench_peers.py`` in ``tests/bench``.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from models.rows import HERE
from rsoconsole.vision import MODEL_NAME

README = HERE / "README.md"
FIGURES = HERE / "figures.json"
CARD = (HERE / MODEL_NAME).with_suffix(".json")
RESULTS = HERE.parent / "tests" / "bench" / "results"
PEERS, TIMES = RESULTS / "peers.json", RESULTS / "vision.json"
BEGIN = "<!-- figures: written by python -m models.card -->"
END = "<!-- end of figures -->"
_MIN_FOR_RECALL = 20
NOT_MEASURED = "Not measured yet: `python -m models.measure`, then `python -m models.card`."


def section(figures: Any, card: Any, peers: Any, times: Any) -> str:
    """The section of the model card with the figures, in Markdown.

    ``figures``: of whole frames. ``card``: the network's. ``peers`` and ``times``: of the benches.
    """
    if figures is None:
        return NOT_MEASURED
    parts = [
        f"Network {figures['network']}, tau = {figures['tau']:.2f}. Intervals are exact, 95 %.",
        "### False alarms\n\n" + _false_alarms(figures),
        "### Recall by length (px) and signal to noise, whole streaks, clear sky\n\n"
        + _recall(figures["recall"])
        + "\n\n"
        + _recall_elsewhere(figures),
        "### Midpoint\n\n" + _midpoint(figures["midpoint_error_px"]),
        "### Where the missed ones were lost\n\n" + _lost(figures["lost"]),
        "### Is confidence a probability\n\n" + _confidence(figures, card),
        "### Average precision\n\n" + _rest(figures),
        "### Time and memory\n\n" + _times(times, figures["network"]),
        "### Beside its peers\n\n" + _peers(peers, figures["network"]),
        "### Training, as the network's card tells it\n\n" + _training(card),
    ]
    return "\n\n".join(parts)


def rewritten(text: str, figures: Any, card: Any, peers: Any, times: Any) -> str:
    """The model card's text with a new section of figures between its marks."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n\n{section(figures, card, peers, times)}\n\n{END}{after}"


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _false_alarms(figures: Any) -> str:
    lines = [
        [
            name,
            f"{each['count']} in {each['frames']}",
            f"{each['rate']:g} per {each['per']}",
            f"{each['interval'][0]:g} to {each['interval'][1]:g}",
            f"{each['upper_limit']:g}",
        ]
        for name, each in figures["false_alarms"].items()
        if each is not None
    ]
    again, trails = figures["second_detections"]
    table = _table(["frames", "false above tau", "rate", "95 % interval", "upper limit"], lines)
    return f"{table}\n\nSecond detections on one trail: {again} on {trails} trails."


def _recall(recall: Any) -> str:
    bands = list(next(iter(recall.values())))
    lines = [[f"SNR {snr}", *(_share(cells[px]) for px in bands)] for snr, cells in recall.items()]
    return _table(["", *(f"{px} px" for px in bands)], lines)


def _recall_elsewhere(figures: Any) -> str:
    lines = [
        [f"SNR {snr}", _share(each), _share(figures["recall_under_clouds"][snr])]
        for snr, each in figures["recall_cut_by_the_edge"].items()
    ]
    return _table(["", "cut by the frame's edge", "under clouds (SNR of what is left)"], lines)


def _share(each: Any) -> str:
    if not each["of"]:
        return "-"
    low, high = each["interval"]
    return f"**{each['recall']:.2f}** ({low:.2f}-{high:.2f}; {each['found']} of {each['of']})"


def _midpoint(errors: Any) -> str:
    lines = [
        [f"SNR {snr}"]
        + (
            [f"{each[name]:.2f} px" for name in ("median", "percentile_95", "largest")]
            + [str(each["streaks"])]
            if each
            else ["-"] * 4
        )
        for snr, each in errors.items()
    ]
    return _table(["", "median", "95th percentile", "largest", "streaks"], lines)


def _lost(lost: Any) -> str:
    lines = []
    for snr, reasons in lost.items():
        words = "; ".join(f"{count} {reason}" for reason, count in reasons.items())
        lines.append([f"SNR {snr}", words or "none missed"])
    return _table(["", "of whole streaks of any length"], lines)


def _confidence(figures: Any, card: Any) -> str:
    reliability = figures["reliability"]
    if reliability is None:
        return "The card states no population."
    shares = card["measured_confidence"]["population"]["shares_of_frames"]
    mix = ", ".join(f"{share:.0%} {name}" for name, share in shares.items())
    text = (
        f"In a population of frames ({mix}) of which one clear or cloudy frame in "
        f"{reliability['one_frame_with_satellites_in']} holds one to three satellites:"
    )
    lines = [
        [
            f"{each['from']:.1f}-{each['to']:.1f}",
            f"{each['said']:.3f}",
            f"{each['share']:.3f}",
            f"{each['true']} of {each['candidates']}",
        ]
        for each in reliability["bins"]
    ]
    head = ["confidence", "mean said", "share true (weighed)", "true of candidates (as drawn)"]
    return f"{text}\n\n{_table(head, lines)}"


def _rest(figures: Any) -> str:
    precision = "; ".join(
        f"{name}: {value:.3f}"
        for name, value in figures["average_precision"].items()
        if value is not None
    )
    product = figures["product_as_it_is"]
    differing = len(product["differing"])
    return (
        f"Average precision, half of the ordinary frames with satellites: {precision}.\n\n"
        f"Answers of the product as it is, with its curve and tau, that differ from the rows "
        f"these figures were made of: {differing} of {product['frames']} frames."
    )


def _times(times: Any, network: str) -> str:
    if times is None or times["network"] != network:
        return "Not measured with this network yet: `python -m tests.bench.bench_vision --write`."
    threads = [key for key in times if key.startswith("threads ")]
    text = (
        "From a 4656 x 3520 frame in memory to refined detections on a machine with "
        f"{times['machine']}, medians of {times['repeats']} in ms; in brackets the first look at a "
        "frame after a second without work."
    )
    stages = ("background", "map", "stars", "network", "fit")
    most = times[threads[-1]]
    lines = [
        [
            name,
            *(
                f"{times[n]['frames'][name]['all']:.0f} ({times[n]['frames'][name]['cold']:.0f})"
                for n in threads
            ),
            *(f"{each[stage]:.0f}" for stage in stages),
            f"{each['detections']}",
        ]
        for name, each in most["frames"].items()
    ]
    memory = f"Memory beyond program and frame: {most['extra_memory_mb']['resident']:.0f} MB."
    head = ["frame", *threads, *(f"{stage}, {threads[-1]}" for stage in stages), "detections"]
    return f"{text}\n\n{_table(head, lines)}\n\n{memory}"


def _peers(peers: Any, network: str) -> str:
    drawn = (peers or {}).get("drawn", {})
    if drawn.get("network") != network:
        return "Not measured with this network yet: `python -m tests.bench.bench_peers`."
    low, high = drawn["lengths_px"]
    text = (
        f"On one set of frames, streaks of {low:g} to {high:g} px, as many in each range of "
        "signal to noise, aircraft among them; average precision / recall at one false detection "
        "in ten frames. Every peer at the settings that served it best on "
        f"{drawn['tuned_on']} frames of other seeds; the slow ones looked at the first "
        f"{drawn['first_frames']}, too few for a recall."
    )
    by_peer = drawn["peers"]
    ranges = [key for key in next(iter(by_peer.values()))["all"] if key != "all"]
    lines = []
    for name, each in by_peer.items():
        every, failed = each["all"]["all"], len(each["failed"])
        is_short = every["frames"] < _MIN_FOR_RECALL
        cells = (each["all"][key] for key in ranges)
        lines.append(
            [name, f"{every['frames']:.0f}" + (f" ({failed} without an answer)" if failed else "")]
            + [
                _two(c["average_precision"])
                + ("" if is_short else f" / {_two(c['recall_at_0.1'])}")
                for c in cells
            ]
            + [_two(every["centroid_px"]), _two(each["wall_s"]), _two(each["peak_mb"], 0)]
        )
    snrs = (f"SNR {name}" for name in ranges)
    head = ["", "frames", *snrs, "median error, px", "seconds a frame", "MB in all"]
    return f"{text}\n\n{_table(head, lines)}"


def _two(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _training(card: Any) -> str:
    facts = {**card.get("training", {}), **card.get("calibration", {})}
    return "; ".join(f"{name} {value}" for name, value in facts.items()) or "Not stated."


def read_json(path: Path) -> Any:
    """Content of a JSON file; None where there is no such file."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def main() -> None:
    """Run the command line: rewrite the section of figures in ``models/README.md``."""
    text = README.read_text(encoding="utf-8")
    README.write_text(
        rewritten(text, read_json(FIGURES), read_json(CARD), read_json(PEERS), read_json(TIMES)),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
