"""Settings that older sessions do not name, as they were when those were recorded."""

from typing import Any

_OLD_FILTER = {
    "preset": "tuned",
    "max_coast_s": 3600.0,
    "most_tracks": 1,
}
"""Defaults that have changed since: a session that does not name them was recorded with these."""


def with_old_defaults(table: Any) -> Any:
    if not isinstance(table, dict):
        return table
    return {**table, "filter": {**_OLD_FILTER, **table.get("filter", {})}}
