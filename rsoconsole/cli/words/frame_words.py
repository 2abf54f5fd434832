"""What was found in frames, as lines for a terminal."""

from typing import Any

from rsoconsole.records import Cause
from rsoconsole.words import (
    count_words,
    direction,
    light_words,
    pulse_words,
    streak_name_words,
    text,
)


def image_name(found: dict[str, Any]) -> str:
    """Name of the file and of the image in it."""
    extension = found["extension"]
    return f"{found['frame']}[{extension}]" if extension else str(found["frame"])


def process_words(found: dict[str, Any]) -> str:
    """Return a frame of ``process`` as a line."""
    words = [found["frame"], found["state"]]
    measurement = found["measurement"]
    if measurement is None:
        solution = found["solution"]
        reason = "nothing detected" if not found["detections"] else "not measured"
        reason = reason if solution is None or solution["solved"] else solution["reason"]
        no_time = found["no_time"]
        words.append(reason if no_time is None else f"{reason}: no time of exposure: {no_time}")
    else:
        words.append(direction(measurement["ra"], measurement["dec"], "bare"))
        words.append(
            f"±{measurement['sigma_ra_arcsec']:.1f}″ ±{measurement['sigma_dec_arcsec']:.1f}″"
        )
        words.append(f"confidence {measurement['confidence']:.2f}")
    if found["nis"] is not None:
        words.append(f"NIS {found['nis']:.1f}")
    if found["faint"] is not None:
        words.append(text(Cause(kind="faint frames agree", **found["faint"])))
    return "  ".join(words)


def detect_lines(found: dict[str, Any]) -> list[str]:
    """Return a frame of ``detect`` as lines."""
    lines = [f"{image_name(found)}: {count_words(len(found['detections']), 'streak')}"]
    lines.extend(
        f"  confidence {d['confidence']:.2f} at ({d['x']:.1f}, {d['y']:.1f})"
        f" length {d['length']:.0f} px, SNR {d['snr']:.0f}{_mag_words(d)}{_named_words(d)}"
        for d in found["detections"]
    )
    lines.extend(f"  rejected: {r['reason']}" for r in found["rejected"])
    return lines


def _mag_words(detection: dict[str, Any]) -> str:
    """Magnitude of a streak with its error and band: ``, mag 12.84 +- 0.03 V``."""
    words = light_words(
        detection["mag"],
        detection["mag_sigma"],
        detection["band"],
        is_saturated=bool(detection["is_saturated"]),
    )
    return f", {words}" if words else ""


def _named_words(detection: dict[str, Any]) -> str:
    """Kind and class of a streak in its report: ``, crossing, aircraft 0.83``."""
    name = streak_name_words(
        detection["kind"],
        detection["class"],
        detection["class_probability"],
        train=detection["train"],
    )
    pulse = pulse_words(
        detection["modulation_period_px"],
        detection["modulation_period_s"],
        detection["modulation_depth"],
    )
    return "".join(f", {words}" for words in (name, pulse) if words)


def solve_lines(found: dict[str, Any]) -> list[str]:
    """Return a frame of ``solve`` as lines."""
    if not found["solved"]:
        return [f"{image_name(found)}: not solved: {found['reason']}"]
    solved = (
        f"{image_name(found)}: {direction(found['ra'], found['dec'], 'bare')}"
        f" {found['scale_arcsec_px']:.4f} arcsec/px, rotation {found['rotation_deg']:.2f} deg,"
        f" {found['matched']} stars, rms {found['rms_arcsec']:.2f} arcsec"
    )
    return [solved, *(f"  {wrong['reason']}" for wrong in found["wrong_hints"])]
