"""The plate solver, in a process of its own, and its index files."""
