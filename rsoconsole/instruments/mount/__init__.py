"""The mount, by a process of its own, with a watch and a second way to STOP."""
