"""Word to the operator's telephone: by a process of its own that reads the session's log."""
