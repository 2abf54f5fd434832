"""Evaluation of a run with the simulated observatory against the observatory's truth."""
