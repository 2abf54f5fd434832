"""The session's database: a public interface with a version.

``log`` is the truth: every record in the order in which the engine made it, as JSON. The views
spread the records into columns for SQL; SQLite may round their decimals in the last digit, the
JSON is exact. A new version adds; it never renames nor rewrites: whoever reads an older session
gets today's views over it, made for his connection alone (``temporary_views``).

Schema 2 adds the hash of every file, and on close the digest of the log (``session/digest.py``);
schema 3 the views of orbits and identifications; schema 4 the ids of measurements and tracks
and reasons as kinds with figures (records of older ones are given theirs by ``session/legacy.py``;
in SQL their columns are NULL).
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

DATABASE = "session.db"
WAL = f"{DATABASE}-wal"
JOURNAL = f"{DATABASE}-journal"
BESIDE_DATABASE = (WAL, JOURNAL, f"{DATABASE}-shm")
"""What SQLite keeps beside the database while it is written, or after it was cut off."""
CONFIG = "config.toml"
WORLD = "world.toml"
"""What was imperfect about a simulated night."""
BRANCHES = "branches"
"""Folder of what others derive from the session: never part of its record."""

FOLDERS: Mapping[str, str] = MappingProxyType(
    {"frame": "frames", "preview": "previews", "closeup": "closeups"}
)
"""Where the files of each role lie."""
_ENDINGS = {"frame": ".fits.fz", "preview": ".png", "closeup": ".png"}
_NUMBERED = re.compile(r"(?P<folder>[a-z]+)/(?P<frame_id>\d{6,})(?P<ending>(\.[a-z]+)+)")

SCHEMA_VERSION = 4
_WITH_HASHES = 2
APPLICATION_ID = 0x52534F43
"""``RSOC`` in the database's header: tells a session from any other SQLite file."""

TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE log (
  seq INTEGER PRIMARY KEY,
  t_utc_ns INTEGER NOT NULL,
  kind TEXT NOT NULL,
  frame_id INTEGER,
  body TEXT NOT NULL
);
CREATE INDEX log_kind ON log (kind, frame_id);
CREATE TABLE files (
  frame_id INTEGER NOT NULL,
  role TEXT NOT NULL,
  path TEXT,
  bytes INTEGER,
  ms REAL,
  reason TEXT,
  sha256 TEXT,
  PRIMARY KEY (frame_id, role)
) WITHOUT ROWID;
"""

_KINDS_BY_VIEW = {
    "solutions": "Solution",
    "measurements": "Measurement",
    "track": "TrackState",
    "slews": "SlewCommand",
    "misses": "Miss",
    "orbits": "OrbitEstimate",
    "identifications": "Identified",
    "states": "StateChange",
    "parameters": "ParameterChange",
    "actions": "OperatorAction",
    "events": "Event",
}

_COLUMNS_BY_VIEW = {
    "solutions": (
        "ra_icrs_deg dec_icrs_deg scale_arcsec_px rotation_deg is_flipped matched rms_arcsec "
        "path ms wcs"
    ),
    "measurements": (
        "t_mid_utc_ns ra_icrs_deg dec_icrs_deg x_px y_px confidence source is_clipped "
        "cov_ee_arcsec2=cov_sky_arcsec2[0] cov_en_arcsec2=cov_sky_arcsec2[1] "
        "cov_nn_arcsec2=cov_sky_arcsec2[2] ends_icrs_deg measurement_id"
    ),
    "track": (
        "step=kind t_state_utc_ns=t_utc_ns ra_icrs_deg=x[0] ra_rate_deg_s=x[1] "
        "dec_icrs_deg=x[2] dec_rate_deg_s=x[3] covariance=P nis "
        "innovation_east_arcsec=innovation_arcsec[0] innovation_north_arcsec=innovation_arcsec[1] "
        "sigma_east_arcsec=sigma_innovation_arcsec[0] "
        "sigma_north_arcsec=sigma_innovation_arcsec[1] misses foretold_by=foretold_by?filter "
        "track_id measurement_id first_measurement_id=begun_with[0] is_lead"
    ),
    "slews": "ra_icrs_deg dec_icrs_deg t_aim_utc_ns reason track_id",
    "misses": "reason track_id",
    "orbits": (
        "label prior reason observations arc_s epoch_utc_ns x_gcrs_km=r_gcrs_km[0] "
        "y_gcrs_km=r_gcrs_km[1] z_gcrs_km=r_gcrs_km[2] vx_gcrs_km_s=v_gcrs_km_s[0] "
        "vy_gcrs_km_s=v_gcrs_km_s[1] vz_gcrs_km_s=v_gcrs_km_s[2] covariance a_km e i_deg "
        "sigma_a_km rms_arcsec outliers nis innovation_east_arcsec=innovation_arcsec[0] "
        "innovation_north_arcsec=innovation_arcsec[1] is_guide track_id"
    ),
    "identifications": (
        "verdict reason hint observations catalogued norad_id=matches[0].norad_id "
        "name=matches[0].name separation_arcsec=matches[0].separation_arcsec "
        "probability=matches[0].probability runner_up_norad_id=matches[1].norad_id "
        "runner_up_name=matches[1].name "
        "runner_up_separation_arcsec=matches[1].separation_arcsec matches track_id"
    ),
    "states": "before after reason",
    "parameters": "name before after by",
    "actions": "verb arguments outcome by",
    "events": "level text",
}
"""``column=place`` where the record's field is not the column, ``place?value`` where older records
lack it."""

_CANDIDATE = (
    "confidence x_px y_px x_a_px y_a_px x_b_px y_b_px length_px width_px snr sigma_along_px "
    "sigma_across_px is_clipped method x0_px=box_px[0] y0_px=box_px[1] x1_px=box_px[2] "
    "y1_px=box_px[3] unevenness"
)

_FRAMES_VIEW = """
SELECT log.seq, log.t_utc_ns, log.frame_id,
  json_extract(body, '$.name') AS name,
  json_extract(body, '$.t_start_utc_ns') AS t_start_utc_ns,
  json_extract(body, '$.exposure_s') AS exposure_s,
  json_extract(body, '$.width_px') AS width_px,
  json_extract(body, '$.height_px') AS height_px,
  json_extract(body, '$.pointing_ra_icrs_deg') AS pointing_ra_icrs_deg,
  json_extract(body, '$.pointing_dec_icrs_deg') AS pointing_dec_icrs_deg,
  kept.path AS file, kept.bytes AS file_bytes, kept.reason AS not_kept_because,
  shown.path AS preview, kept.sha256 AS file_sha256
FROM log
LEFT JOIN files AS kept ON kept.frame_id = log.frame_id AND kept.role = 'frame'
LEFT JOIN files AS shown ON shown.frame_id = log.frame_id AND shown.role = 'preview'
WHERE kind = 'FrameTaken'
"""

_NOT_SOLVED = """
SELECT seq, t_utc_ns, frame_id,
  json_extract(body, '$.reason') AS reason, json_extract(body, '$.ms') AS ms
FROM log WHERE kind = 'NotSolved'
"""

_NOT_FOLLOWED = """
SELECT seq, t_utc_ns, frame_id,
  json_extract(body, '$.measurement.ra_icrs_deg') AS ra_icrs_deg,
  json_extract(body, '$.measurement.dec_icrs_deg') AS dec_icrs_deg,
  coalesce(json_extract(body, '$.reason.text'), json_extract(body, '$.reason')) AS reason,
  json_extract(body, '$.measurement.measurement_id') AS measurement_id,
  json_extract(body, '$.track_id') AS track_id, {superseded}
FROM log WHERE kind = 'NotFollowed'
"""

_SUPERSEDED = (
    "EXISTS (SELECT 1 FROM log AS later WHERE later.kind = 'FollowedAgain'"
    " AND later.frame_id = log.frame_id AND later.seq > log.seq) AS is_superseded"
)
"""Whether the operator's word has had the frame followed again: the row counts no more."""
_FOLLOWED_AGAIN = ("track", "misses", "orbits", "identifications")

