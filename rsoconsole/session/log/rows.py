"""The rows of ``log`` and ``files`` in SQL; values are passed in the order of the columns."""

LOG_COLUMNS = "seq, t_utc_ns, kind, frame_id, body"
FILE_COLUMNS = "frame_id, role, path, bytes, ms, reason, sha256"
LOG_ROWS = f"SELECT {LOG_COLUMNS} FROM log ORDER BY seq"
LOG_ROW = f"SELECT {LOG_COLUMNS} FROM log WHERE seq = ?"
FILE_ROWS = f"SELECT {FILE_COLUMNS} FROM files"
FILE_ROW = f"{FILE_ROWS} WHERE frame_id = ? AND role = ?"
# OR IGNORE: a commit that reported an error may have reached the disk all the same.
INSERT_RECORD = f"INSERT OR IGNORE INTO log ({LOG_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
INSERT_FILE = f"INSERT OR REPLACE INTO files ({FILE_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?)"
"""The news of a file that came last holds."""
