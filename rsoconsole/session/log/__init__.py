"""The session's database: how it is laid out, written to and read without SQLite."""
