"""Figures of confidence, innovations, NIS and image quality against time."""

import math
from typing import Any

from rsoconsole.library.notebook.figures.draw_sky import (
    BAND,
    BOUND,
    MEASURED,
    finish_figure,
    shade_misses,
    write_corner_note,
)
from rsoconsole.library.notebook.night.night import DrawnNight
from rsoconsole.night import FRAME_FACTS, frame_quantities

NIS_BAND = (0.0506, 7.378)
"""Bounds that hold 95 % of a chi-square of two degrees of freedom."""
WINDOW = 12
WINDOW_BAND = (1.03, 3.28)
"""Bounds that hold 95 % of the mean of twelve chi-squares of two degrees of freedom."""
_WIDER = 5.0
_FAR_WIDER = 20.0
"""Bounds wider than the innovations by this factor need a scale of their own."""


def draw_confidence(figure: Any, night: DrawnNight) -> None:
    """Draw the confidence of the accepted measurement, the confidence of the others, and tau."""
    axis = figure.subplots()
    column = shade_misses(axis, night)
    followed = [(f, m) for f in night.frames if (m := night.taken_measurement(f)) is not None]
    others = [
        (night.seconds_since_start(frame), each.confidence)
        for frame in night.frames
        for each in frame.measurements
        if each is not night.taken_measurement(frame)
    ]
    (taken,) = axis.plot(
        [night.seconds_since_start(frame) for frame, _ in followed],
        [measured.confidence for _, measured in followed],
        **{**MEASURED, "markerfacecolor": "#c62828", "markersize": 4.6, "linestyle": "none"},
    )
    other = None
    if others:
        (other,) = axis.plot(*zip(*others, strict=True), "x", color="#777777", markersize=4.5)
    missed = [
        night.seconds_since_start(frame)
        for frame in night.frames
        if frame.lead_miss_reason is not None
    ]
    if missed:
        axis.plot(missed, [0.0] * len(missed), "v", color="#b26a00", markersize=4, clip_on=False)
    (tau,) = axis.step(
        [night.seconds_since_start(frame) for frame in night.frames],
        [frame.tau for frame in night.frames],
        where="mid",
        **BOUND,
    )
    axis.set_ylim(0.0, 1.02)
    axis.set_ylabel("Confidence")
    taus = sorted({frame.tau for frame in night.frames})
    tau_words = f"τ = {taus[0]:.2f}" if len(taus) == 1 else "τ"
    keys = [(taken, "taken by the track"), (other, "not taken"), (tau, tau_words)]
    finish_figure(figure, night, "Confidence of the detections", [*keys, (column, "missed")])


def draw_residuals(figure: Any, night: DrawnNight) -> None:
    """Draw the innovations on the sky (measured minus predicted) within bounds of 3 sqrt(S)."""
    upper, lower = figure.subplots(2, 1, sharex=True)
    words = ("Δα cos δ (arcsec)", "Δδ (arcsec)")
    mark: Any = None
    bound: Any = None
    column: Any = None
    for index, (axis, label) in enumerate(zip((upper, lower), words, strict=True)):
        column = shade_misses(axis, night) or column
        t_s, values, bounds = _series(night, index)
        axis.axhline(0.0, color="#888888", linewidth=0.7)
        axis.fill_between(t_s, [-b for b in bounds], bounds, **BAND)
        (bound,) = axis.plot(t_s, bounds, **BOUND)
        axis.plot(t_s, [-b for b in bounds], **BOUND)
        (mark,) = axis.plot(t_s, values, **{**MEASURED, "markersize": 4.6})
        axis.set_ylabel(label)
        _scale(axis, values, bounds)
    bound_words = "± 3 √S, S = C P⁻ Cᵀ + R"
    keys = [(mark, "innovation"), (bound, bound_words), (column, "missed")]
    finish_figure(figure, night, "Innovations, measured minus predicted", keys)


def _series(night: DrawnNight, index: int) -> tuple[list[float], list[float], list[float]]:
    t_s, values, bounds = [], [], []
    for frame in night.frames:
        state = frame.updated
        if state is not None and state.innovation_arcsec and state.sigma_innovation_arcsec:
            t_s.append(night.seconds_since_start(frame))
            values.append(state.innovation_arcsec[index])
            bounds.append(3.0 * state.sigma_innovation_arcsec[index])
    return t_s, values, bounds


