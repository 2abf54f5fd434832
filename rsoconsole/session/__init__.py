"""The record of a night: one writer, any number of readers.

May touch records, config and errors below, SQLite and the session's folder; never instruments.
"""
