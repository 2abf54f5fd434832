"""Alerts to the operator's telephone, sent by a process of its own that reads the session's log."""
