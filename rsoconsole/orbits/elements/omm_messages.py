"""Orbit Mean-Elements Messages, as KVN, XML or JSON. Pure.

Source: CCSDS 502.0-B-3 and 505.0-B-3; JSON with the keywords as CelesTrak and Space-Track write it.
Numbers are written with all their digits, more than two lines have room for.
"""

import json
from typing import Literal
from xml.sax.saxutils import escape

from rsoconsole.orbits.elements.sgp4_fit import MeanElements
from rsoconsole.words import utc_ns_to_iso

VERSION = "3.0"
ORIGINATOR = "RSOCONSOLE"
Form = Literal["kvn", "xml", "json"]


def omm_message(elements: MeanElements, *, created_utc_ns: int, form: Form = "kvn") -> str:
    """Write elements as one Orbit Mean-Elements Message, in the given form."""
    header = {"CREATION_DATE": _time(created_utc_ns), "ORIGINATOR": ORIGINATOR}
    comment = f"SGP4 elements fitted to directions, {elements.rms_arcsec:.2f} arcsec rms"
    parts = {
        "metadata": {
            "OBJECT_NAME": " ".join(elements.name.split()) or "UNKNOWN",
            "OBJECT_ID": elements.cospar or "UNKNOWN",
            "CENTER_NAME": "EARTH",
            "REF_FRAME": "TEME",
            "TIME_SYSTEM": "UTC",
            "MEAN_ELEMENT_THEORY": "SGP4",
        },
        "meanElements": {
            "EPOCH": _time(elements.epoch_utc_ns),
            "MEAN_MOTION": f"{elements.revolutions_a_day:.12f}",
            "ECCENTRICITY": f"{elements.e:.12f}",
            "INCLINATION": f"{elements.i_deg:.10f}",
            "RA_OF_ASC_NODE": f"{elements.raan_deg:.10f}",
            "ARG_OF_PERICENTER": f"{elements.argp_deg:.10f}",
            "MEAN_ANOMALY": f"{elements.m_deg:.10f}",
        },
        "tleParameters": {
            "EPHEMERIS_TYPE": "0",
            "CLASSIFICATION_TYPE": "U",
            "NORAD_CAT_ID": str(elements.norad_id),
            "ELEMENT_SET_NO": "1",
            "REV_AT_EPOCH": "0",
            "BSTAR": f"{elements.bstar:.10g}",
            "MEAN_MOTION_DOT": "0.0",
            "MEAN_MOTION_DDOT": "0.0",
        },
    }
    if form == "kvn":
        return _kvn(header, comment, parts)
    if form == "xml":
        return _xml(header, comment, parts)
    flat = {"CCSDS_OMM_VERS": VERSION, "COMMENT": comment, **header}
    for part in parts.values():
        flat |= part
    return json.dumps([{key: _plain(value) for key, value in flat.items()}], indent=1) + "\n"


_UNITS = {
    "MEAN_MOTION": "rev/day",
    "INCLINATION": "deg",
    "RA_OF_ASC_NODE": "deg",
    "ARG_OF_PERICENTER": "deg",
    "MEAN_ANOMALY": "deg",
    "BSTAR": "1/ER",
    "MEAN_MOTION_DOT": "rev/day**2",
    "MEAN_MOTION_DDOT": "rev/day**3",
}
"""Units, which are attributes in XML; KVN and JSON have none."""


def _kvn(header: dict[str, str], comment: str, parts: dict[str, dict[str, str]]) -> str:
    lines = [f"CCSDS_OMM_VERS = {VERSION}", f"COMMENT {comment}"]
    lines += [f"{key} = {value}" for key, value in header.items()]
    for part in parts.values():
        lines += ["", *(f"{key} = {value}" for key, value in part.items())]
    return "\n".join(lines) + "\n"


def _xml(header: dict[str, str], comment: str, parts: dict[str, dict[str, str]]) -> str:
    def tags(part: dict[str, str]) -> str:
        units = {key: f' units="{_UNITS[key]}"' for key in part if key in _UNITS}
        return "".join(
            f"<{key}{units.get(key, '')}>{escape(value)}</{key}>" for key, value in part.items()
        )

    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<omm id="CCSDS_OMM_VERS" version="{VERSION}">\n'
        f"<header><COMMENT>{escape(comment)}</COMMENT>{tags(header)}</header>\n"
        f"<body><segment>\n<metadata>{tags(parts['metadata'])}</metadata>\n"
        f"<data>\n<meanElements>{tags(parts['meanElements'])}</meanElements>\n"
        f"<tleParameters>{tags(parts['tleParameters'])}</tleParameters>\n</data>\n"
        "</segment></body>\n</omm>\n"
    )


def _plain(value: str) -> str | float | int:
    """Value as a number where it is one."""
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value


def _time(t_utc_ns: int) -> str:
    return utc_ns_to_iso(t_utc_ns, 6).removesuffix("Z")
