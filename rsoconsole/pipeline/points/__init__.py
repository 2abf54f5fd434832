"""Points of several frames confirmed as objects that keep pace with the telescope."""
