"""The mount: in a process of its own that also watches it, with a second path for STOP."""
