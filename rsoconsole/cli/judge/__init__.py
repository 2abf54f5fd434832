"""A run against the simulated observatory, judged by the truth that only this package reads."""
