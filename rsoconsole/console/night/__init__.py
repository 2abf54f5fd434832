"""The engine as the console knows it, its alerts, and where the orbit leads."""
