"""The engine as the console knows it, its alerts, and the orbit's prediction."""