def _scale(axis: Any, values: list[float], bounds: list[float]) -> None:
    """Set the scale: linear where bounds and innovations compare, else log beyond the latter."""
    largest = max((abs(value) for value in values), default=1.0)
    widest = sorted(bounds)[len(bounds) // 2] if bounds else 1.0
    if widest > _FAR_WIDER * max(largest, 0.05):
        threshold = 10.0 ** math.ceil(math.log10(max(largest, 0.05)))
        axis.set_yscale("symlog", linthresh=threshold, linscale=2.0)
        axis.set_ylim(-5.0 * max(bounds), 5.0 * max(bounds))
        steps = [threshold * 100.0**k for k in range(5) if threshold * 100.0**k < max(bounds)]
        axis.set_yticks([-step for step in reversed(steps)] + [0.0, *steps])
        write_corner_note(axis, f"straight within ±{threshold:g}″, logarithmic beyond")
        return
    # A single far wider bound, after a poor measurement, may leave the panel.
    usual = [bound for bound in bounds if bound <= _WIDER * widest]
    reach = 1.15 * max(largest, *usual, 0.05)
    axis.set_ylim(-reach, reach)


def draw_nis(figure: Any, night: DrawnNight) -> None:
    """Draw the NIS of every update, its 95 % band, and its running mean."""
    axis = figure.subplots()
    column = shade_misses(axis, night)
    pairs = [
        (night.seconds_since_start(frame), frame.updated.nis)
        for frame in night.frames
        if frame.updated is not None and frame.updated.nis is not None
    ]
    band = axis.axhspan(*NIS_BAND, **BAND)
    window_band = axis.axhspan(*WINDOW_BAND, **{**BAND, "alpha": 0.22})
    axis.axhline(2.0, color="#888888", linewidth=0.7)
    gate = axis.axhline(night.config.filter.gate_nis, **BOUND)
    mark: Any = None
    mean: Any = None
    floor = 0.01
    if pairs:
        t_s, values = (list(each) for each in zip(*pairs, strict=True))
        # A logarithmic axis cannot show 0: what is smaller stands on its floor.
        usual = max(sorted(values)[len(values) // 2], 1e-6)
        floor = min(0.01, 10.0 ** math.floor(math.log10(usual) - 1.0))
        shown = [max(value, floor) for value in values]
        (mark,) = axis.plot(t_s, shown, **{**MEASURED, "markersize": 4.4})
        means = [
            math.fsum(values[k + 1 - WINDOW : k + 1]) / WINDOW
            for k in range(WINDOW - 1, len(values))
        ]
        if means:
            shown_means = [max(value, floor) for value in means]
            (mean,) = axis.plot(t_s[WINDOW - 1 :], shown_means, color="#1e55c8", linewidth=1.3)
    axis.set_yscale("log")
    axis.set_ylim(floor * 0.8, 40.0)
    if floor >= 0.01:
        axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_ylabel("NIS (ideal mean 2)")
    keys = [(mark, "NIS"), (mean, f"mean of {WINDOW}"), (band, "95 % of one")]
    keys += [(window_band, f"95 % of the mean of {WINDOW}"), (gate, "gate"), (column, "missed")]
    finish_figure(figure, night, "Normalised innovation squared", keys)


def draw_quality(figure: Any, night: DrawnNight) -> None:
    """Draw image and sky quality of each frame, one panel for each quantity."""
    panels = figure.subplots(len(FRAME_FACTS), 1, sharex=True)
    for fact, axis in zip(FRAME_FACTS, panels, strict=True):
        points = [
            (night.seconds_since_start(frame), value)
            for frame in night.frames
            if (value := frame_quantities(frame)[fact.name]) is not None
        ]
        if points:
            axis.plot(*zip(*points, strict=True), ".-", color=BOUND["color"], linewidth=0.9)
        axis.set_ylabel(f"{fact.label}\n({fact.unit})" if fact.unit else fact.label)
    finish_figure(figure, night, "Image and sky")