_TIMINGS = """
SELECT seq, t_utc_ns, frame_id, stage.key AS stage, stage.value AS ms
FROM log, json_each(body, '$.stage_ms') AS stage WHERE kind = 'CycleTiming'
"""


VIEWS = (
    "frames",
    "detections",
    "rejections",
    "not_solved",
    "not_followed",
    "timings",
    *_KINDS_BY_VIEW,
)
"""Names of the public views."""


def file_name(role: str, frame_id: int) -> str:
    """Where a file of this role lies in the session's folder, as the table ``files`` has it."""
    return f"{FOLDERS[role]}/{frame_id:06d}{_ENDINGS[role]}"


def role_of(path: str) -> tuple[str, int] | None:
    """(role, frame_id) of a file by its place in the session's folder; None for any other file."""
    match = _NUMBERED.fullmatch(path)
    if match is None:
        return None
    for role in FOLDERS:
        if file_name(role, int(match["frame_id"])) == path:
            return role, int(match["frame_id"])
    return None


def _columns(spec: str, body: str, prefix: str = "$.") -> str:
    """SQL of the columns in ``spec``, taken out of the JSON in ``body``."""
    pairs = [word.partition("=") for word in spec.split()]
    return ", ".join(
        f"{_extracted(body, prefix + (place or name))} AS {name}" for name, _, place in pairs
    )


def _extracted(body: str, place: str) -> str:
    place, _, default = place.partition("?")
    value = f"json_extract({body}, '{place}')"
    if place.endswith(".reason"):
        # A kind with its figures, and what they say as text; text alone in older sessions.
        return f"coalesce(json_extract({body}, '{place}.text'), {value})"
    return f"coalesce({value}, '{default}')" if default else value


def _candidates(member: str, prefix: str, extra: str) -> str:
    return (
        "SELECT seq, t_utc_ns, log.frame_id AS frame_id, "
        f"one.key AS number, {_columns(_CANDIDATE, 'one.value', prefix)}{extra} "
        f"FROM log, json_each(body, '$.{member}') AS one WHERE log.kind = 'Detections'"
    )


def _selects() -> dict[str, str]:
    """What each public view selects."""
    rejected_because = f", {_extracted('one.value', '$.reason')} AS reason"
    return {
        "frames": _FRAMES_VIEW,
        "detections": _candidates("detections", "$.", ""),
        "rejections": _candidates("rejected", "$.detection.", rejected_because),
        "not_solved": _NOT_SOLVED,
        "not_followed": _NOT_FOLLOWED.format(superseded=_SUPERSEDED),
        **{
            view: f"SELECT seq, t_utc_ns, frame_id, {_columns(_COLUMNS_BY_VIEW[view], 'body')}"
            f"{', ' + _SUPERSEDED if view in _FOLLOWED_AGAIN else ''}"
            f" FROM log WHERE kind = '{kind}'"
            for view, kind in _KINDS_BY_VIEW.items()
        },
        "timings": _TIMINGS,
    }


def create_script() -> str:
    """SQL that makes an empty session database: tables, then the public views."""
    views = (f"CREATE VIEW {name} AS {select};\n" for name, select in _selects().items())
    return TABLES + "".join(views)


def temporary_views(version: int) -> str:
    """SQL that gives one connection to a session of schema ``version`` the views of today.

    They are temporary: the file is not touched and may lie on a medium that cannot be written.
    Columns that the older schema does not have are NULL. Empty for a session of today's schema.
    """
    if version >= SCHEMA_VERSION:
        return ""
    # Unqualified names in a temporary view mean temporary ones first: the views below see this.
    files = ""
    if version < _WITH_HASHES:
        files = "CREATE TEMP VIEW files AS SELECT *, NULL AS sha256 FROM main.files;\n"
    views = (f"CREATE TEMP VIEW {name} AS {select};\n" for name, select in _selects().items())
    return "PRAGMA temp_store=MEMORY;\n" + files + "".join(views)
