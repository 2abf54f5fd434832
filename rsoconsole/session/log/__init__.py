"""A session's database: its layout, writing it, and reading it without SQLite."""
