"""The mount, in a process of its own, with a watch and a second path to STOP."""
