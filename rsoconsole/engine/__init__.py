"""The process that runs the telescope; it needs no terminal."""
