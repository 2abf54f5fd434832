"""The simulated observatory's INDI devices."""
