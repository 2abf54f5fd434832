"""Database of a session: its layout, writing, and reading without SQLite."""
